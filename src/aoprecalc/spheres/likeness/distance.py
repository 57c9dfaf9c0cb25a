"""How far points are from the surface of a set of spheres."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.model import Doubles

_FEW = (
    24  # spheres that are all measured at every point; more are looked up: at 40 in two thirds of the time (measured)
)
_LISTED = 24  # centres that are looked up first
_BLOCK = 1 << 14  # points at a time, so that what is measured stays in the processor's cache


def signed_distances(points: Doubles, centers: Doubles, radii: Doubles) -> Doubles:
    """Return the least of |p - c| - r over n spheres for each of k points, (k,) float64: negative inside any.

    Outside it is the distance to the union of the spheres.
    """
    nearest = np.empty(len(points))
    if len(radii) <= _FEW:
        _measure_all(points, centers, radii, nearest)
        return nearest
    tree, largest = cKDTree(centers), radii.max()
    for start in range(0, len(points), _BLOCK):
        some = points[start : start + _BLOCK]
        distances, listed = tree.query(some, _LISTED)
        found = (distances - radii[listed]).min(axis=1)
        unsure = np.flatnonzero(found > distances[:, -1] - largest)  # a centre that is not listed may be nearer by this
        if len(unsure):
            exact = np.empty(len(unsure))
            _measure_all(some[unsure], centers, radii, exact)
            found[unsure] = exact
        nearest[start : start + _BLOCK] = found
    return nearest


def _measure_all(points: Doubles, centers: Doubles, radii: Doubles, nearest: Doubles) -> None:
    block = max(1, (_BLOCK * _FEW) // len(radii))
    for start in range(0, len(points), block):
        some = points[start : start + block]
        squared = np.square(some[:, None] - centers).sum(axis=2) if len(radii) < 4 else _squared(some, centers)
        nearest[start : start + block] = (np.sqrt(squared) - radii).min(axis=1)


def _squared(points: Doubles, centers: Doubles) -> Doubles:
    """(k, n) float64: squared distances, plainly, as the matrix product would lose half of the digits nearby."""
    squared: Doubles = np.square(points[:, :1] - centers[:, 0])
    for axis in (1, 2):
        squared += np.square(points[:, axis : axis + 1] - centers[:, axis])
    return squared
