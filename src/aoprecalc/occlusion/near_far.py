"""Near/far maps: the two ends of the occluders along every axis of a batch."""

import moderngl
import numpy as np

from aoprecalc.errors import UsageError
from aoprecalc.gl.programs import compute_program, draw_program
from aoprecalc.model import Floats
from aoprecalc.occlusion.projection import Projections
from aoprecalc.surface.normals import face_directions
from aoprecalc.surface.z_order import z_order

GRID = 256  # steps a map texel to which vertices are moved: rasterisers do it, and doing it first makes all tiles equal
_MOST_AXES = 8  # of one batch: the gather is compiled for all of them, which takes 0.35 s where no cache has it
_TARGET_BYTES = 1 << 26  # of one batch of maps
_CELL_BYTES = 8  # two 32-bit floats
_SMALL = 16.0  # map texels: triangles without a longer edge are looked through, others are rasterised
_LOCAL_SIZE = 64
_RUN = 1 << 21  # small triangles of one call: 65,535 groups of invocations and 128 MB are allowed
_TRIANGLE_BYTES = 36  # its corners
_R32UI = 0x8236  # of OpenGL: the bits of a float as a whole number


class NearFarMaps:
    """Tiles, one an axis, of two targets: what is nearest to its positive and its negative end; see map_code.glsl."""

    def __init__(self, context: moderngl.Context, corners: Floats, size: int) -> None:
        """Upload occluders, (o, 3, 3) float32 corners within 1 of the origin; `size` is a map's side in texels."""
        limit = context.info["GL_MAX_TEXTURE_SIZE"] // size
        tiles = max(1, min(_TARGET_BYTES // (_CELL_BYTES * size * size), limit * limit, _MOST_AXES))
        across = 2 ** (tiles.bit_length() // 2)
        self.capacity = 2 ** (tiles.bit_length() - 1)
        self._origins = size * np.column_stack(np.divmod(np.arange(self.capacity), across)[::-1])
        shape = (size * across, size * (self.capacity // across))
        self._context = context
        self._ends = [context.texture(shape, 1, dtype="f4") for _ in range(2)]
        try:
            self._target = context.framebuffer(self._ends)
        except moderngl.Error as error:
            raise UsageError(f"--shadow-size {size} is beyond this renderer; use a smaller one, or auto") from error
        self._axes = context.buffer(reserve=self.capacity * 5 * 16)
        constants = {"AXES": self.capacity, "GRID": float(GRID)}
        self._small = compute_program(context, __package__, "small.comp.glsl", LOCAL_SIZE=_LOCAL_SIZE, **constants)
        self._large = draw_program(context, __package__, "large.vert.glsl", "large.frag.glsl", **constants)
        self._large["target_size"] = shape

        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
        # Like sizes together, as invocations run side by side; within them, neighbours write to the same part of a map.
        sizes = np.ceil(np.log2(np.maximum(longest, 1e-9)))
        order = np.lexsort([z_order((511 * (corners.mean(axis=1) + 1)).astype(np.int64)), sizes])
        self._longest = np.maximum.accumulate(longest[order])
        self._corners = context.buffer(np.ascontiguousarray(corners[order]))
        normals = np.repeat(face_directions(corners[order].astype(np.float64))[0], 3, axis=0).astype(np.float32)
        of_corners = [(self._corners, "3f", "in_position"), (context.buffer(normals), "3f", "in_normal")]
        self._triangles = context.vertex_array(self._large, of_corners)

    def small(self, projections: Projections) -> int:
        """Return how many triangles are looked through: for all axes of a group, so that batches change nothing."""
        return int(np.searchsorted(self._longest, _SMALL * projections.pitch.min()))

    def draw(self, projections: Projections, small: int) -> None:
        """Draw the maps of at most `capacity` projections; they stay until the next call. See `small`."""
        self._axes.write(self._axis_rows(projections))
        self._target.use()
        self._target.clear()
        self._context.memory_barrier()  # the images below are the target's textures
        self.bind()
        for start in range(0, small, _RUN):
            count = min(small - start, _RUN)
            self._corners.bind_to_storage_buffer(0, offset=start * _TRIANGLE_BYTES, size=count * _TRIANGLE_BYTES)
            self._small["triangle_count"] = count
            for axis in range(len(projections.rows)):
                self._small["axis"] = 5 * axis
                self._small.run(-(-count // _LOCAL_SIZE))
        self._context.memory_barrier()  # blending must find what they have kept
        if small < len(self._longest):
            self._context.enable_only(moderngl.BLEND)
            self._context.blend_equation = moderngl.MAX, moderngl.MAX
            left = 3 * (len(self._longest) - small)
            self._triangles.render(moderngl.TRIANGLES, left, first=3 * small, instances=len(projections.rows))
            self._context.memory_barrier()  # and who reads the images, both

    def bind(self) -> None:
        """Let shaders read the maps, as images 0 and 1, and their axes, as uniform block 0."""
        self._axes.bind_to_uniform_block(0)
        for unit, end in enumerate(self._ends):
            end.bind_to_image(unit, format=_R32UI)

    def _axis_rows(self, projections: Projections) -> Floats:
        """What the shaders read for each axis, (capacity, 5, 4) float32: the projection, pitch and floor, the tile."""
        count = len(projections.rows)
        rows = np.zeros((self.capacity, 5, 4))
        rows[:count, :3] = projections.rows
        rows[:count, 3, :2] = projections.pitch
        rows[:count, 3, 2] = projections.below
        rows[:count, 4, :2] = self._origins[:count]
        return rows.astype(np.float32)
