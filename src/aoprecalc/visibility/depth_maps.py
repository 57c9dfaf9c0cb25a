"""Visibility by depth maps in OpenGL: a near and a far depth for every axis of a batch, compared at the samples.

The method is that of Précalcul, section 1.1.2 (a shadow map for each direction, compared in texture space), with one
pass for a direction and its opposite, and a comparison of planes instead of depths. An axis is a pair of opposite light
directions, given by one unit vector.
"""

from dataclasses import dataclass

import moderngl
import numpy as np

from aoprecalc.errors import ArgumentError
from aoprecalc.gl.context import Renderer, compute_program, draw_program
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.surface import face_normals
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples, morton_codes
from aoprecalc.types import REVERSED_WINDING, Float32Array, Float64Array
from aoprecalc.visibility.directions import Projections, convex_hull_points, fit_projections
from aoprecalc.visibility.integrand import Integrand

# Steps in a map texel to which vertices are snapped: rasterizers do it, and doing it first makes all tiles equal.
GRID = 256
_MAX_BATCH_AXES = 8  # the gather shader is unrolled for all of them: compiling takes 0.35 s where it is not cached
_MAX_BATCH_BYTES = 1 << 26  # of the depth maps of one batch
_MAP_TEXEL_BYTES = 8  # two 32-bit floats
_SMALL = 16.0  # map texels: triangles without a longer edge go to the compute shader, others to the rasterizer
_SMALL_LOCAL_SIZE = 64
_MAX_SMALL_TRIANGLES = 1 << 21  # in one dispatch: 65,535 work groups and buffers of 128 MB are allowed
_TRIANGLE_BYTES = 36  # of its corners
_R32UI = 0x8236  # of OpenGL: the bits of a float as an unsigned integer
_READ_LOCAL_SIZE = 128
_NOTHING = -2.0  # instead of a depth, which lies in [-1, 1]


