"""Rasterizes the atlas into texture space with OpenGL, at any offset in the texels' squares."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from aoprecalc.gl.context import draw_program
from aoprecalc.raster.layout import (
    BORDER_RULES,
    CENTER,
    GRID,
    Layout,
    Samples,
    clamp_barycentric,
    min_corner_weights,
    move_off_borders,
    order_in_blocks,
    row_bands,
)
from aoprecalc.types import Float32Array, Texels

_PACKAGE = "aoprecalc.raster"


class GLRasterizer:
    """A Rasterizer that draws band by band into one float target: face + 1, weights of corners 1 and 2, 0.

    Triangles are sampled as any rasterizer does, except that the sample may lie anywhere in the texel's square. Borders
    are rasterized conservatively, so that every texel whose square the surface touches has a sample, moved onto the
    surface (idea: J. Hasselgren, T. Akenine-Moeller, L. Ohlsson, "Conservative Rasterization", GPU Gems 2, 2005).
    """

    def __init__(self, context: moderngl.Context, layout: Layout) -> None:
        """Upload the layout."""
        self.layout = layout
        self._context = context
        self._min_weights = min_corner_weights(layout)
        self._bands = row_bands(layout.width, layout.height)
        size = (layout.width, self._bands[0][1])
        self._surface = context.texture(size, 4, dtype="f4")
        self._target = context.framebuffer([self._surface], context.depth_renderbuffer(size))
        self._fill = draw_program(context, _PACKAGE, "triangle.vert.glsl", "triangle.frag.glsl", GRID=GRID)
        self._count = draw_program(context, _PACKAGE, "triangle.vert.glsl", "count.frag.glsl", GRID=GRID)
        self._edge = draw_program(context, _PACKAGE, "border.vert.glsl", "border.frag.glsl", GRID=GRID, **BORDER_RULES)

        faces = layout.faces.astype(np.float32)
        corners = np.repeat(np.column_stack([layout.triangles.reshape(-1, 6), faces]), 3, axis=0)
        borders = np.column_stack([layout.borders.reshape(-1, 6), layout.border_faces, layout.border_corners])
        self._corners = context.buffer(np.ascontiguousarray(corners, np.float32))
        self._borders = context.buffer(np.ascontiguousarray(borders, np.float32)) if len(borders) else None
        self._triangles = context.vertex_array(
            self._fill, [(self._corners, "2f 2f 2f 1f", "in_a", "in_b", "in_c", "in_face")]
        )
        self._counted = context.vertex_array(self._count, [(self._corners, "2f 2f 2f 4x", "in_a", "in_b", "in_c")])
        self._edges = self._borders and context.vertex_array(
            self._edge, [(self._borders, "2f 2f 2f 1f 1f /i", "in_start", "in_end", "in_apex", "in_face", "in_corner")]
        )

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        layout, index = self.layout, []
        for row, rows in self._bands:
            covered = np.flatnonzero(self._draw(row, rows, CENTER)[:, 0])
            index.append((order_in_blocks(covered, layout.width) + row * layout.width).astype(np.int32))
        return Texels(layout.width, layout.height, np.concatenate(index))

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        covered = twice = 0
        self._count["sample_at"] = CENTER
        for row, rows in self._bands:
            self._begin(row, self._count)
            self._context.enable_only(moderngl.BLEND)
            self._context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
            self._context.blend_func = moderngl.ONE, moderngl.ONE
            self._counted.render(moderngl.TRIANGLES)
            counts = self._read(rows)[:, 0]
            covered += int(np.count_nonzero(counts))
            twice += int(np.count_nonzero(counts > 1.5))
        return twice / covered if covered else 0.0

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return the surface under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        faces, weights = np.empty(len(texels), np.int32), np.empty((len(texels), 3), np.float32)
        for row, rows in self._bands:
            start, stop = row * self.layout.width, (row + rows) * self.layout.width
            band: slice | NDArray[np.intp] = slice(None)
            if len(self._bands) > 1:
                band = np.flatnonzero((texels.index >= start) & (texels.index < stop))
                if not len(band):
                    continue
            surface = self._draw(row, rows, sample_at)[texels.index[band] - start]
            faces[band] = surface[:, 0].astype(np.int32) - 1
            weights[band] = move_off_borders(clamp_barycentric(surface[:, 1:3].T), faces[band], self._min_weights)
        return Samples(faces, weights)

    def _begin(self, row: int, *programs: moderngl.Program) -> None:
        self._target.use()
        self._target.clear(depth=1.0)
        for program in programs:
            program["origin"] = (0, row)
            program["size"] = self._surface.size

    def _draw(self, row: int, rows: int, sample_at: tuple[float, float]) -> Float32Array:
        """Draw the band of `rows` rows that starts at `row`; return the target, (rows * width, 4)."""
        self._begin(row, self._fill, self._edge)
        self._fill["sample_at"] = self._edge["sample_at"] = sample_at
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<"
        self._triangles.render(moderngl.TRIANGLES)
        if self._edges:
            self._edges.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(self.layout.borders))
        return self._read(rows)

    def _read(self, rows: int) -> Float32Array:
        pixels: Float32Array = np.frombuffer(self._surface.read(), np.float32).reshape(-1, 4)
        return pixels[: rows * self.layout.width]
