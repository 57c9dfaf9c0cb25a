"""Sphere sets of several finenesses, one above the other."""

import numpy as np

from aoprecalc.model import Ints, SphereSet

_MOST = 1 << 20  # pairs that are measured at a time: bounds memory


def parents(finer: SphereSet, coarser: SphereSet) -> Ints:
    """Return the number of the coarser sphere that each finer one belongs to, (n,) int32.

    That is the one whose surface is nearest to the finer sphere's centre, or lies farthest beyond it.
    """
    found: Ints = np.empty(len(finer), np.int32)
    block = max(1, _MOST // len(coarser))
    for start in range(0, len(finer), block):
        aside = finer.centers[start : start + block, None] - coarser.centers
        found[start : start + block] = np.argmin(np.linalg.norm(aside, axis=2) - coarser.radii, axis=1)
    return found
