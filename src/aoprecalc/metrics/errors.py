"""Errors of an ambient-occlusion texture against ray tracing at surface points (*Précalcul*, equation 1.1.1.1)."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import baked_apart, in_poses
from aoprecalc.mesh.surface import SurfacePoints
from aoprecalc.mesh.topology import edge_ids
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import bilinear, mip_chain
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Scene
from aoprecalc.visibility.directions import orthonormal_basis
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.projection import Projection
from aoprecalc.visibility.ray_testers import RAY_OFFSET, RayOcclusion
from aoprecalc.visibility.sky import ImageSky

MIP_LEVELS = 5
_MIN_SEPARATION = 0.01  # of two of the worst points, / bounding box diagonal
_RAYS_PER_CHUNK = 1 << 20  # cast at once: about 60 MB
_COSINE = Integrand()


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of the errors texture - reference, both ambient occlusion in [0, 1].

    rmse            root mean square
    bias            mean; positive if the texture is too bright
    p50, p95, p99   percentiles of the absolute error
    max             maximum of the absolute error
    """

    rmse: float
    bias: float
    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class WorstPoint:
    """A surface point of large error.

    position           in mesh units
    uv                 v upwards
    value, reference   ambient occlusion of the texture and of ray tracing, in [0, 1]
    """

    position: tuple[float, float, float]
    uv: tuple[float, float]
    value: float
    reference: float

    @property
    def error(self) -> float:
        """Texture minus reference."""
        return self.value - self.reference


@dataclass(frozen=True, eq=False)
class TextureErrors:
    """Errors of a texture against ray tracing, at points distributed uniformly over a surface.

    levels   statistics for each level of the texture's mip chain, full resolution first
    worst    points of greatest error at full resolution
    rays     cast from each point
    uvs      (k, 2) float64: of the points, v upwards
    errors   (k,) float64: texture - reference at the points, at full resolution
    reference   (k,) float64: ambient occlusion at the points, by rays
    hit      (n,) bool: which of the points that were drawn these are: those on the detailed surface, if there is one
    """

    levels: tuple[ErrorStatistics, ...]
    worst: tuple[WorstPoint, ...]
    rays: int
    uvs: Float64Array
    errors: Float64Array
    reference: Float64Array
    hit: BoolArray

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.errors)


def error_statistics(errors: Float64Array) -> ErrorStatistics:
    """Compute statistics of errors, (k,) with k >= 1."""
    magnitudes = np.abs(errors)
    p50, p95, p99 = np.percentile(magnitudes, [50, 95, 99])
    rmse = np.sqrt(np.mean(errors**2))
    return ErrorStatistics(*map(float, (rmse, errors.mean(), p50, p95, p99, magnitudes.max())))


def errors_per_mip_level(
    texture: Float32Array, uvs: Float64Array, reference: Float64Array, *, repeats: bool, levels: int = MIP_LEVELS
) -> tuple[ErrorStatistics, ...]:
    """Compute error statistics for bilinear look-ups in each of the first `levels` levels of a texture's mip chain.

    texture     (h, w), row 0 at v = 1
    uvs         (k, 2) of the points
    reference   (k,) expected values
    """
    chain = mip_chain(texture, levels)
    return tuple(error_statistics(bilinear(level, uvs, repeats=repeats) - reference) for level in chain)


def worst_points(
    positions: Float64Array,
    uvs: Float64Array,
    values: Float64Array,
    reference: Float64Array,
    diagonal: float,
    count: int = 10,
) -> tuple[WorstPoint, ...]:
    """Return up to `count` points of greatest error, in descending order, at least 1% of the diagonal apart.

    positions   (k, 3), in the unit of the diagonal
    uvs         (k, 2)
    values      (k,) looked up in the texture
    reference   (k,) expected; points without error are never returned
    """
    remaining = np.abs(values - reference)
    points: list[WorstPoint] = []
    while len(points) < count and remaining.max() > 0:
        worst = int(remaining.argmax())
        x, y, z = positions[worst].tolist()
        u, v = uvs[worst].tolist()
        points.append(WorstPoint((x, y, z), (u, v), float(values[worst]), float(reference[worst])))
        remaining[np.linalg.norm(positions - positions[worst], axis=1) <= _MIN_SEPARATION * diagonal] = 0
    return tuple(points)


# Without a reference: what a texture says of both sides of a seam.

_SEAM_SAMPLES = 4000
_MIN_SEAM = 1e-6  # distance of UVs from which an edge is a seam


@dataclass(frozen=True)
class SeamDifference:
    """How a texture differs across UV seams, where both sides are one place of the surface.

    seams     edges whose two faces have different UVs
    across    mean absolute difference of both sides
    random    that of two places of seams taken at random
    """

    seams: int
    across: float
    random: float


