"""How far apart two sets of spheres are, in whatever order they come."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching
from scipy.spatial import cKDTree

from aoprecalc.metrics.difference import Difference, bounding_diagonal, incomparable, rounded, scaled_to_unit
from aoprecalc.types import BoolArray, Float64Array, Int32Array

Spheres = tuple[Float64Array, Float64Array]

_FEW = 2000  # spheres of which all pairs may be looked at
_PARTNERS = 16  # of each of more spheres may be looked at, on average: time and memory stay small
_FIRST_STEP = 1 / 1024  # of how far apart spheres are in their files' order
_ROUNDING = 1 + 1e-12  # of distances that trees compare as squares


def spheres_difference(first: Sequence[Spheres], second: Sequence[Spheres]) -> Difference:
    """Compare sphere sets, each of one or more levels of (centers (n, 3), radii (n,)) float64, finite, n >= 1.

    Spheres of a level are paired, one to one, so that the greatest distance in a pair is as small as can be: that of
    the centres plus the difference of the radii. The value is that distance, over the diagonal of the box around the
    spheres of both sets, of the level where it is greatest.
    """
    counts = [[len(radii) for _, radii in levels] for levels in (first, second)]
    if counts[0] != counts[1]:
        one, other = (", ".join(map(str, count)) for count in counts)
        return incomparable(f"they have {one} and {other} spheres", spheres=counts)
    levels = [_level(one, other) for one, other in zip(first, second, strict=True)]
    value, center, radius, _ = max(levels)
    said = ("too many spheres could belong together; they are compared in their files' order",)
    details = {"spheres": counts[0], "center": rounded(center), "radius": rounded(radius)}
    return Difference(
        value, equal=value == 0, details=details, warnings=said if any(level[3] for level in levels) else ()
    )


def _level(first: Spheres, second: Spheres) -> tuple[float, float, float, bool]:
    """Compare one level.

    Returns the greatest distance in a pair and the greatest of its two parts, each over the diagonal, and whether the
    pairs are those of the files' order because there are too many others.
    """
    one, other = scaled_to_unit(np.column_stack(first), np.column_stack(second))
    if np.array_equal(one, other):
        return 0.0, 0.0, 0.0, False
    box = [spheres[:, :3] + sign * spheres[:, 3:] for spheres in (one, other) for sign in (-1, 1)]
    size = bounding_diagonal(np.concatenate(box))
    partners, ordered = _pairs(one, other)
    centers, radii = _parts(one, other[partners])
    return float((centers + radii).max() / size), float(centers.max() / size), float(radii.max() / size), ordered


def _pairs(first: Float64Array, second: Float64Array) -> tuple[Int32Array, bool]:
    """Give each of the first spheres, (n, 4), its own of the second so that the greatest distance is least.

    Returns (n,) numbers, and whether they had to be the files' order: many spheres, far from all others, have too many
    possible partners.
    """
    count = len(first)
    limit = count**2 if count <= _FEW else _PARTNERS * count
    order = np.arange(count, dtype=np.int32)
    most = float(_distances(first, second).max())
    trees = cKDTree(first), cKDTree(second)
    for reach in _reaches(*trees, most):
        if trees[0].count_neighbors(trees[1], reach) > limit:
            return order, True
        near = trees[0].sparse_distance_matrix(trees[1], reach, output_type="ndarray")
        # as a crow flies in four dimensions, so no pair is missing: the distance meant here is never shorter
        one, other = near["i"], near["j"]
        distances = _distances(first[one], second[other])
        found = _matching(one, other, distances <= reach, count)
        if found is not None:
            return _least(one, other, distances, found, reach), False
    return order, False


def _reaches(first: cKDTree, second: cKDTree, most: float) -> Iterator[float]:
    """Yield ever greater distances within which to look for pairs, from the least that is possible up to `most`."""
    reach = max(tree.query(points)[0].max() for tree, points in ((first, second.data), (second, first.data)))
    while reach < most:
        yield float(reach) * _ROUNDING
        reach = max(2 * reach, _FIRST_STEP * most)
    yield most * _ROUNDING


def _least(one: Int32Array, other: Int32Array, distances: Float64Array, found: Int32Array, reach: float) -> Int32Array:
    """Return the pairs of least greatest distance, given some of at most `reach`."""
    steps = np.unique(distances[distances <= reach])
    low, high = 0, len(steps) - 1  # the pairs of steps[high] are known
    while low < high:
        middle = (low + high) // 2
        better = _matching(one, other, distances <= steps[middle], len(found))
        if better is None:
            low = middle + 1
        else:
            high, found = middle, better
    return found


def _matching(one: Int32Array, other: Int32Array, allowed: BoolArray, count: int) -> Int32Array | None:
    """Return a partner for each of `count` spheres, each its own, among the allowed pairs; None where there is none."""
    pairs = csr_array((allowed[allowed], (one[allowed], other[allowed])), shape=(count, count))
    found: Int32Array = maximum_bipartite_matching(pairs, perm_type="column")
    return None if (found < 0).any() else found


def _distances(first: Float64Array, second: Float64Array) -> Float64Array:
    centers, radii = _parts(first, second)
    distances: Float64Array = centers + radii
    return distances


def _parts(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return how far centres are apart, and radii, of (n, 4) spheres."""
    apart = second - first
    return np.linalg.norm(apart[:, :3], axis=1), np.abs(apart[:, 3])
