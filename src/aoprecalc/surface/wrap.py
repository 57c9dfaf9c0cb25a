"""What a texture does beyond its edges."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Wrap

Indices = NDArray[np.int64]


def wrapped(index: Indices, size: int | Indices, wrap: Wrap) -> Indices:
    """Return which of `size` texels stands at any index along an axis."""
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "repeat":
        return index % size
    turned = index % (2 * size)
    mirrored: Indices = np.minimum(turned, 2 * size - 1 - turned)
    return mirrored
