"""Visibility by tracing rays with Embree: slower than depth maps, exact, and without OpenGL."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from aoprecalc.errors import RendererError
from aoprecalc.system import whole_cores
from aoprecalc.types import BoolArray, Float32Array, Int32Array
from aoprecalc.visibility.directions import Projections
from aoprecalc.visibility.embree import OcclusionScene, casts_packets

_CHUNK_RAYS = 1 << 18  # that a thread casts at a time
_PACKED_RAYS = 1 << 19  # from which numba, which casts packets, is worth the half second that it takes to load
FAR = 1e30  # Embree gives more where a ray hits nothing
_MAX_BACKS = 100  # of triangles that a ray passes from behind; beyond so many it sees nothing
_PAST = 2e-6  # behind such a triangle, as a share of 1 and the way so far, the ray goes on: 32-bit floats tell it apart
_ABOVE = 1.5  # distance from the origin at which rays along an axis start, outside the unit sphere


def embreex_problem() -> str | None:
    """Return why rays cannot be traced here and what to do, or None where they can."""
    if find_spec("embreex") is None:
        return "embreex, which traces rays, is not installed; `pip install embreex` (none for Linux or Windows on ARM)"
    try:
        import_module("embreex.rtcore_scene")
    except ImportError as error:
        return f"embreex, which traces rays, cannot be loaded ({error}); install it again"
    return None


def require_embreex() -> None:
    """Raise RendererError where rays cannot be traced."""
    problem = embreex_problem()
    if problem is not None:
        raise RendererError(problem)


class RayCaster:
    """The triangles of a mesh in an Embree scene."""

    def __init__(self, corners: Float32Array, threads: int = 0, one_sided: int = 0) -> None:
        """Build over triangles, (o, 3, 3) float32 corners; `threads` cast rays, 0 is one for each core.

        one_sided   how many of them, the first ones, do not stop rays from behind, for `occluded` and `distances`
        Raises RendererError where rays cannot be traced.
        """
        require_embreex()
        # The scene does not keep its vertices alive.
        self._vertices = np.ascontiguousarray(corners.reshape(-1, 3), np.float32)
        self._threads, self._one_sided = threads or whole_cores(), one_sided

    @cached_property
    def _scene(self) -> Any:
        """The scene that embreex casts single rays at."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        TriangleMesh(scene, self._vertices, np.arange(len(self._vertices), dtype=np.int32).reshape(-1, 3))
        return scene

    @cached_property
    def _packed_scene(self) -> OcclusionScene:
        """The scene for packets of rays."""
        return OcclusionScene(self._vertices.reshape(-1, 3, 3))

    def occluded(self, origins: Float32Array, directions: Float32Array, max_distance: float = FAR) -> BoolArray:
        """Return which of k rays hit a triangle nearer than `max_distance`, (k,) bool.

        origins      (k, 3) float32
        directions   (k, 3) float32, or (1, 3) for parallel rays
        """
        if self._one_sided:
            return ~np.isnan(self.distances(origins, directions, max_distance))
        if len(origins) >= _PACKED_RAYS and casts_packets():
            from aoprecalc.visibility.packets import occluded

            return occluded(self._packed_scene, origins, directions, max_distance, self._threads)
        hits = np.empty(len(origins), bool)

        def cast(start: int) -> None:
            chunk = slice(start, start + _CHUNK_RAYS)
            along = directions if len(directions) == 1 else directions[chunk]
            hits[chunk] = self._scene.run(origins[chunk], along, max_distance, query="OCCLUDED") >= 0

        self._for_chunks(cast, len(origins))
        return hits

    def first_hits(self, origin: Float32Array, directions: Float32Array) -> Int32Array:
        """Return the index of the triangle that each of k rays hits first, (k,) int32; -1 where it hits none.

        origin       (3,) float32, of all rays
        directions   (k, 3) float32
        """
        hits = np.empty(len(directions), np.int32)
        origins = np.tile(origin, (min(len(directions), _CHUNK_RAYS), 1))

        def cast(start: int) -> None:
            along = directions[start : start + _CHUNK_RAYS]
            hits[start : start + _CHUNK_RAYS] = self._scene.run(origins[: len(along)], along, query="INTERSECT")

        self._for_chunks(cast, len(directions))
        return hits

    def below(self, positions: Float32Array) -> Int32Array:
        """Return the index of a triangle under each of (k, 2) positions x, y, (k,) int32; -1 where there is none."""
        origins = np.column_stack([positions, np.ones(len(positions), np.float32)])
        hits, down = np.empty(len(positions), np.int32), np.array([[0, 0, -1]], np.float32)

        def cast(start: int) -> None:
            chunk = slice(start, start + _CHUNK_RAYS)
            hits[chunk] = self._scene.run(origins[chunk], down, query="INTERSECT")

        self._for_chunks(cast, len(positions))
        return hits

    def distances(self, origins: Float32Array, directions: Float32Array, max_distance: float = FAR) -> Float32Array:
        """Return how far k rays go until a triangle nearer than `max_distance` stops them, (k,) float32; else NaN.

        origins      (k, 3) float32
        directions   (k, 3) float32 unit vectors, or (1, 3) for parallel rays
        """
        lengths = np.empty(len(origins), np.float32)

        def cast(start: int) -> None:
            chunk = slice(start, start + _CHUNK_RAYS)
            along = directions if len(directions) == 1 else directions[chunk]
            if self._one_sided:
                lengths[chunk] = self._to_fronts(origins[chunk], along, max_distance)
            else:
                lengths[chunk] = self._scene.run(origins[chunk], along, max_distance, query="DISTANCE")

        self._for_chunks(cast, len(origins))
        lengths[lengths >= min(max_distance, FAR)] = np.nan
        return lengths

    def _to_fronts(self, origins: Float32Array, directions: Float32Array, max_distance: float) -> Float32Array:
        """Return how far rays go, see `distances`, on past the triangles that they meet from behind; else 2e30."""
        lengths, passed = np.full(len(origins), 2 * FAR, np.float32), np.zeros(len(origins), np.float32)
        waiting = np.arange(len(origins))
        for _ in range(_MAX_BACKS):
            along = directions if len(directions) == 1 else directions[waiting]
            start = origins[waiting] + passed[waiting, None] * along
            hits = self._scene.run(start, along, np.float32(max_distance) - passed[waiting], "INTERSECT", output=1)
            behind = (hits["primID"] < self._one_sided) & ((hits["Ng"] * along).sum(axis=1) > 0)
            stopped = (hits["primID"] >= 0) & ~behind
            lengths[waiting[stopped]] = passed[waiting[stopped]] + hits["tfar"][stopped]
            passed[waiting[behind]] += hits["tfar"][behind] + _PAST * (1 + passed[waiting[behind]])
            waiting = waiting[behind]
            if not len(waiting):
                break
        return lengths

    def meets(
        self, origins: Float32Array, directions: Float32Array, lengths: Float32Array
    ) -> tuple[Int32Array, Float32Array, Float32Array]:
        """Return where k rays meet a triangle first: which, -1 for none; how far away; and where in it.

        origins      (k, 3) float32
        directions   (k, 3) float32 unit vectors
        lengths      (k,) float32, of the rays
        The triangles are (k,) int32, the distances (k,) float32, the places (k, 3) float32 barycentric weights.
        """
        triangles, distances = np.empty(len(origins), np.int32), np.empty(len(origins), np.float32)
        weights = np.empty((len(origins), 3), np.float32)

        def cast(start: int) -> None:
            chunk = slice(start, start + _CHUNK_RAYS)
            met = self._scene.run(origins[chunk], directions[chunk], lengths[chunk], query="INTERSECT", output=1)
            triangles[chunk], distances[chunk] = met["primID"], met["tfar"]
            weights[chunk] = np.column_stack([1 - met["u"] - met["v"], met["u"], met["v"]])

        self._for_chunks(cast, len(origins))
        return triangles, distances, weights

    def _for_chunks(self, cast: Callable[[int], None], count: int) -> None:
        """Call a function with the start of each chunk of rays, on several threads."""
        if count <= _CHUNK_RAYS:  # threads take as long to start as many a chunk takes
            if count:
                cast(0)
            return
        with ThreadPoolExecutor(self._threads) as pool:
            list(pool.map(cast, range(0, count, _CHUNK_RAYS)))


def cast_depths(occluders: Float32Array, projection: Projections, size: int, threads: int = 0) -> Float32Array:
    """Return the depths of occluders along one axis, see `Backend.depths`: rays from beyond both ends."""
    rows = projection.rows[0]
    row, column = np.divmod(np.arange(size * size), size)
    map_point = np.column_stack([column + 0.5, row + 0.5, np.zeros(size * size)]) - rows[:, 3]
    at_zero = np.linalg.solve(rows[:, :3], map_point.T).T
    axis, caster = rows[2, :3], RayCaster(occluders, threads)
    depths = np.empty((2, size * size), np.float32)
    for end, sign in enumerate((1.0, -1.0)):
        start, direction = at_zero + sign * _ABOVE * axis, -sign * axis[None]
        distance = caster.distances(start.astype(np.float32), direction.astype(np.float32))
        depths[end] = sign * (_ABOVE - distance)
    return depths.reshape(2, size, size)
