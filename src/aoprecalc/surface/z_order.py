"""The Z-order curve (G. M. Morton, 1966): an order in which neighbours in space are mostly neighbours in memory."""

import numpy as np
from numpy.typing import NDArray

_BITS = 11  # of a coordinate


def z_order(cells: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return where cells, (n, d) whole numbers in 0 .. 2047, d at most 5, come along the curve, (n,) int64."""
    places: NDArray[np.int64] = np.zeros(len(cells), np.int64)
    count = cells.shape[1]
    for axis in range(count):
        for bit in range(_BITS):
            places |= (cells[:, axis].astype(np.int64) >> bit & 1) << (bit * count + axis)
    return places
