"""Values at vertices whose linear interpolation comes nearest to a field on the surface, by least squares.

Kavan, Bargteil, Sloan, "Least Squares Vertex Baking", Eurographics Symposium on Rendering 2011. Sizes in the
docstrings: f faces, u unknowns, k points.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import SurfacePoints, area_vectors
from aoprecalc.mesh.topology import adjacent_half_edges, unique_rows
from aoprecalc.types import Float32Array, Float64Array, Int64Array, Scene

SparseMatrix = Any  # scipy.sparse, which has no types
Field = Callable[[SurfacePoints], Float64Array]  # k points -> (k,) values

SMOOTHNESS = 0.01  # weight of the bend of the values at edges against their error
_SUBDIVISIONS = np.array([2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64])  # of the sides of a face, into squared as many pieces
_POINTS_AT_ONCE = 1 << 18
_MAX_SETS = 20  # of values at their bounds; a few suffice
_TOLERANCE, _MAX_STEPS = 1e-10, 10_000  # of conjugate gradients; the tolerance is of the residual, relative
_ACROSS_GAPS = 1e-6  # weight of differences along the sides of faces without a weight
_TO_THE_MEAN = 1e-12  # weight against that of a face of mean area, for vertices that nothing else determines


def vertex_groups(scene: Scene, normals: Float32Array) -> Int64Array:
    """Number the vertices at which a value may be, (f, 3) int64 from 0: equal for corners that share one.

    Corners do so where they have one position and one shading normal, in one level of detail.
    normals   (f, 3, 3), at the corners
    """
    levels = [-1 if part.levels is None else part.levels.start for part in scene.parts]
    sizes = [part.stop - part.start for part in scene.parts]
    level = np.repeat(levels, sizes)[:, None].repeat(3, axis=1)
    return unique_rows(scene.faces.ravel(), normals.reshape(-1, 3), level.ravel())[1].reshape(-1, 3)


def fit_vertex_values(
    corners: Float64Array,
    groups: Int64Array,
    areas: Float64Array,
    points: Float64Array,
    field: Field,
    smoothness: float = SMOOTHNESS,
) -> Float64Array:
    """Return the values, (u,), whose interpolation over the faces is nearest to a field: least squares by area.

    corners      (f, 3, 3) positions
    groups       (f, 3) the unknown at each corner, as from `vertex_groups`
    areas        (f,) the weight of each face; where it is 0 the field is not asked, and values are those around
    points       (f,) about how many points of each face the field is asked at: 4 to 4096, spread evenly
    smoothness   weight of the bend of the values at edges that are not hard, which is 0 where they are linear

    The values solve (M + S) x = b with the mass matrix M and the moments b of the field, both as sums over the points,
    so that a linear field comes back exactly. What no face with a weight is joined to gets the mean of the field.
    """
    from scipy.sparse import coo_array, diags_array

    count = int(groups.max()) + 1
    total = float(areas.sum())
    if not total > 0:
        raise ValueError("no face has a weight")
    areas = areas / total * np.count_nonzero(areas)
    blocks, moments = np.zeros((len(groups), 3, 3)), np.zeros((len(groups), 3))
    for faces, weights in _quadrature(areas, points):
        place = SurfacePoints(np.repeat(faces, len(weights)), np.tile(weights, (len(faces), 1)))
        values = field(place).reshape(len(faces), -1)
        scale = areas[faces, None] / len(weights)
        moments[faces] = values @ weights * scale
        blocks[faces] = (weights.T @ weights) * scale[:, :, None]
    right = np.bincount(groups.ravel(), moments.ravel(), count)
    rows, columns = groups[:, :, None].repeat(3, axis=2), groups[:, None, :].repeat(3, axis=1)
    mass = coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), (count, count)).tocsr()
    bends = _bends(corners, groups, areas, count) if smoothness > 0 else None
    gaps = _differences(groups[areas == 0], count)
    matrix = mass + _ACROSS_GAPS * (gaps.T @ gaps)
    if bends is not None:
        matrix = matrix + smoothness * (bends.T @ bends)
    mean = float(right.sum() / areas.sum())
    matrix = (matrix + _TO_THE_MEAN * diags_array(np.ones(count))).tocsr()
    # The mean is taken off, so that what nothing determines gets it and a constant comes back exactly.
    right = right - mass @ np.full(count, mean)
    return mean + _bounded_solution(matrix, right, -mean, 1 - mean)


def _bounded_solution(matrix: SparseMatrix, right: Float64Array, low: float, high: float) -> Float64Array:
    """Return the (u,) values between two bounds that minimise x.(matrix x) / 2 - right.x, by primal-dual active sets.

    Hintermueller, Ito, Kunisch, "The primal-dual active set strategy as a semismooth Newton method", 2002.
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import cg

    diagonal = matrix.diagonal()
    x, at_bound = np.zeros(len(right)), np.zeros(len(right), bool)
    for _ in range(_MAX_SETS):
        free = np.flatnonzero(~at_bound)
        if len(free):
            own = (right - matrix @ np.where(at_bound, x, 0))[free]
            inverse = diags_array(1 / diagonal[free])
            x[free], _ = cg(matrix[free][:, free], own, x0=x[free], rtol=_TOLERANCE, maxiter=_MAX_STEPS, M=inverse)
        stepped = x - (matrix @ x - right) / diagonal
        beyond = (stepped < low) | (stepped > high)
        x = np.where(beyond, np.where(stepped < low, low, high), x)
        if np.array_equal(beyond, at_bound):
            break
        at_bound = beyond
    return np.asarray(x.clip(low, high))


