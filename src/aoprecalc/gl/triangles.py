"""Triangles drawn in OpenGL for pictures: which one each sample sees, and where they keep light from the ground."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.gl.context import Renderer, draw_program
from aoprecalc.types import Float32Array, Float64Array, Int32Array

_PACKAGE = "aoprecalc.gl"


class TriangleDrawer:
    """The triangles of a mesh in an OpenGL context; both their sides are visible and cast shadows."""

    def __init__(self, renderer: Renderer, corners: Float32Array, casters: Float32Array) -> None:
        """Upload the triangles that are seen, (o, 3, 3) float32 corners, and those that cast shadows, (s, 3, 3)."""
        self._context = renderer.context
        self._corners, self._casters = (
            self._context.buffer(np.ascontiguousarray(triangles, np.float32)) for triangles in (corners, casters)
        )
        self.max_size = int(self._context.info["GL_MAX_TEXTURE_SIZE"])

    def visible(self, matrix: Float64Array, width: int, height: int) -> Int32Array:
        """Return the index of the triangle that each sample sees, (height, width) int32; -1 where there is none.

        matrix   (4, 4): from positions to clip space; row 0 is at y = -1

        A visibility buffer: C. Burns, W. Hunt, "The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading",
        Journal of Computer Graphics Techniques 2(2), 2013.
        """
        import moderngl  # in functions: it is installed on Linux only

        program = draw_program(self._context, _PACKAGE, "visible.vert.glsl", "visible.frag.glsl")
        program["clip"] = tuple(matrix.T.ravel())
        indices = np.empty((height, width), np.int32)
        with self._drawing_to(indices, "i4", far=1.0):
            self._context.enable_only(moderngl.DEPTH_TEST)
            self._context.depth_func = "<"
            self._context.vertex_array(program, self._corners, "in_position").render(moderngl.TRIANGLES)
        indices -= 1
        return indices

    def count_shadows(self, directions: Float64Array, ground: float, window: Float64Array, size: int) -> Float32Array:
        """Return how many of the directions towards light are blocked at points of the ground, (size, size) float32.

        directions   (d, 3) unit vectors, y > 0
        ground       the height y of the ground
        window       x and z of the first corner of the square, and its side, (3,); rows along z, columns along x
        """
        import moderngl

        context = self._context
        program = draw_program(context, _PACKAGE, "shadow.vert.glsl", "shadow.frag.glsl")
        program["ground"] = ground
        program["window"] = tuple(window)
        shadows = context.vertex_array(program, self._casters, "in_position")
        counts = np.empty((size, size), np.float32)
        with self._drawing_to(counts, "f4", far=0.0):
            # Each direction is drawn at a depth of its own, nearer than all before: its first fragment in a pixel alone
            # passes the depth test, and counts.
            context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
            context.depth_func = ">"
            context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
            context.blend_func = moderngl.ONE, moderngl.ONE
            for number, direction in enumerate(directions):
                program["light"] = tuple(direction)
                program["depth"] = 2 * (number + 1) / (len(directions) + 1) - 1
                shadows.render(moderngl.TRIANGLES)
        return counts

    @contextmanager
    def _drawing_to(self, pixels: NDArray[Any], dtype: str, far: float) -> Iterator[None]:
        """Draw into a target of zeros with depths `far`; at the end read it into (h, w) pixels and free its memory."""
        size = pixels.shape[1], pixels.shape[0]
        target, depths = self._context.texture(size, 1, dtype=dtype), self._context.depth_renderbuffer(size)
        framebuffer = self._context.framebuffer([target], depths)
        framebuffer.use()
        framebuffer.clear(depth=far)
        yield
        target.read_into(pixels)
        del framebuffer, depths, target
        self._context.gc()
