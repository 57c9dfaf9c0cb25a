"""Differences of results that are no pictures: sphere sets in any order of their spheres, and JSON documents."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching
from scipy.spatial import cKDTree

from aoprecalc.errors import counted, one_or_many
from aoprecalc.metrics.difference import Difference, bounding_diagonal, incomparable, rounded, scaled_to_unit
from aoprecalc.types import BoolArray, Float64Array, Int32Array

Spheres = tuple[Float64Array, Float64Array]

_ALL_PAIRS_UP_TO = 2000  # spheres; for more, the number of candidate pairs is limited
_MAX_CANDIDATES = 16  # candidate partners per sphere, on average, to bound time and memory
_FIRST_STEP = 1 / 1024  # first increase of the search radius / maximum distance in file order
_ROUNDING = 1 + 1e-12  # of distances, which k-d trees compare as squares


def spheres_difference(first: Sequence[Spheres], second: Sequence[Spheres]) -> Difference:
    """Compare sphere sets, each with one or more levels of (centers (n, 3), radii (n,)) float64, finite, n >= 1.

    The spheres of a level are paired one to one so that the maximum distance of a pair is minimal (a bottleneck
    matching). The distance of two spheres is the distance of their centres + the difference of their radii. The value
    is the maximum over all levels of that distance / the bounding box diagonal of both sets.
    """
    counts = [[len(radii) for _, radii in levels] for levels in (first, second)]
    if counts[0] != counts[1]:
        texts = (", ".join(map(str, count)) for count in counts)
        return incomparable(f"they have {' and '.join(texts)} spheres", spheres=counts)
    levels = [_level_difference(a, b) for a, b in zip(first, second, strict=True)]
    value, center, radius, _ = max(levels)
    warnings: tuple[str, ...] = ()
    if any(in_file_order for *_, in_file_order in levels):
        warnings = ("too many spheres have several possible partners; spheres are compared in file order instead",)
    details = {"spheres": counts[0], "center": rounded(center), "radius": rounded(radius)}
    return Difference(value, equal=value == 0, details=details, warnings=warnings)


def _level_difference(first: Spheres, second: Spheres) -> tuple[float, float, float, bool]:
    """Compare one level.

    Returns the maximum distance, the maximum distance of centres and the maximum difference of radii over all pairs,
    each / bounding box diagonal, and whether spheres were paired in file order because there are too many candidates.
    """
    a, b = scaled_to_unit(np.column_stack(first), np.column_stack(second))
    if np.array_equal(a, b):
        return 0.0, 0.0, 0.0, False
    boxes = [spheres[:, :3] + sign * spheres[:, 3:] for spheres in (a, b) for sign in (-1, 1)]
    size = bounding_diagonal(np.concatenate(boxes))
    partners, in_file_order = _pair_up(a, b)
    centers, radii = _center_radius_distances(a, b[partners])
    return float((centers + radii).max() / size), float(centers.max() / size), float(radii.max() / size), in_file_order


def _pair_up(first: Float64Array, second: Float64Array) -> tuple[Int32Array, bool]:
    """Assign each first sphere, (n, 4), a partner among the second so that the maximum distance is minimal.

    Returns (n,) indices, and whether they are in file order because large sets far apart have too many candidates.
    """
    count = len(first)
    max_candidates = count**2 if count <= _ALL_PAIRS_UP_TO else _MAX_CANDIDATES * count
    file_order = np.arange(count, dtype=np.int32)
    max_distance = float(_distances(first, second).max())
    trees = cKDTree(first), cKDTree(second)
    for radius in _search_radii(*trees, max_distance):
        if trees[0].count_neighbors(trees[1], radius) > max_candidates:
            return file_order, True
        # The Euclidean distance in four dimensions is never greater than ours, so no candidate is missing.
        near = trees[0].sparse_distance_matrix(trees[1], radius, output_type="ndarray")
        i, j = near["i"], near["j"]
        distances = _distances(first[i], second[j])
        partners = _matching(i, j, distances <= radius, count)
        if partners is not None:
            return _bottleneck_matching(i, j, distances, partners, radius), False
    return file_order, False


def _search_radii(first: cKDTree, second: cKDTree, max_distance: float) -> Iterator[float]:
    """Yield increasing search radii, from the least that may allow a matching to `max_distance`."""
    radius = max(tree.query(points)[0].max() for tree, points in ((first, second.data), (second, first.data)))
    while radius < max_distance:
        yield float(radius) * _ROUNDING
        radius = max(2 * radius, _FIRST_STEP * max_distance)
    yield max_distance * _ROUNDING


def _bottleneck_matching(
    i: Int32Array, j: Int32Array, distances: Float64Array, partners: Int32Array, radius: float
) -> Int32Array:
    """Return the partners of least maximum distance by bisection, given partners within `radius`."""
    candidates = np.unique(distances[distances <= radius])
    low, high = 0, len(candidates) - 1  # partners within candidates[high] are known
    while low < high:
        middle = (low + high) // 2
        better = _matching(i, j, distances <= candidates[middle], len(partners))
        if better is None:
            low = middle + 1
        else:
            high, partners = middle, better
    return partners


def _matching(i: Int32Array, j: Int32Array, allowed: BoolArray, count: int) -> Int32Array | None:
    """Return a perfect matching of `count` spheres by the allowed pairs, (count,) partners; None if none exists."""
    pairs = csr_array((allowed[allowed], (i[allowed], j[allowed])), shape=(count, count))
    partners: Int32Array = maximum_bipartite_matching(pairs, perm_type="column")
    return None if (partners < 0).any() else partners


def _distances(first: Float64Array, second: Float64Array) -> Float64Array:
    centers, radii = _center_radius_distances(first, second)
    distances: Float64Array = centers + radii
    return distances


def _center_radius_distances(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the distances of centres and the absolute differences of radii of spheres, (n, 4) each."""
    offsets = second - first
    return np.linalg.norm(offsets[:, :3], axis=1), np.abs(offsets[:, 3])