class DepthMaps:
    """Two targets, one tile for each axis: the depths nearest to its positive and negative end; see map_code.glsl."""

    def __init__(
        self, context: moderngl.Context, corners: Float32Array, size: int, *, clip: bool = False, one_sided: int = 0
    ) -> None:
        """Upload occluders, (o, 3, 3) float32 corners.

        size        a map's side in texels
        clip        occluders may lie beyond the maps
        one_sided   how many of the occluders, the first ones, occlude only what is in front of them
        """
        if one_sided:
            corners = np.concatenate([corners, corners[one_sided:, REVERSED_WINDING]])
        limit = context.info["GL_MAX_TEXTURE_SIZE"] // size
        tiles = max(1, min(_MAX_BATCH_BYTES // (_MAP_TEXEL_BYTES * size * size), limit * limit, _MAX_BATCH_AXES))
        columns = 2 ** (tiles.bit_length() // 2)
        self.capacity = 2 ** (tiles.bit_length() - 1)
        self._tile_origins = size * np.column_stack(np.divmod(np.arange(self.capacity), columns)[::-1])
        target_size = (size * columns, size * (self.capacity // columns))
        self._context, self._size, self._clip = context, size, clip
        self._textures = [context.texture(target_size, 1, dtype="f4") for _ in range(2)]
        try:
            self._target = context.framebuffer(self._textures)
        except moderngl.Error as error:
            raise ArgumentError(
                "shadow_size", f"is {size}, beyond this renderer; use a smaller one, or auto"
            ) from error
        self._axes = context.buffer(reserve=self.capacity * 5 * 16)
        fronts_only = "true" if one_sided else "false"
        constants = {"AXES": self.capacity, "GRID": float(GRID), "FRONTS_ONLY": fronts_only}
        self._small = compute_program(
            context, __package__, "small.comp.glsl", LOCAL_SIZE=_SMALL_LOCAL_SIZE, **constants
        )
        self._small["last_texel"] = size - 1.0
        self._large = draw_program(context, __package__, "large.vert.glsl", "large.frag.glsl", **constants)
        self._target_size = target_size

        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
        # Like sizes together, as invocations run side by side; within them, neighbours write to the same part of a map.
        sizes = np.ceil(np.log2(np.maximum(longest, 1e-9)))
        order = np.lexsort([morton_codes(np.clip(511 * (corners.mean(axis=1) + 1), 0, 1022).astype(np.int64)), sizes])
        self._longest = np.maximum.accumulate(longest[order])
        self._corners = context.buffer(np.ascontiguousarray(corners[order]))
        normals = np.repeat(face_normals(corners[order].astype(np.float64))[0], 3, axis=0).astype(np.float32)
        attributes = [(self._corners, "3f", "in_position"), (context.buffer(normals), "3f", "in_normal")]
        self._triangles = context.vertex_array(self._large, attributes)

    def count_small(self, projections: Projections) -> int:
        """Return how many triangles are small along all axes of a group, so that no result depends on the batches."""
        return int(np.searchsorted(self._longest, _SMALL * projections.pitch.min()))

    def render(self, projections: Projections, small: int, radiance: Float64Array | None = None) -> None:
        """Render the maps of at most `capacity` projections; they stay until the next call. See `count_small`.

        radiance   (a, 2): of the sky, from the positive and from the negative end of each axis; None: 1
        """
        self._axes.write(self._axis_rows(projections, radiance))
        self._target.use()
        self._target.clear()
        self._context.memory_barrier()  # the images below are the textures of the target
        self.bind()
        for start in range(0, small, _MAX_SMALL_TRIANGLES):
            count = min(small - start, _MAX_SMALL_TRIANGLES)
            self._corners.bind_to_storage_buffer(0, offset=start * _TRIANGLE_BYTES, size=count * _TRIANGLE_BYTES)
            self._small["triangle_count"] = count
            for axis in range(len(projections.rows)):
                self._small["axis"] = 5 * axis
                self._small.run(-(-count // _SMALL_LOCAL_SIZE))
        self._context.memory_barrier()  # before blending with what was stored
        if small < len(self._longest):
            self._context.enable_only(moderngl.BLEND)
            self._context.blend_equation = moderngl.MAX, moderngl.MAX
            self._render_large(projections, small)
            self._context.memory_barrier()  # before the images are read

    def _render_large(self, projections: Projections, small: int) -> None:
        """Rasterize the triangles that are not small: into all tiles at once, unless some may leave theirs."""
        count = len(projections.rows)
        vertices, draw = 3 * (len(self._longest) - small), self._triangles.render
        self._large["first_axis"] = 0
        self._large["viewport_size"], self._large["has_tiles"] = self._target_size, 1.0
        if not self._clip:
            draw(moderngl.TRIANGLES, vertices, first=3 * small, instances=count)
            return
        self._large["viewport_size"], self._large["has_tiles"] = (self._size, self._size), 0.0
        for axis, (left, low) in enumerate(self._tile_origins[:count].tolist()):
            # Scissors too: viewports may clip later than at their edges.
            self._target.viewport = self._target.scissor = left, low, self._size, self._size
            self._large["first_axis"] = axis
            draw(moderngl.TRIANGLES, vertices, first=3 * small)
        self._target.viewport = self._target.scissor = 0, 0, *self._target_size

    def read(self) -> Float32Array:
        """Return the depths of the first map that was rendered last, (2, size, size) float32; see `read_depths`."""
        program = compute_program(
            self._context, __package__, "depths.comp.glsl", LOCAL_SIZE=_READ_LOCAL_SIZE, NOTHING=_NOTHING
        )
        texels = self._size * self._size
        depths = self._context.buffer(reserve=texels * 8)
        self.bind()
        depths.bind_to_storage_buffer(0)
        program["size"] = self._size
        program.run(-(-texels // _READ_LOCAL_SIZE))
        self._context.memory_barrier()
        pairs = np.frombuffer(depths.read(), np.float32).reshape(self._size, self._size, 2)
        return np.where(pairs == _NOTHING, np.float32(np.nan), pairs).transpose(2, 0, 1)

    def bind(self) -> None:
        """Bind the maps as images 0 and 1, and their axes as uniform block 0."""
        self._axes.bind_to_uniform_block(0)
        for unit, texture in enumerate(self._textures):
            texture.bind_to_image(unit, format=_R32UI)

    def _axis_rows(self, projections: Projections, radiance: Float64Array | None) -> Float32Array:
        """Lay out uniform block 0, (capacity, 5, 4) float32: projection (3 rows); pitch, below; tile, radiance."""
        count = len(projections.rows)
        rows = np.zeros((self.capacity, 5, 4))
        rows[:count, :3] = projections.rows
        rows[:count, 3, :2] = projections.pitch
        rows[:count, 3, 2] = projections.below
        rows[:count, 4, :2] = self._tile_origins[:count]
        rows[:count, 4, 2:] = 1.0 if radiance is None else radiance
        return rows.astype(np.float32)


_GATHER_LOCAL_SIZE = 128
_MAX_STORE_TEXELS = 1 << 22  # keeps storage buffers under llvmpipe's 128 MB
_NO_FACE = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class _Store:
    """A slice of the receivers on the renderer: storage buffers with one entry for each."""

    texels: slice
    faces: moderngl.Buffer
    points: moderngl.Buffer
    sums: moderngl.Buffer


class ReceiverBuffers:
    """The points that receive light, one for each sample, on the renderer, and their visibility sums."""

    def __init__(
        self,
        context: moderngl.Context,
        surface: NormalizedSurface,
        integrand: Integrand,
        count: int,
        maps: DepthMaps,
    ) -> None:
        """Upload the surface, and allocate `count` receivers, which are tested against `maps`."""
        constants: dict[str, float | str] = {
            "LOCAL_SIZE": f"{_GATHER_LOCAL_SIZE}u",
            "NO_FACE": _NO_FACE,
            "COLUMNS": f"{integrand.columns}u",
        }
        each_axis = " ".join(f"addAxis(one, {5 * axis}); addAxis(other, {5 * axis});" for axis in range(maps.capacity))
        self._context, self._columns = context, integrand.columns
        self._receive = compute_program(context, __package__, "receive.comp.glsl", **constants)
        self._gather = compute_program(
            context,
            __package__,
            "gather.comp.glsl",
            **constants,
            AXES=maps.capacity,
            EACH_AXIS=each_axis,
            FRONTS_ONLY="true" if surface.one_sided else "false",
            GRID=float(GRID),
            WEIGHT="cosine" if integrand.weight == "cosine" else "1.0",
            MIN_COSINE=integrand.min_cosine,
            SKY="false" if integrand.sky is None else "true",
        )
        self._gather["max_taps"] = 4
        self._maps = maps
        arrays = surface.positions, surface.faces.astype(np.uint32), surface.shading_normals, surface.geometric_normals
        self._surface = [context.buffer(np.ascontiguousarray(array)) for array in arrays]
        step = _MAX_STORE_TEXELS
        self._stores = [self._allocate(slice(start, min(start + step, count))) for start in range(0, count, step)]
        self._weights = context.buffer(reserve=min(count, step) * 8)  # of one store at a time
        self._used = 0  # receivers

    def place(self, samples: Samples) -> None:
        """Place receivers at samples, at most as many as were allocated, and set their sums to zero."""
        self._used = len(samples.faces)
        for binding, buffer in enumerate(self._surface):
            buffer.bind_to_storage_buffer(binding)
        for store in self._stores:
            store.faces.write(np.ascontiguousarray(samples.faces[store.texels]))  # -1 is NO_FACE
            self._weights.write(np.ascontiguousarray(samples.weights[store.texels, 1:]))
            for binding, buffer in enumerate((store.faces, self._weights, store.points, store.sums), 4):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._receive, store)

    def gather(self) -> None:
        """Add the visibility of every receiver along the axes of the maps that were rendered last."""
        self._maps.bind()
        self._surface[3].bind_to_storage_buffer(3)
        for store in self._stores:
            for binding, buffer in ((1, store.points), (2, store.faces), (4, store.sums)):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._gather, store, 2)

    def read_sums(self) -> Float32Array:
        """Return the sums since `place`, (k, 2) or (k, 5) float32; see VisibilityTester."""
        sums = np.empty((self._used, self._columns), np.float32)
        for store in self._stores:
            if self._count(store):
                stored = np.frombuffer(store.sums.read(), np.float32).reshape(-1, self._columns)
                sums[store.texels] = stored[: self._count(store)]
        return sums

    def _run(self, program: moderngl.ComputeShader, store: _Store, texels_each: int = 1) -> None:
        """Run a program of which an invocation takes `texels_each` texels."""
        count = self._count(store)
        if count:
            program["texel_count"] = count
            program.run(-(-count // (texels_each * _GATHER_LOCAL_SIZE)))
            self._context.memory_barrier()

    def _count(self, store: _Store) -> int:
        """Return how many receivers of a store are in use."""
        count: int = min(store.texels.stop, self._used) - store.texels.start
        return max(0, count)

    def _allocate(self, texels: slice) -> _Store:
        count = texels.stop - texels.start
        sizes = 4, 16, 4 * self._columns
        return _Store(texels, *(self._context.buffer(reserve=count * size) for size in sizes))


class DepthMapTester:
    """A VisibilityTester that renders depth maps and reads them at the samples; see gather.comp.glsl."""

    def __init__(
        self, renderer: Renderer, surface: NormalizedSurface, integrand: Integrand, max_samples: int, shadow_size: int
    ) -> None:
        """Allocate for `max_samples` at a time and for maps of `shadow_size` texels a side."""
        self._hull = convex_hull_points(surface.receiving_points.astype(np.float64))
        self._shadow_size, self._surface, self._integrand = shadow_size, surface, integrand
        self._maps = DepthMaps(
            renderer.context,
            surface.occluders,
            shadow_size,
            clip=surface.has_outer_occluders,
            one_sided=surface.one_sided,
        )
        self._receivers = ReceiverBuffers(renderer.context, surface, integrand, max_samples, self._maps)

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        self._receivers.place(samples)
        projections = fit_projections(axes, self._hull, self._shadow_size, self._surface.ground_normal)
        small = self._maps.count_small(projections)
        radiance = np.stack([self._integrand.radiance(end) for end in (axes, -axes)], axis=1)
        for start in range(0, len(axes), self._maps.capacity):
            chosen = slice(start, start + self._maps.capacity)
            batch = projections.select(chosen)
            self._maps.render(batch, small, radiance[chosen])
            self._receivers.gather()
            progress.advance(2 * len(batch.rows))
        sums = self._receivers.read_sums()
        if self._surface.buried:
            under = self._surface.is_under_ground(self._surface.points(samples.faces, samples.weights))
            sums[np.ix_(under, np.arange(sums.shape[1]) != 1)] = 0  # all but the weight of all directions
        return sums


def read_depths(context: moderngl.Context, occluders: Float32Array, projection: Projections, size: int) -> Float32Array:
    """Return the depths of occluders along one axis, see `Backend.depths`."""
    maps = DepthMaps(context, occluders, size)
    maps.render(projection, maps.count_small(projection))
    return maps.read()
