"""Which sphere each point of a surface is given to, and how small spheres that contain the surface can be.

A surface is triangles, (m, 3, 3). Balls are convex, so a ball that contains the corners of a triangle contains the
triangle. One whose corners are in several balls is bisected until the pieces are so small that a ball that grows to
contain them hardly grows.
"""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.types import Float64Array, Int64Array

_BRUTE_FORCE_UP_TO = 256  # spheres; for 100, brute force takes a fifth of the time of a k-d tree
_NEIGHBOURS = 16  # nearest centres tried in a k-d tree
_CHUNK_VALUES = 1 << 16  # distances computed at once: they stay in cache, and BLAS starts no threads for so few
_ROUGH_STEPS, _ENCLOSING_STEPS = 6, 30  # towards the centre of the smallest ball, whose radius is then 1 % too large
_INNER = 0.5  # of a ball's radius after the rough steps: points nearer to its centre do not determine the smallest one
_RADIUS_ROUNDING = 1e-12  # normalised; added to radii so that rounding leaves no corner outside


def subdivide(corners: Float64Array, max_edge: float) -> Float64Array:
    """Bisect the longest edge of triangles, (f, 3, 3), until none exceeds `max_edge` > 0; returns (m, 3, 3).

    The result covers the triangles exactly, except for the rounding of edge midpoints.
    """
    small = []
    while len(corners):
        large = _longest_edges(corners) > max_edge
        small.append(corners[~large])
        corners = _bisected(corners[large])
    return np.concatenate(small)


def thinned(points: Float64Array, cell: float) -> Float64Array:
    """Return the first of the points, (k, 3), in each cube of a grid of side `cell`."""
    cubes = np.floor(points / cell).astype(np.int64)
    cubes -= cubes.min(axis=0, initial=0)
    shape = cubes.max(axis=0, initial=0) + 1
    keys = (cubes[:, 0] * shape[1] + cubes[:, 1]) * shape[2] + cubes[:, 2]
    kept: Float64Array = points[np.unique(keys, return_index=True)[1]]
    return kept


def nearest_spheres(
    points: Float64Array, centers: Float64Array, radii: Float64Array, count: int = 1
) -> tuple[Int64Array, Float64Array]:
    """Find the spheres of least signed distance from each of k points; approximately if there are many spheres.

    count   1 or 2: how many for each point, at most as many as there are spheres

    Returns indices, (k, count), and signed distances, (k, count) float64, the nearest sphere first.
    """
    if len(radii) > _BRUTE_FORCE_UP_TO:
        distances, neighbours = cKDTree(centers).query(points, _NEIGHBOURS)
        distances -= radii[neighbours]
        order = np.argsort(distances, axis=1, kind="stable")[:, :count]
        return np.take_along_axis(neighbours, order, axis=1), np.take_along_axis(distances, order, axis=1)
    nearest, signed = np.empty((len(points), count), np.int64), np.empty((len(points), count))
    # |p - c|^2 = |p|^2 - 2 p.c + |c|^2 is linear in |p|^2, p, 1.
    lifted = np.column_stack([np.square(points).sum(axis=1), points, np.ones(len(points))])
    factors = np.vstack([np.ones(len(radii)), -2 * centers.T, np.square(centers).sum(axis=1)])
    chunk_size = _CHUNK_VALUES // len(radii)
    buffer, rows = np.empty((chunk_size, len(radii))), np.arange(chunk_size)
    for start in range(0, len(points), chunk_size):
        chunk = slice(start, min(start + chunk_size, len(points)))
        distances, row = buffer[: chunk.stop - start], rows[: chunk.stop - start]
        np.matmul(lifted[chunk], factors, out=distances)
        np.maximum(distances, 0, out=distances)
        np.sqrt(distances, out=distances)
        distances -= radii
        for rank in range(count):
            best = distances.argmin(axis=1)
            nearest[chunk, rank], signed[chunk, rank] = best, distances[row, best]
            distances[row, best] = np.inf
    return nearest, signed


def largest_per_owner(values: Float64Array, owner: Int64Array, count: int) -> Float64Array:
    """Return the largest of the values >= 0 of each of `count` owners, (count,) float64; 0 for those without any."""
    largest = np.zeros(count)
    np.maximum.at(largest, owner, values)
    return largest


