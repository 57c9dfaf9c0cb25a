"""A picture of where a texture is too bright and where it is too dark."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.metrics import PicturePair
from aoprecalc.types import Float32Array, Float64Array, Texels

FULL = 0.1  # the error that has full colour
BACKGROUND = (48, 48, 48)
HEAT_MAP_MIN_SIZE, HEAT_MAP_MAX_SIZE = 512, 2048  # texels on the longer side


def heat_map_size(width: int, height: int) -> tuple[int, int]:
    """Return the width and height of the heat map for a texture: its own, doubled or halved if very small or large."""
    while max(width, height) < HEAT_MAP_MIN_SIZE:
        width, height = 2 * width, 2 * height
    while max(width, height) > HEAT_MAP_MAX_SIZE:
        width, height = max(1, width // 2), max(1, height // 2)
    return width, height


def error_heat_map(texels: Texels, uvs: Float64Array, errors: Float64Array, *, repeats: bool) -> NDArray[np.uint8]:
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
    picture[:] = BACKGROUND
    picture.reshape(-1, 3)[texels.index] = diverging_colors(errors)[nearest]
    return picture


def diverging_colors(errors: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Paint errors of any shape, (...): blue below 0, white at 0, red above; returns (..., 3) RGB."""
    share = np.clip(errors / FULL, -1, 1)
    red, blue = np.minimum(1 + share, 1), np.minimum(1 - share, 1)
    return np.floor(np.stack([red, np.minimum(red, blue), blue], axis=-1) * 255 + 0.5).astype(np.uint8)


# Two pictures of ambient occlusion side by side with what differs: A, B, B - A, and what an eye sees of that.

TILE_MIN_SIZE, TILE_MAX_SIZE = 256, 1024  # pixels on the longer side of a tile
GAP = 8  # pixels between tiles, and around them


def comparison_picture(pair: PicturePair) -> NDArray[np.uint8]:
    """Put tiles side by side on a dark ground; returns (height, width, 3) RGB.

    The tiles are A and B as they are stored, 0 black and 1 white; B - A, blue where B is darker, red where it is
    brighter, in full colour at 0.1 (see measure/heat_map.py); and FLIP, 0 black by red and yellow to 1 white. Of
    pictures of different sizes there are but the first two.
    """
    first, second = _fit(pair.first), _fit(pair.second)
    tiles = [_grey(first), _grey(second)]
    if pair.flip is not None:
        tiles += [diverging_colors(second - first), _glow(_fit(pair.flip))]
    height = max(len(tile) for tile in tiles) + 2 * GAP
    width = sum(tile.shape[1] + GAP for tile in tiles) + GAP
    picture: NDArray[np.uint8] = np.full((height, width, 3), BACKGROUND, np.uint8)
    left = GAP
    for tile in tiles:
        picture[GAP : GAP + len(tile), left : left + tile.shape[1]] = tile
        left += tile.shape[1] + GAP
    return picture


def _fit(values: Float32Array) -> Float64Array:
    """Return a picture, (h, w), in larger pixels if it is small, in fewer, the means of blocks, if it is large."""
    longer = max(values.shape)
    if longer < TILE_MIN_SIZE:
        times = -(-TILE_MIN_SIZE // longer)
        return values.astype(np.float64).repeat(times, axis=0).repeat(times, axis=1)
    side = -(-longer // TILE_MAX_SIZE)
    return _means(_means(values, side, 0), side, 1)


def _means(values: Float32Array | Float64Array, side: int, axis: int) -> Float64Array:
    """Return the means of runs of `side` values along an axis; the last run may be shorter."""
    starts = np.arange(0, values.shape[axis], side)
    counts = np.diff([*starts, values.shape[axis]])
    sums: Float64Array = np.add.reduceat(values, starts, axis=axis, dtype=np.float64)
    return sums / (counts[:, None] if axis == 0 else counts)


def _grey(values: Float64Array) -> NDArray[np.uint8]:
    return _bytes(values[:, :, None].repeat(3, axis=2))


def _glow(values: Float64Array) -> NDArray[np.uint8]:
    """Paint values of [0, 1]: red grows to its most first, then green, then blue."""
    return _bytes(3 * values[:, :, None] - (0, 1, 2))


def _bytes(colors: Float64Array) -> NDArray[np.uint8]:
    return np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)
