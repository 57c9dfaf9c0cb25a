"""Near/far maps: the two ends of the occluders along every axis of a batch."""

from dataclasses import dataclass

import moderngl
import numpy as np

from aoprecalc.errors import ArgumentError
from aoprecalc.gl.context import Renderer, compute_program, draw_program
from aoprecalc.mesh.normals import face_normals
from aoprecalc.mesh.unit_sphere import NormalizedSurface
from aoprecalc.progress import Progress
from aoprecalc.raster.samples import Samples, morton_codes
from aoprecalc.types import Float32Array, Float64Array
from aoprecalc.visibility.projection import Projections, convex_hull_points, fit_projections

GRID = 256  # steps a map texel to which vertices are moved: rasterisers do it, and doing it first makes all tiles equal
_MOST_AXES = 8  # of one batch: the gather is compiled for all of them, which takes 0.35 s where no cache has it
_TARGET_BYTES = 1 << 26  # of one batch of maps
_CELL_BYTES = 8  # two 32-bit floats
_SMALL = 16.0  # map texels: triangles without a longer edge are looked through, others are rasterised
_DRAW_LOCAL_SIZE = 64
_RUN = 1 << 21  # small triangles of one call: 65,535 groups of invocations and 128 MB are allowed
_TRIANGLE_BYTES = 36  # its corners
_R32UI = 0x8236  # of OpenGL: the bits of a float as a whole number