def enclosing_balls(
    points: Float64Array, owner: Int64Array, centers: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return nearly the smallest balls that contain the points of each owner.

    points    (k, 3)
    owner     (k,) int64: index of the ball that must contain the point
    centers   (n, 3): initial centres; a ball without points stays there, with radius 0

    Returns centres (n, 3) and radii (n,) float64. Each step moves a centre towards its farthest point, ever less far:
    M. Badoiu, K. L. Clarkson, Smaller core-sets for balls, 2003.
    """
    order = np.argsort(owner, kind="stable")
    points, owner = points[order], owner[order]
    rough = _towards_farthest(points, owner, centers, _ROUGH_STEPS)
    distances = np.linalg.norm(points - rough[owner], axis=1)
    outer = distances >= _INNER * largest_per_owner(distances, owner, len(centers))[owner]
    enclosing = _towards_farthest(points[outer], owner[outer], rough, _ENCLOSING_STEPS)
    return enclosing, largest_per_owner(np.linalg.norm(points - enclosing[owner], axis=1), owner, len(centers))


def _towards_farthest(points: Float64Array, owner: Int64Array, centers: Float64Array, steps: int) -> Float64Array:
    """Move centres towards their farthest points, ever less far; return the best of the places, (n, 3).

    owner   (k,) int64, ascending
    """
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    run = np.repeat(np.arange(len(first)), np.diff(first, append=len(owner)))
    moving = centers[owner[first]]
    best, best_squared = moving.copy(), np.full(len(first), np.inf)
    for step in range(steps if len(first) else 0):
        squared = np.square(points - moving[run]).sum(axis=1)
        largest = np.maximum.reduceat(squared, first)
        smaller = largest < best_squared
        best[smaller], best_squared[smaller] = moving[smaller], largest[smaller]
        farthest = np.flatnonzero(squared == largest[run])
        farthest = farthest[np.flatnonzero(np.diff(run[farthest], prepend=-1))]
        moving = moving + (points[farthest] - moving) / (step + 2)
    moved = centers.copy()
    moved[owner[first]] = best
    return moved


def pieces_outside(
    triangles: Float64Array, centers: Float64Array, radii: Float64Array, max_edge: float
) -> tuple[Float64Array, Int64Array]:
    """Bisect triangles that their nearest spheres do not contain, until those pieces have edges up to `max_edge`.

    Returns the pieces that are still not contained, (k, 3, 3), and the nearest sphere of each, (k,).
    """
    pieces, spheres = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    while len(triangles):
        nearest = nearest_spheres(triangles.mean(axis=1), centers, radii)[0][:, 0]
        reach = np.linalg.norm(triangles - centers[nearest][:, None], axis=2).max(axis=1)
        outside = np.flatnonzero(reach > radii[nearest])
        triangles, nearest = triangles[outside], nearest[outside]
        large = _longest_edges(triangles) > max_edge
        pieces.append(triangles[~large])
        spheres.append(nearest[~large])
        triangles = _bisected(triangles[large])
    return np.concatenate(pieces), np.concatenate(spheres)


def containing_radii(
    triangles: Float64Array, points: Float64Array, centers: Float64Array, radii: Float64Array, max_edge: float
) -> Float64Array:
    """Return radii, (n,), with which spheres contain triangles, (m, 3, 3), and points, (k, 3); none below the given.

    max_edge   of the pieces for which spheres grow: the smaller, the less, and the longer it takes
    """
    pieces, owner = pieces_outside(triangles, centers, radii, max_edge)
    reach = np.linalg.norm(pieces - centers[owner][:, None], axis=2).max(axis=1)
    grown = np.maximum(radii, largest_per_owner(reach, owner, len(radii)))
    owner = nearest_spheres(points, centers, grown)[0][:, 0]
    reach = np.linalg.norm(points - centers[owner], axis=1)
    return np.maximum(grown, largest_per_owner(reach, owner, len(radii))) + _RADIUS_ROUNDING


def _longest_edges(triangles: Float64Array) -> Float64Array:
    """Return the length of the longest edge of each triangle, (m,)."""
    longest: Float64Array = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    return longest


def _bisected(triangles: Float64Array) -> Float64Array:
    """Return both halves of each triangle, (2m, 3, 3), cut at the middle of its longest edge."""
    lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    order = lengths.argmax(axis=1)[:, None] + np.arange(3)  # puts the longest edge first: a to b
    a, b, c = np.take_along_axis(triangles, order[..., None] % 3, axis=1).transpose(1, 0, 2)
    middle = (a + b) / 2
    return np.concatenate([np.stack(halves, axis=1) for halves in ((a, middle, c), (middle, b, c))])
