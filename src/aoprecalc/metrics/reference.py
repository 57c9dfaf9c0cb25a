"""The reference that textures are measured against: ambient occlusion at surface points by ray tracing."""

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple, Protocol

import numpy as np

from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import baked_apart, in_poses
from aoprecalc.mesh.surface import SurfacePoints
from aoprecalc.progress import Progress
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Scene
from aoprecalc.visibility.directions import orthonormal_basis
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.projection import Projection
from aoprecalc.visibility.ray_testers import RAY_OFFSET, RayOcclusion
from aoprecalc.visibility.sky import ImageSky

_RAYS_PER_CHUNK = 1 << 20  # cast at once: about 60 MB
_KEPT = 4  # passes, and occluders, that are kept for further points
_COSINE = Integrand()


class MeasuredSurface:
    """The surface whose ambient occlusion a texture holds: that of its scene, or the detailed one in its place.

    scene     with the roles of its parts
    normals   (f, 3, 3) float32: the shading normals at the corners
    """

    def __init__(self, scene: Scene, normals: Float32Array, threads: int) -> None:
        """Take the scene of a texture and its shading normals; raises RendererError where rays cannot be cast."""
        detail = detail_of(scene)
        self.scene, self.normals = (scene, normals) if detail is None else (detail.scene, detail.normals)
        self._projection = None if detail is None else Projection(scene, detail, threads)

    def points(self, points: SurfacePoints) -> tuple[BoolArray, SurfacePoints]:
        """Return which of k points of the scene are on this surface, (k,) bool, and their points on it."""
        if self._projection is None:
            return np.ones(len(points), bool), points
        return self._projection.points(points)


class Rays(Protocol):
    """How many rays are cast from each point, and how; VerifyOptions are such."""

    @property
    def rays(self) -> int:
        """Rays from each point; rounded up to a square."""
        ...

    @property
    def seed(self) -> int:
        """Seed of their directions."""
        ...

    @property
    def threads(self) -> int:
        """Threads that cast them; 0: all cores."""
        ...


class RayCount(NamedTuple):
    """Rays without further options; see `Rays`."""

    rays: int
    seed: int
    threads: int


def stratified_ray_count(rays: int) -> int:
    """Return the next square number: rays are stratified in a square grid."""
    return (math.isqrt(rays - 1) + 1) ** 2


class RayReference:
    """Ambient occlusion at surface points by rays; what they hit is built once, for any number of calls.

    Rays w are distributed by the integrand's weight, as a rule their cosine with the interpolated shading normal n, and
    count by the radiance of the sky. Estimator ratio: the visible fraction of the rays above the geometric horizon,
    g.w > 0 with the face normal g; mean: the number of these visible rays / the number of all rays. If n opposes g, g
    replaces it. Two-sided faces have the maximum of both sides' values. In several poses both numbers of rays are
    summed over them.
    """

    def __init__(self, scene: Scene, shading: Float32Array, integrand: Integrand, threads: int) -> None:
        """Keep a scene with the roles of its parts, and its unit normals at the corners, (f, 3, 3) float32."""
        self._integrand = integrand
        self._passes = baked_apart(scene)
        self._surfaces_of = lru_cache(_KEPT)(
            lambda number: [NormalizedSurface.from_scene(*posed) for posed in in_poses(self._passes[number], shading)]
        )
        self._rays_of = lru_cache(_KEPT)(lambda surface: RayOcclusion(surface, integrand, threads))

    def values(self, points: SurfacePoints, rays: int, seed: int, progress: Progress) -> Float64Array:
        """Return the ambient occlusion at surface points, (k,) float64 in [0, 1], by new rays from each.

        rays   from each point; rounded up to a square
        Each finished point of the front side advances `progress` by one. Raises RendererError if rays cannot be cast.
        """
        return np.asarray(self.of_sides(points, rays, seed, progress).max(axis=0))

    def of_sides(self, points: SurfacePoints, rays: int, seed: int, progress: Progress) -> Float64Array:
        """Return the ambient occlusion of the front and of the back, (2, k); the back of one-sided faces has 0.

        The greater of two noisy values is too great in the mean: without bias is who chooses the side by other rays.
        """
        values: Float64Array = np.zeros((2, len(points)))
        rng = np.random.default_rng(seed)
        for number, baked in enumerate(self._passes):
            chosen = np.flatnonzero(baked.receives[points.faces]) if len(self._passes) > 1 else np.arange(len(points))
            own = SurfacePoints(points.faces[chosen], points.weights[chosen])
            values[:, chosen] = self._in_one_pass(baked, self._surfaces_of(number), own, rays, rng, progress)
        return values

    def _in_one_pass(
        self,
        scene: Scene,
        surfaces: Sequence[NormalizedSurface],
        points: SurfacePoints,
        rays: int,
        rng: np.random.Generator,
        progress: Progress,
    ) -> Float64Array:
        """Return what `of_sides` does for points of parts that are baked together; `surfaces` are of each pose."""
        two_sided = scene.two_sided[points.faces]
        front, back = np.zeros((2, len(points))), np.zeros((2, len(points)))
        for of_pose in surfaces:
            for surface, rows, faces in of_pose.by_group(points.faces):
                cast = partial(_one_side, self._rays_of(surface), rays=rays, rng=rng, integrand=self._integrand)
                positions, normals, geometric = surface.interpolate(faces, points.weights[rows])
                front[:, rows] += cast((positions, normals, geometric), progress=progress)
                sides = two_sided[rows]
                behind = positions[sides], -normals[sides], -geometric[sides]
                back[:, rows[sides]] += cast(behind, progress=Progress())
            progress = Progress()
        tiny = np.finfo(float).tiny
        return np.stack([visible / np.maximum(counted, tiny) for visible, counted in (front, back)])


