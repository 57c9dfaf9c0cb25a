"""Method collision: spheres that contain the whole surface, and the inside of a closed mesh, and protrude little.

The spheres of method shadow are the start. The same descent continues, with an additional pull on the nearest sphere
from each point outside all spheres, until hardly any is left outside. Then each small triangle of the subdivided
surface is assigned to its nearest sphere, and every sphere grows until it contains the corners of its triangles. Balls
are convex, so they contain the triangles, and together every point of the surface rather than samples of it.
"""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.mesh.topology import topology
from aoprecalc.progress import Progress
from aoprecalc.spheres.sampling import NormalizedFrame, SphereFit, VoxelGrid, inside_mesh
from aoprecalc.spheres.shadow import VIEWS_PER_STEP, SilhouetteTarget, fit_shadow
from aoprecalc.spheres.silhouettes import SilhouetteDescent
from aoprecalc.types import Float64Array, Int64Array, Scene

# Chosen on bunny, bigguy, ogre and fruit fly.
_STEPS = 300
_FINAL_PULL = 4.0  # of a point, relative to its share of the silhouettes' area
_POINTS_PER_STEP = 4000
_PULL_MARGIN, _MAX_PULL = 0.3, 3.0  # pixels: depth inside a sphere from which a point pulls, and the cap of its pull
_MAX_EDGE = 0.03  # longest edge of a triangle of the subdivided surface, normalised
_VOXEL_RESOLUTION = 48  # along the longest side of the grid whose points inside the mesh must be contained
_BRUTE_FORCE_UP_TO = 256  # spheres; for 100, brute force takes a fifth of the time of a k-d tree
_NEIGHBOURS = 16  # nearest centres tried in a k-d tree
_MAX_RELOCATIONS = 8  # times that spheres without triangles are moved
_CHUNK_VALUES = 1 << 16  # distances computed at once: they stay in cache, and BLAS starts no threads for so few
_RADIUS_ROUNDING = 1e-12  # normalised; added to radii so that rounding leaves no corner outside


def fit_collision(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    count: int,
    rng: np.random.Generator,
    progress: Progress,
) -> SphereFit:
    """Fit `count` spheres that contain the surface of a scene, up to the rounding of coordinates.

    points   (s, 3) float64: samples of the surface in normalised coordinates
    The inside of a watertight mesh is contained at the points of a grid, 48 along the longest side of its box.
    """
    target = SilhouetteTarget.from_scene(scene, frame)
    initial = fit_shadow(scene, frame, target, points, count, rng, progress)
    triangles = subdivide(frame.to_normalized(scene.corners), _MAX_EDGE)
    inside = _points_inside(scene, frame)
    required = np.concatenate([triangles.reshape(-1, 3), inside])
    descent = SilhouetteDescent(initial.centers, initial.radii, target.masks, target.views, VIEWS_PER_STEP)
    for step in range(_STEPS):
        elapsed = step / _STEPS
        pulling = required[rng.integers(len(required), size=_POINTS_PER_STEP)]
        strength = _FINAL_PULL * (0.1 + 3 * elapsed) * target.masks.sum() / len(target.views) / _POINTS_PER_STEP
        gradient = _pull_gradient(pulling, descent.centers, descent.radii, target.views.pixels_per_unit, strength)
        descent.step(0.5 * (1 - elapsed) + 0.03, gradient)
        progress.advance()
    centers, radii = _relocate_unused(triangles, descent.centers, descent.radii)
    radii = _containing_radii(triangles, inside, centers, radii)
    return SphereFit(centers, radii, initial.iterations + _STEPS, converged=True)


def subdivide(corners: Float64Array, max_edge: float) -> Float64Array:
    """Bisect the longest edge of triangles, (f, 3, 3), until none exceeds `max_edge` > 0; returns (m, 3, 3).

    The result covers the triangles exactly, except for the rounding of edge midpoints.
    """
    small = []
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small.append(corners[lengths.max(axis=1) <= max_edge])
        large = lengths.max(axis=1) > max_edge
        order = lengths[large].argmax(axis=1)[:, None] + np.arange(3)  # puts the longest edge first: a to b
        a, b, c = np.take_along_axis(corners[large], order[..., None] % 3, axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack(halves, axis=1) for halves in ((a, middle, c), (middle, b, c))])
    return np.concatenate(small)