def _quadrature(areas: Float64Array, points: Float64Array) -> Iterator[tuple[NDArray[np.intp], Float64Array]]:
    """Yield faces, (m,), and the barycentric weights, (q, 3), of their points: the middles of equal pieces."""
    side = np.sqrt(np.clip(points, 4, _SUBDIVISIONS[-1] ** 2))
    level = np.searchsorted(_SUBDIVISIONS, side - 1e-9)
    for index, sides in enumerate(_SUBDIVISIONS.tolist()):
        faces = np.flatnonzero((level == index) & (areas > 0))
        weights = _middles(sides)
        step = max(1, _POINTS_AT_ONCE // len(weights))
        for start in range(0, len(faces), step):
            yield faces[start : start + step], weights


def _middles(sides: int) -> Float64Array:
    """Return the barycentric weights of the middles of the sides^2 equal pieces of a triangle, (q, 3)."""
    i, j = (axis.ravel() for axis in np.indices((sides, sides)))
    upright = np.column_stack([i, j])[i + j < sides] + 1 / 3
    turned = np.column_stack([i, j])[i + j < sides - 1] + 2 / 3
    second = np.concatenate([upright, turned]) / sides
    return np.column_stack([1 - second.sum(axis=1), second])


def _bends(corners: Float64Array, groups: Int64Array, areas: Float64Array, count: int) -> SparseMatrix:
    """Return a sparse (p, u) matrix: how much values bend at each of p edges, weighted by the faces there.

    At an edge from a to b with the faces' other corners c and d at the heights h and h' above it, whose feet divide it
    in the shares t and t': (c - (1 - t) a - t b) / h + (d - (1 - t') a - t' b) / h', which is 0 if the values are
    linear on the two faces laid flat. It is multiplied by the lesser height and the root of the lesser area.
    """
    from scipy.sparse import coo_array

    first, second = adjacent_half_edges(groups.astype(np.int32))
    flat, places = groups.ravel(), corners.reshape(-1, 3)
    start, end, third = (first // 3 * 3 + (first % 3 + step) % 3 for step in range(3))
    opposite = second // 3 * 3 + (second % 3 + 2) % 3
    base = places[end] - places[start]
    length = np.linalg.norm(base, axis=1)
    doubled = np.linalg.norm(area_vectors(corners), axis=1)
    usable = (length > 0) & (doubled[first // 3] > 0) & (doubled[second // 3] > 0)
    start, end, third, opposite, base, length = (
        values[usable] for values in (start, end, third, opposite, base, length)
    )
    first, second = first[usable], second[usable]
    terms = []
    for other, half_edge in ((third, first), (opposite, second)):
        share = np.einsum("px,px->p", places[other] - places[start], base) / length**2
        terms.append((other, share, doubled[half_edge // 3] / length))
    (_, one, height), (_, two, depth) = terms
    least = np.minimum(height, depth)
    weight = np.sqrt(np.minimum(areas[first // 3], areas[second // 3]))
    up, down = weight * least / height, weight * least / depth
    data = np.concatenate([up, down, -up * (1 - one) - down * (1 - two), -up * one - down * two])
    rows = np.tile(np.arange(len(first)), 4)
    columns = np.concatenate([flat[third], flat[opposite], flat[start], flat[end]])
    return coo_array((data, (rows, columns)), (len(first), count)).tocsr()


def _differences(groups: Int64Array, count: int) -> SparseMatrix:
    """Return a sparse (e, u) matrix: the differences of values along the sides of faces."""
    from scipy.sparse import coo_array

    start, end = groups.ravel(), np.roll(groups, -1, axis=1).ravel()
    rows = np.arange(len(start))
    data = np.concatenate([np.ones(len(start)), -np.ones(len(start))])
    return coo_array((data, (np.tile(rows, 2), np.concatenate([start, end]))), (len(start), count)).tocsr()
