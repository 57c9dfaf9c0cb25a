"""Draws the atlas into texture space: what surface lies under each texel, at a chosen spot of its square."""

from dataclasses import dataclass

import moderngl
import numpy as np

from aoprecalc.gl.programs import draw_program
from aoprecalc.model import Texels
from aoprecalc.texspace.layout import Layout
from aoprecalc.texspace.samples import BAND_TEXELS, BORDER_RULES, CENTER, GRID, bands, in_blocks

_PACKAGE = "aoprecalc.texspace"
_BAND_TEXELS = BAND_TEXELS


@dataclass(frozen=True, eq=False)
class Band:
    """A run of whole rows of the texture and the covered texels in it.

    row, rows   its first row and how many there are
    texels      slice of Texels.index
    """

    row: int
    rows: int
    texels: slice


class Raster:
    """Draws a layout, band by band, into one float target of (face + 1, weight of corner 1, weight of corner 2, 0).

    Triangles are sampled as any rasteriser does, except that the sample may lie anywhere in the texel's square; borders
    are drawn conservatively, so that every texel whose square the surface touches has a sample, moved onto the surface
    (idea: J. Hasselgren, T. Akenine-Moeller, L. Ohlsson, "Conservative Rasterization", GPU Gems 2, 2005).
    """

    def __init__(self, context: moderngl.Context, layout: Layout) -> None:
        """Upload the layout; what is made lives as long as the context."""
        self.layout = layout
        self._context = context
        self._bands = bands(layout.width, layout.height, _BAND_TEXELS)
        size = (layout.width, self._bands[0][1])
        self._surface = context.texture(size, 4, dtype="f4")
        self._depth = context.depth_renderbuffer(size)
        self._target = context.framebuffer([self._surface], self._depth)
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

    def coverage(self) -> tuple[Texels, list[Band]]:
        """Return the texels whose square the surface touches, and their bands."""
        layout, found, drawn, total = self.layout, [], [], 0
        for row, rows in self._bands:
            surface = np.frombuffer(self.draw(row, CENTER).read(), np.float32)[: rows * layout.width * 4 : 4]
            inside = in_blocks(np.flatnonzero(surface), layout.width)
            found.append((inside + row * layout.width).astype(np.int32))
            drawn.append(Band(row, rows, slice(total, total + len(inside))))
            total += len(inside)
        return Texels(layout.width, layout.height, np.concatenate(found)), drawn

    def draw(self, row: int, sample_at: tuple[float, float]) -> moderngl.Texture:
        """Draw the band that starts at `row`, sampled at `sample_at` in [0, 1)^2; the target is good until the next."""
        context = self._begin(row, self._fill, self._edge)
        self._fill["sample_at"] = self._edge["sample_at"] = sample_at
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        self._triangles.render(moderngl.TRIANGLES)
        if self._edges:
            self._edges.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(self.layout.borders))
        return self._surface

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        covered = twice = 0
        self._count["sample_at"] = CENTER
        for row, rows in self._bands:
            context = self._begin(row, self._count)
            context.enable_only(moderngl.BLEND)
            context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
            context.blend_func = moderngl.ONE, moderngl.ONE
            self._counted.render(moderngl.TRIANGLES)
            counts = np.frombuffer(self._surface.read(), np.float32)[: rows * self.layout.width * 4 : 4]
            covered += int(np.count_nonzero(counts))
            twice += int(np.count_nonzero(counts > 1.5))
        return twice / covered if covered else 0.0

    def _begin(self, row: int, *programs: moderngl.Program) -> moderngl.Context:
        self._target.use()
        self._target.clear(depth=1.0)
        for program in programs:
            program["origin"] = (0, row)
            program["size"] = self._surface.size
        return self._context
