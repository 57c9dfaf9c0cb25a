"""Near/far maps: the two ends of the occluders along every axis of a batch, in one pass over the triangles."""

import moderngl
import numpy as np

from aoprecalc.errors import UsageError
from aoprecalc.gl.programs import draw_program
from aoprecalc.model import Floats, Ints
from aoprecalc.occlusion.projection import Projections

GRID = 256  # steps a map texel to which vertices are moved: rasterisers do it, and doing it first makes all tiles equal
_TARGET_BYTES = 1 << 25  # of one batch of maps
_CELL_BYTES = 8  # two 32-bit floats
_MOST_AXES = 8  # of one batch: the gather is compiled for all of them, 16 take half a second
_EMPTY = -3e38  # lies behind everything, seen from either end


class NearFarMaps:
    """Tiles of one two-channel target, one an axis; blending keeps the occluders at both ends (see map_code.glsl)."""

    def __init__(self, context: moderngl.Context, positions: Floats, faces: Ints, size: int) -> None:
        """Upload occluders, (v, 3) positions about the origin and within 1 of it; `size` is a map's side in texels."""
        limit = context.info["GL_MAX_TEXTURE_SIZE"] // size
        tiles = max(1, min(_TARGET_BYTES // (_CELL_BYTES * size * size), limit * limit, _MOST_AXES))
        across = 2 ** (tiles.bit_length() // 2)
        self.capacity = 2 ** (tiles.bit_length() - 1)
        self._origins = size * np.column_stack(np.divmod(np.arange(self.capacity), across)[::-1])
        shape = (size * across, size * (self.capacity // across))
        self._context = context
        self.texture = context.texture(shape, 2, dtype="f4")
        try:
            self._target = context.framebuffer([self.texture])
        except moderngl.Error as error:
            raise UsageError(f"--shadow-size {size} is beyond this renderer; use a smaller one, or auto") from error
        self.axes = context.buffer(reserve=self.capacity * 5 * 16)
        self._program = draw_program(
            context, __package__, "near_far.vert.glsl", "near_far.frag.glsl", AXES=self.capacity, GRID=float(GRID)
        )
        self._program["target_size"] = shape
        self._mesh = context.vertex_array(
            self._program,
            [(context.buffer(np.ascontiguousarray(positions, np.float32)), "3f", "in_position")],
            index_buffer=context.buffer(np.ascontiguousarray(faces, np.uint32)),
        )

    def draw(self, projections: Projections) -> None:
        """Draw the maps of at most `capacity` projections; they stay in `texture` and `axes` until the next call."""
        self.axes.write(self._axis_rows(projections))
        self._target.use()
        self._target.clear(_EMPTY, _EMPTY)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_equation = moderngl.MAX, moderngl.MAX
        self.axes.bind_to_uniform_block(0)
        self._mesh.render(moderngl.TRIANGLES, instances=len(projections.rows))

    def _axis_rows(self, projections: Projections) -> Floats:
        """What the shaders read for each axis, (capacity, 5, 4) float32: the projection, the pitch, and the tile."""
        count = len(projections.rows)
        rows = np.zeros((self.capacity, 5, 4))
        rows[:count, :3] = projections.rows
        rows[:count, 3, :2] = projections.pitch
        rows[:count, 4, :2] = self._origins[:count]
        return rows.astype(np.float32)
