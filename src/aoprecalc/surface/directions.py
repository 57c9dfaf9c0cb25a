"""Unit vectors spread evenly over the half sphere: each stands for itself and its opposite.

(The spherical Fibonacci lattice: R. Swinbank and R. J. Purser, "Fibonacci grids", 2006.)
"""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_TURN = 0.137  # of a whole one: keeps the first axes away from the planes in which people model


def half_sphere(index: NDArray[np.int64], count: int, turn: float = 0.0) -> Doubles:
    """Return the points number `index`, of any shape, of the lattice of `count`, (..., 3) float64.

    turn   of the lattice about z, as a share of a whole one: lattices of different turns have no point in common
    """
    z = (index + 0.5) / count
    angle = 2.0 * np.pi * ((index * GOLDEN + _TURN + turn) % 1.0)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=-1)
