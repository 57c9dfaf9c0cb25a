"""The centres that the iteration starts from."""

import numpy as np

from aoprecalc.model import Doubles
from aoprecalc.options import Init


def starts(points: Doubles, count: int, init: Init, rng: np.random.Generator) -> Doubles:
    """Choose `count` of the samples, (s, 3) float64 with at least that many distinct ones, as the first centres.

    first      the first samples (algorithm 1.2.1 of *Précalcul*)
    kmeans++   one at random, then each with a probability in proportion to its squared distance to the nearest
               one chosen so far (Arthur and Vassilvitskii, k-means++: the advantages of careful seeding, 2007)

    Returns (count, 3) float64.
    """
    return points[:count].copy() if init == "first" else _spread(points, count, rng)


def _spread(points: Doubles, count: int, rng: np.random.Generator) -> Doubles:
    columns = np.ascontiguousarray(points.T)
    chosen = [int(rng.integers(len(points)))]
    squared = np.full(len(points), np.inf)
    for dart in rng.random(count - 1):
        x, y, z = columns - points[chosen[-1], :, None]
        np.minimum(squared, x * x + y * y + z * z, out=squared)
        upto = np.cumsum(squared)
        chosen.append(int(np.searchsorted(upto, min(dart * upto[-1], np.nextafter(upto[-1], 0)), side="right")))
    return points[chosen]