def reference_ao(
    scene: Scene,
    shading: Float32Array,
    points: SurfacePoints,
    options: Rays,
    progress: Progress,
    integrand: Integrand = _COSINE,
) -> Float64Array:
    """Return the ambient occlusion at surface points, (k,) float64 in [0, 1]; see `RayReference`."""
    return RayReference(scene, shading, integrand, options.threads).values(points, options.rays, options.seed, progress)


def _one_side(
    occluders: RayOcclusion,
    points: tuple[Float64Array, Float64Array, Float64Array],
    *,
    rays: int,
    rng: np.random.Generator,
    integrand: Integrand,
    progress: Progress,
) -> Float64Array:
    """Return what the visible rays from points on one side count for, and what all do, (2, k).

    points   their positions, shading normals and face normals, (k, 3) each
    """
    positions, normals, geometric = points
    rays = stratified_ray_count(rays)
    sums = np.empty((2, len(positions)))
    chunk_size = max(1, _RAYS_PER_CHUNK // rays)
    for start in range(0, len(positions), chunk_size):
        chunk = slice(start, start + chunk_size)
        upward = geometric[chunk].astype(np.float32)
        directions, weights = _weighted_directions(normals[chunk], rays, rng, integrand)
        above_horizon = np.matmul(directions, upward[:, :, None])[:, :, 0] > 0
        origins = np.repeat((positions[chunk] + RAY_OFFSET * geometric[chunk]).astype(np.float32), rays, axis=0)
        taken = occluders.occlusion(origins, directions.reshape(-1, 3)).reshape(above_horizon.shape)
        weights = weights * above_horizon
        sums[0, chunk] = (weights * (1 - taken)).sum(axis=1)
        sums[1, chunk] = rays if integrand.estimator == "mean" else weights.sum(axis=1)
        progress.advance(len(upward))
    return sums


def _weighted_directions(
    normals: Float64Array, rays: int, rng: np.random.Generator, integrand: Integrand
) -> tuple[Float32Array, Float64Array]:
    """Return unit directions about m normals, (m, rays, 3), and what each counts for, (m, rays) or (1, 1).

    By the image of a sky, which may be dark but for a sun, half of them are drawn in proportion to its radiance, and
    all count by the balance heuristic (E. Veach, L. Guibas, "Optimally combining sampling techniques", 1995).
    """
    sky = integrand.sky
    if not isinstance(sky, ImageSky):
        directions = _directions(normals, rays, rng, integrand)
        if sky is None:
            return directions, np.ones((1, 1))
        return directions, sky.radiance(directions.reshape(-1, 3)).reshape(directions.shape[:2])
    by_weight = math.isqrt(rays // 2) ** 2
    count = rays - by_weight
    u = (np.arange(count) + rng.random((len(normals), count))) / count
    towards_light = sky.sample(u.ravel(), rng.random((u.size, 2))).reshape(len(normals), count, 3)
    own = _directions(normals, by_weight, rng, integrand)
    directions = np.concatenate([own, towards_light.astype(np.float32)], axis=1)
    cosines = np.matmul(directions, normals[:, :, None])[:, :, 0]
    weights = integrand.weights(cosines)
    flat = directions.reshape(-1, 3)
    radiance, by_sky = (found.reshape(cosines.shape) for found in (sky.radiance(flat), sky.density(flat)))
    density = by_weight * weights / (4 * np.pi * integrand.mean_weight) + count * by_sky
    return directions, weights * radiance / density


def _directions(normals: Float64Array, rays: int, rng: np.random.Generator, integrand: Integrand) -> Float32Array:
    """Sample unit directions by their weight about m normals, (m, rays, 3), stratified in a square grid.

    By cosine, points uniform on a disc are projected up onto the hemisphere (Malley's method); without weight, heights
    are uniform (Archimedes).
    """
    side = math.isqrt(rays)
    ring, sector = np.divmod(np.arange(rays, dtype=np.float32), np.float32(side))
    uniform = (ring + rng.random((len(normals), rays), np.float32)) / np.float32(side)
    azimuth = (sector + rng.random((len(normals), rays), np.float32)) * np.float32(2 * np.pi / side)
    if integrand.weight == "cosine":
        sin_squared = uniform * np.float32(1 - integrand.min_cosine**2)
    else:
        sin_squared = 1 - (1 - uniform * np.float32(1 - integrand.min_cosine)) ** 2
    radius = np.sqrt(sin_squared)
    bases = np.stack([*orthonormal_basis(normals), normals], axis=1)
    cos = np.sqrt(np.maximum(1 - sin_squared, 0))
    local = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), cos], axis=2)
    directions: Float32Array = np.matmul(local, bases.astype(np.float32))
    return directions