class DepthMaps:
    """Tiles, one an axis, of two targets: what is nearest to its positive and its negative end; see map_code.glsl."""

    def __init__(self, context: moderngl.Context, corners: Float32Array, size: int) -> None:
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
            raise ArgumentError(
                "shadow_size", f"is {size}, beyond this renderer; use a smaller one, or auto"
            ) from error
        self._axes = context.buffer(reserve=self.capacity * 5 * 16)
        constants = {"AXES": self.capacity, "GRID": float(GRID)}
        self._small = compute_program(context, __package__, "small.comp.glsl", LOCAL_SIZE=_DRAW_LOCAL_SIZE, **constants)
        self._large = draw_program(context, __package__, "large.vert.glsl", "large.frag.glsl", **constants)
        self._large["target_size"] = shape

        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
        # Like sizes together, as invocations run side by side; within them, neighbours write to the same part of a map.
        sizes = np.ceil(np.log2(np.maximum(longest, 1e-9)))
        order = np.lexsort([morton_codes((511 * (corners.mean(axis=1) + 1)).astype(np.int64)), sizes])
        self._longest = np.maximum.accumulate(longest[order])
        self._corners = context.buffer(np.ascontiguousarray(corners[order]))
        normals = np.repeat(face_normals(corners[order].astype(np.float64))[0], 3, axis=0).astype(np.float32)
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
                self._small.run(-(-count // _DRAW_LOCAL_SIZE))
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

    def _axis_rows(self, projections: Projections) -> Float32Array:
        """What the shaders read for each axis, (capacity, 5, 4) float32: the projection, pitch and floor, the tile."""
        count = len(projections.rows)
        rows = np.zeros((self.capacity, 5, 4))
        rows[:count, :3] = projections.rows
        rows[:count, 3, :2] = projections.pitch
        rows[:count, 3, 2] = projections.below
        rows[:count, 4, :2] = self._origins[:count]
        return rows.astype(np.float32)


# The points that receive light, one under each covered texel, on the renderer, and the sums of what they see.

_GATHER_LOCAL_SIZE = 128
_MOST = 1 << 22  # texels of one store: keeps storage buffers under llvmpipe's 128 MB
_NO_FACE = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class _Store:
    """A run of receivers on the renderer: storage buffers, each with one entry a receiver."""

    texels: slice
    faces: moderngl.Buffer
    points: moderngl.Buffer
    sums: moderngl.Buffer


class ReceiverBuffers:
    """Puts a receiver at each sample, gathers visibility for all of them, and hands back the sums."""

    def __init__(self, context: moderngl.Context, surface: NormalizedSurface, count: int, maps: DepthMaps) -> None:
        """Upload the surface, and make room for `count` receivers that look into `maps`."""
        constants: dict[str, float | str] = {"LOCAL_SIZE": f"{_GATHER_LOCAL_SIZE}u", "NO_FACE": _NO_FACE}
        looks = " ".join(f"look(one, {5 * axis}); look(other, {5 * axis});" for axis in range(maps.capacity))
        self._context = context
        self._receive = compute_program(context, __package__, "receive.comp.glsl", **constants)
        self._gather = compute_program(
            context,
            __package__,
            "gather.comp.glsl",
            **constants | {"AXES": maps.capacity, "EACH_AXIS": looks, "GRID": float(GRID)},
        )
        self._gather["most_turns"] = 4
        self._maps = maps
        self._surface = [
            context.buffer(np.ascontiguousarray(array))
            for array in (
                surface.positions,
                surface.faces.astype(np.uint32),
                surface.shading_normals,
                surface.geometric_normals,
            )
        ]
        self._stores = [self._store(slice(start, min(start + _MOST, count))) for start in range(0, count, _MOST)]
        self._weights = context.buffer(reserve=min(count, _MOST) * 8)  # of one store at a time
        self._placed = 0  # receivers

    def place(self, samples: Samples) -> None:
        """Put receivers at the samples, as many as there is room for or fewer, and their sums to zero."""
        self._placed = len(samples.faces)
        for binding, buffer in enumerate(self._surface):
            buffer.bind_to_storage_buffer(binding)
        for store in self._stores:
            store.faces.write(np.ascontiguousarray(samples.faces[store.texels]))  # -1 is NO_FACE
            self._weights.write(np.ascontiguousarray(samples.weights[store.texels, 1:]))
            for binding, buffer in enumerate((store.faces, self._weights, store.points, store.sums), 4):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._receive, store)

    def gather(self) -> None:
        """Add what every receiver sees along the axes that the maps hold at present."""
        self._maps.bind()
        self._surface[3].bind_to_storage_buffer(3)
        for store in self._stores:
            for binding, buffer in ((1, store.points), (2, store.faces), (4, store.sums)):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._gather, store, 2)

    def sums(self) -> Float32Array:
        """Return the sums since `place`, (k, 2) float32: weight of what is visible, and of all."""
        sums = np.empty((self._placed, 2), np.float32)
        for store in self._stores:
            if self._count(store):
                found = np.frombuffer(store.sums.read(), np.float32).reshape(-1, 2)
                sums[store.texels] = found[: self._count(store)]
        return sums

    def _run(self, program: moderngl.ComputeShader, store: _Store, each: int = 1) -> None:
        """Run a program of which an invocation takes `each` texels."""
        count = self._count(store)
        if count:
            program["texel_count"] = count
            program.run(-(-count // (each * _GATHER_LOCAL_SIZE)))
            self._context.memory_barrier()

    def _count(self, store: _Store) -> int:
        """How many receivers are placed in a store."""
        count: int = min(store.texels.stop, self._placed) - store.texels.start
        return max(0, count)

    def _store(self, texels: slice) -> _Store:
        count = texels.stop - texels.start
        return _Store(texels, *(self._context.buffer(reserve=count * size) for size in (4, 16, 8)))


# Visibility by near/far maps in OpenGL.
#
# The method is the source's (a shadow map for each direction, compared in texture space), with one pass for a direction
# and its opposite, and a comparison of planes instead of depths.


class DepthMapTester:
    """An Observer that draws maps and reads them at the samples; see gather.comp.glsl."""

    def __init__(self, renderer: Renderer, surface: NormalizedSurface, most: int, shadow_size: int) -> None:
        """Make room for `most` samples at a time and for maps of `shadow_size` texels a side."""
        self._outline = convex_hull_points(surface.bounding_points.astype(np.float64))
        self._size, self._floor = shadow_size, surface.ground_normal
        self._maps = DepthMaps(renderer.context, surface.occluders, shadow_size)
        self._receivers = ReceiverBuffers(renderer.context, surface, most, self._maps)

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        self._receivers.place(samples)
        projections = fit_projections(axes, self._outline, self._size, self._floor)
        small = self._maps.small(projections)
        for start in range(0, len(axes), self._maps.capacity):
            batch = projections.select(slice(start, start + self._maps.capacity))
            self._maps.draw(batch, small)
            self._receivers.gather()
            progress.advance(2 * len(batch.rows))
        return self._receivers.sums()
