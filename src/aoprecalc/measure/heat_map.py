"""A picture of where a texture is too bright and where it is too dark."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.model import Doubles, Texels

FULL = 0.1  # the error that has full colour
NO_SURFACE = (48, 48, 48)
LEAST, MOST = 512, 2048  # texels on the longer side


def heat_map_size(width: int, height: int) -> tuple[int, int]:
    """Return the width and height of the heat map for a texture: its own, doubled or halved if very small or large."""
    while max(width, height) < LEAST:
        width, height = 2 * width, 2 * height
    while max(width, height) > MOST:
        width, height = max(1, width // 2), max(1, height // 2)
    return width, height


def paint(texels: Texels, uvs: Doubles, errors: Doubles, *, repeats: bool) -> NDArray[np.uint8]:
    """Paint errors, (k,) texture minus reference, at (k, 2) UVs; returns (height, width, 3) RGB, row 0 at v = 1.

    Each of the surface's `texels` shows the error of the point nearest to it in texture space: blue where the texture
    is too dark, white where it is right, red where it is too bright.
    """
    size = np.array([texels.width, texels.height], np.float64)
    places = (uvs * (1, -1) + (0, 1)) * size
    if repeats:
        places = np.mod(places, size)
        places[places >= size] = 0  # what rounding left at the end is the beginning
    row, column = np.divmod(texels.index, texels.width)
    tree = cKDTree(places, boxsize=size if repeats else None)
    nearest = tree.query(np.column_stack([column, row]) + 0.5, workers=-1)[1]
    picture: NDArray[np.uint8] = np.empty((texels.height, texels.width, 3), np.uint8)
    picture[:] = NO_SURFACE
    picture.reshape(-1, 3)[texels.index] = signed_colors(errors)[nearest]
    return picture


def signed_colors(errors: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Paint errors of any shape, (...): blue below 0, white at 0, red above; returns (..., 3) RGB."""
    share = np.clip(errors / FULL, -1, 1)
    red, blue = np.minimum(1 + share, 1), np.minimum(1 - share, 1)
    return np.floor(np.stack([red, np.minimum(red, blue), blue], axis=-1) * 255 + 0.5).astype(np.uint8)