# JSON documents.

IGNORED_KEYS = frozenset({"seconds", "version", "renderer", "path", "outputs"})  # depend on the time or the machine
_MAX_LISTED = 10  # differing leaves in the details

_MISSING = object()


def document_difference(first: Any, second: Any) -> Difference:
    """Compare JSON documents leaf by leaf, except what is under a key of IGNORED_KEYS.

    The value is the maximum of |a - b| / max(1, |a|, |b|) over numbers. Documents that differ in anything else, such as
    texts, keys or the lengths of lists, are incomparable.
    """
    numbers, value, places, others = 0, 0.0, [], []
    for path, a, b in _leaves(first, second):
        difference = _leaf_difference(a, b)
        numbers += _is_number(a) and _is_number(b)
        if difference != 0:
            value = max(value, difference or 0.0)
            places.append({"at": path, "a": _leaf_summary(a), "b": _leaf_summary(b)})
            others += [path] if difference is None else []
    details = {
        "numbers": numbers,
        "differing": len(places),
        "value": rounded(value),
        "places": places[:_MAX_LISTED],
    }
    if others:
        count = f"{counted(len(others), 'place')} {one_or_many(len(others), 'differs', 'differ')}"
        return incomparable(f"{count} in more than a number, the first at {others[0]}", None, **details)
    return Difference(value, equal=not places, details=details)


def _leaves(first: Any, second: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path of each leaf and its value in either document, in the order of the first.

    Lists of different lengths and values that only one document has are leaves.
    """
    stack: list[tuple[str, Any, Any]] = [("", first, second)]  # no recursion, as documents may be nested deeply
    while stack:
        path, a, b = stack.pop()
        if isinstance(a, dict) and isinstance(b, dict):
            keys = [key for key in {**a, **b} if key not in IGNORED_KEYS]
            children = [(f"{path}.{key}".lstrip("."), a.get(key, _MISSING), b.get(key, _MISSING)) for key in keys]
            stack += reversed(children)
        elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
            stack += reversed([(f"{path}[{index}]", *items) for index, items in enumerate(zip(a, b, strict=True))])
        else:
            yield path, a, b


def _leaf_difference(a: Any, b: Any) -> float | None:
    """Return the relative difference of two leaves; None if they differ and are not both finite numbers."""
    if _is_number(a) and _is_number(b):
        if a == b:
            return 0.0
        try:
            difference = abs(a - b) / max(1, abs(a), abs(b))
        except OverflowError:  # integers may have any number of digits
            return None
        return float(difference) if math.isfinite(difference) else None
    return 0.0 if type(a) is type(b) and a == b else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _leaf_summary(value: Any) -> Any:
    """Return a leaf for a report: containers by their size, long texts cut, None if it is missing."""
    if value is _MISSING:
        return None
    if isinstance(value, dict | list):
        return counted(len(value), "key" if isinstance(value, dict) else "value")
    if isinstance(value, str):
        return value if len(value) <= 80 else f"{value[:77]}..."
    return value
