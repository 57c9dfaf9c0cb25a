"""Sphere sets of several finenesses, one above the other."""

import numpy as np

from aoprecalc.model import Ints, SphereSet


def parents(finer: SphereSet, coarser: SphereSet) -> Ints:
    """Return the number of the coarser sphere that each finer one belongs to, (n,) int32.

    That is the one whose surface is nearest to the finer sphere's centre, or lies farthest beyond it.
    """
    away = np.linalg.norm(finer.centers[:, None] - coarser.centers, axis=2) - coarser.radii
    found: Ints = np.argmin(away, axis=1).astype(np.int32)
    return found
