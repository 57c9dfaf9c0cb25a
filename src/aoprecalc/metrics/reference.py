"""Ambient occlusion at points of a surface by tracing rays: what a texture is measured against."""

import math

import numpy as np

from aoprecalc.mesh.sampling import SurfacePoints
from aoprecalc.mesh.unit_sphere import NormalizedSurface
from aoprecalc.options import Estimator, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Float32Array, Float64Array, Scene
from aoprecalc.visibility.directions import orthonormal_basis
from aoprecalc.visibility.rays import RAY_OFFSET, RayCaster

_BLOCK = 1 << 20  # rays cast at a time: some 60 MB


def stratified_ray_count(rays: int) -> int:
    """Return how many rays stand for `rays`: the next square number, as they are stratified in a square grid."""
    return (math.isqrt(rays - 1) + 1) ** 2


def reference_ao(
    scene: Scene, shading: Float32Array, points: SurfacePoints, options: VerifyOptions, progress: Progress
) -> Float64Array:
    """Return the ambient occlusion at the points, (k,) float64 in [0, 1].

    shading   (f, 3, 3) float32, unit normals at the corners
    options   rays, seed, estimator and threads count here

    With the interpolated normal n and the face's own g (for n where they oppose each other), rays w are drawn by their
    cosine with n; ratio: the visible share of those with g.w > 0; mean: the visible ones of these as a share of all.
    Faces that are two-sided have the larger of both sides' values. Points done are counted on `progress`.
    Raises RendererError where rays cannot be cast.
    """
    surface = NormalizedSurface.from_scene(scene, shading)
    occluders = RayCaster(surface.occluders, options.threads)
    places, normals, geometric = surface.interpolate(points.faces, points.weights)
    values = _one_side(surface, occluders, places, normals, geometric, options, progress)
    backs = np.flatnonzero(scene.two_sided[points.faces])
    behind = _one_side(surface, occluders, places[backs], -normals[backs], -geometric[backs], options, Progress())
    values[backs] = np.maximum(values[backs], behind)
    return values


def _one_side(
    surface: NormalizedSurface,
    occluders: RayCaster,
    places: Float64Array,
    normals: Float64Array,
    geometric: Float64Array,
    options: VerifyOptions,
    progress: Progress,
) -> Float64Array:
    rays = stratified_ray_count(options.rays)
    rng = np.random.default_rng(options.seed)
    values = np.empty(len(places))
    step = max(1, _BLOCK // rays)
    for start in range(0, len(places), step):
        block = slice(start, start + step)
        upward = geometric[block].astype(np.float32)
        directions = _hemispheres(normals[block], rays, rng)
        in_front = np.matmul(directions, upward[:, :, None])[:, :, 0] > 0
        origins = np.repeat((places[block] + RAY_OFFSET * geometric[block]).astype(np.float32), rays, axis=0)
        hidden = occluders.occluded(origins, directions.reshape(-1, 3)).reshape(in_front.shape)
        seen = in_front & ~hidden & ~surface.is_below_ground(directions)
        values[block] = _share(seen.sum(axis=1), in_front.sum(axis=1), rays, options.estimator)
        progress.advance(len(upward))
    return values


def _share(seen: Float64Array, in_front: Float64Array, rays: int, estimator: Estimator) -> Float64Array:
    return seen / rays if estimator == "mean" else seen / np.maximum(in_front, 1)


def _hemispheres(normals: Float64Array, rays: int, rng: np.random.Generator) -> Float32Array:
    """Draw `rays` unit directions about each of m normals, (m, rays, 3), each in its cell of a square grid.

    Their density is the cosine with the normal over pi: points uniform on a disc, lifted onto the sphere.
    """
    side = math.isqrt(rays)
    ring, sector = np.divmod(np.arange(rays, dtype=np.float32), np.float32(side))
    height = (ring + rng.random((len(normals), rays), np.float32)) / np.float32(side)  # 1 - cos^2
    turn = (sector + rng.random((len(normals), rays), np.float32)) * np.float32(2 * np.pi / side)
    radius = np.sqrt(height)
    frames = np.stack([*orthonormal_basis(normals), normals], axis=1)
    local = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(np.maximum(1 - height, 0))], axis=2)
    directions: Float32Array = np.matmul(local, frames.astype(np.float32))
    return directions