def _points_inside(scene: Scene, frame: NormalizedFrame) -> Float64Array:
    """Return grid points inside a watertight mesh in normalised coordinates, (k, 3); none if it is not watertight."""
    if not topology(scene.faces).watertight:
        return np.zeros((0, 3))
    positions = frame.to_normalized(scene.positions)
    grid = VoxelGrid.from_box(positions.min(axis=0), positions.max(axis=0), _VOXEL_RESOLUTION)
    return grid.centers(inside_mesh(positions, scene.faces, grid))


def _pull_gradient(
    points: Float64Array, centers: Float64Array, radii: Float64Array, pixels_per_unit: float, strength: float
) -> Float64Array:
    """Return the gradient with respect to (x, y, z, r) that pulls spheres to points outside them, (n, 4)."""
    nearest = _nearest_spheres(points, centers, radii)
    offsets = points - centers[nearest]
    distances = np.linalg.norm(offsets, axis=1)
    outside = (distances - radii[nearest]) * pixels_per_unit + _PULL_MARGIN
    weight = -strength * np.clip(outside, 0.0, _MAX_PULL)
    gradient = [np.bincount(nearest, weight * axis / np.maximum(distances, 1e-12), len(radii)) for axis in offsets.T]
    return np.column_stack([*gradient, np.bincount(nearest, weight, len(radii))])


def _relocate_unused(
    triangles: Float64Array, centers: Float64Array, radii: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Move each sphere that is nearest to no triangle to where another sphere would have to grow most."""
    centers, radii = centers.copy(), radii.copy()
    centroids = triangles.mean(axis=1)
    for _ in range(_MAX_RELOCATIONS):
        nearest = _nearest_spheres(centroids, centers, radii)
        unused = np.flatnonzero(np.bincount(nearest, minlength=len(radii)) == 0)
        if not len(unused):
            break
        outside = np.linalg.norm(centroids - centers[nearest], axis=1) - radii[nearest]
        worst = _first_per_sphere(nearest, np.argsort(-outside, kind="stable"))[: len(unused)]
        unused = unused[: len(worst)]
        centers[unused], radii[unused] = centroids[worst], np.maximum(outside[worst], _MAX_EDGE)
    return centers, radii


def _first_per_sphere(nearest: Int64Array, order: Int64Array) -> Int64Array:
    """Return the first triangle of each sphere in an order of the triangles, in that order."""
    first = np.unique(nearest[order], return_index=True)[1]
    return order[np.sort(first)]


def _containing_radii(
    triangles: Float64Array, points: Float64Array, centers: Float64Array, radii: Float64Array
) -> Float64Array:
    """Return the least radii, (n,), with which spheres contain the triangles, (m, 3, 3), and points nearest to them.

    A point that its sphere contains already does not enlarge it, and the sphere then keeps at least its radius.
    """
    required = np.zeros(len(radii))
    nearest = _nearest_spheres(triangles.mean(axis=1), centers, radii)
    np.maximum.at(required, nearest, np.linalg.norm(triangles - centers[nearest][:, None], axis=2).max(axis=1))
    nearest = _nearest_spheres(points, centers, radii)
    distances = np.linalg.norm(points - centers[nearest], axis=1)
    outside = distances > np.maximum(required, radii)[nearest]
    np.maximum.at(required, nearest[outside], distances[outside])
    contains_points = np.zeros(len(radii), bool)
    contains_points[nearest[~outside]] = True
    return np.where(contains_points, np.maximum(required, radii), required) + _RADIUS_ROUNDING


def _nearest_spheres(points: Float64Array, centers: Float64Array, radii: Float64Array) -> Int64Array:
    """Return the sphere of least signed distance from each point, (k,); approximately if there are many spheres.

    Any other assignment would be valid, but would give larger spheres.
    """
    if len(radii) > _BRUTE_FORCE_UP_TO:
        distances, neighbours = cKDTree(centers).query(points, _NEIGHBOURS)
        best = np.argmin(distances - radii[neighbours], axis=1)
        nearest: Int64Array = neighbours[np.arange(len(points)), best]
        return nearest
    nearest = np.empty(len(points), np.intp)
    squared_centers = np.square(centers).sum(axis=1)
    chunk_size = _CHUNK_VALUES // len(radii)
    for start in range(0, len(points), chunk_size):
        chunk = points[start : start + chunk_size]
        squared = np.square(chunk).sum(axis=1)[:, None] + squared_centers - 2 * chunk @ centers.T
        nearest[start : start + chunk_size] = np.argmin(np.sqrt(np.maximum(squared, 0)) - radii, axis=1)
    return nearest