def seam_difference(scene: Scene, texture: Float32Array, uvs: Float64Array, mapped: BoolArray) -> SeamDifference | None:
    """Compare a texture, (h, w), on both sides of the seams of (f, 3, 2) UVs; None where there are no seams.

    mapped   (f,) bool: the faces with UVs
    """
    ids = edge_ids(scene.faces)[mapped].ravel()
    ends = np.stack([scene.faces, np.roll(scene.faces, -1, axis=1)], axis=2)[mapped].reshape(-1, 2)
    at_ends = np.stack([uvs, np.roll(uvs, -1, axis=1)], axis=2)[mapped].reshape(-1, 2, 2)
    turned = ends[:, 0] > ends[:, 1]
    at_ends[turned] = at_ends[turned, ::-1]
    order = np.argsort(ids, kind="stable")
    first, second = order[:-1], order[1:]
    split = (ids[first] == ids[second]) & (np.abs(at_ends[first] - at_ends[second]).max(axis=(1, 2)) > _MIN_SEAM)
    first, second = first[split], second[split]
    lengths = np.linalg.norm(np.diff(scene.positions[ends[first]], axis=1)[:, 0], axis=1)
    if not lengths.sum() > 0:
        return None
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(first), _SEAM_SAMPLES, p=lengths / lengths.sum())
    along = rng.random((_SEAM_SAMPLES, 1))
    here, there = (
        bilinear(texture, at_ends[side[chosen], 0] * (1 - along) + at_ends[side[chosen], 1] * along, repeats=True)
        for side in (first, second)
    )
    across, random = (float(np.abs(here - other).mean()) for other in (there, rng.permutation(there)))
    return SeamDifference(len(first), across, random)


# The reference, by ray tracing.


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


def reference_ao(
    scene: Scene,
    shading: Float32Array,
    points: SurfacePoints,
    options: Rays,
    progress: Progress,
    integrand: Integrand = _COSINE,
) -> Float64Array:
    """Compute the ambient occlusion at surface points, (k,) float64 in [0, 1].

    shading     (f, 3, 3) float32, unit normals at the corners
    integrand   what each direction counts for, and how far occluders count

    Rays w are distributed by the integrand's weight, as a rule their cosine with the interpolated shading normal n, and
    count by the radiance of the sky. Estimator ratio: the visible fraction of the rays above the geometric horizon,
    g.w > 0 with the face normal g; mean: the number of these visible rays / the number of all rays. If n opposes g, g
    replaces it. Two-sided faces have the maximum of both sides' values. In several poses both numbers of rays are
    summed over them.
    Each finished point of the front side advances `progress` by one. Raises RendererError if rays cannot be cast.
    """
    values: Float64Array = np.zeros(len(points))
    passes = baked_apart(scene)
    for baked in passes:
        chosen = np.flatnonzero(baked.receives[points.faces]) if len(passes) > 1 else np.arange(len(points))
        own = SurfacePoints(points.faces[chosen], points.weights[chosen])
        values[chosen] = _in_one_pass(baked, shading, own, options, progress, integrand)
    return values


def _in_one_pass(
    scene: Scene,
    shading: Float32Array,
    points: SurfacePoints,
    options: Rays,
    progress: Progress,
    integrand: Integrand,
) -> Float64Array:
    """Return the ambient occlusion at points of parts that are baked together."""
    two_sided = scene.two_sided[points.faces]
    front, back = np.zeros((2, len(points))), np.zeros((2, len(points)))
    for posed, normals_of_pose in in_poses(scene, shading):
        for surface, rows, faces in NormalizedSurface.from_scene(posed, normals_of_pose).by_group(points.faces):
            rays = RayOcclusion(surface, integrand, options.threads)
            positions, normals, geometric = surface.interpolate(faces, points.weights[rows])
            front[:, rows] += _one_side(rays, (positions, normals, geometric), options, integrand, progress)
            sides = two_sided[rows]
            behind = positions[sides], -normals[sides], -geometric[sides]
            back[:, rows[sides]] += _one_side(rays, behind, options, integrand, Progress())
        progress = Progress()
    tiny = np.finfo(float).tiny
    values, lighter = (visible / np.maximum(counted, tiny) for visible, counted in (front, back))
    return np.where(two_sided, np.maximum(values, lighter), values)


def _one_side(
    occluders: RayOcclusion,
    points: tuple[Float64Array, Float64Array, Float64Array],
    options: Rays,
    integrand: Integrand,
    progress: Progress,
) -> Float64Array:
    """Return what the visible rays from points on one side count for, and what all do, (2, k).

    points   their positions, shading normals and face normals, (k, 3) each
    """
    positions, normals, geometric = points
    rays = stratified_ray_count(options.rays)
    rng = np.random.default_rng(options.seed)
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
