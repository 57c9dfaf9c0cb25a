"""Two pictures of ambient occlusion side by side with what differs: A, B, B - A, and what an eye sees of that."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.measure.difference import Pair
from aoprecalc.measure.heat_map import NO_SURFACE, signed_colors
from aoprecalc.model import Doubles, Floats

LEAST, MOST = 256, 1024  # pixels on the longer side of a tile
GAP = 8  # pixels between tiles, and around them


def comparison_picture(pair: Pair) -> NDArray[np.uint8]:
    """Put tiles side by side on a dark ground; returns (height, width, 3) RGB.

    The tiles are A and B as they are stored, 0 black and 1 white; B - A, blue where B is darker, red where it is
    brighter, in full colour at 0.1 (see measure/heat_map.py); and FLIP, 0 black by red and yellow to 1 white. Of
    pictures of different sizes there are but the first two.
    """
    first, second = _fit(pair.first), _fit(pair.second)
    tiles = [_grey(first), _grey(second)]
    if pair.flip is not None:
        tiles += [signed_colors(second - first), _glow(_fit(pair.flip))]
    height = max(len(tile) for tile in tiles) + 2 * GAP
    width = sum(tile.shape[1] + GAP for tile in tiles) + GAP
    picture: NDArray[np.uint8] = np.full((height, width, 3), NO_SURFACE, np.uint8)
    left = GAP
    for tile in tiles:
        picture[GAP : GAP + len(tile), left : left + tile.shape[1]] = tile
        left += tile.shape[1] + GAP
    return picture


def _fit(values: Floats) -> Doubles:
    """Return a picture, (h, w), in larger pixels if it is small, in fewer, the means of blocks, if it is large."""
    longer = max(values.shape)
    if longer < LEAST:
        times = -(-LEAST // longer)
        return values.astype(np.float64).repeat(times, axis=0).repeat(times, axis=1)
    side = -(-longer // MOST)
    return _means(_means(values, side, 0), side, 1)


def _means(values: Floats | Doubles, side: int, axis: int) -> Doubles:
    """Return the means of runs of `side` values along an axis; the last run may be shorter."""
    starts = np.arange(0, values.shape[axis], side)
    counts = np.diff([*starts, values.shape[axis]])
    sums: Doubles = np.add.reduceat(values, starts, axis=axis, dtype=np.float64)
    return sums / (counts[:, None] if axis == 0 else counts)


def _grey(values: Doubles) -> NDArray[np.uint8]:
    return _bytes(values[:, :, None].repeat(3, axis=2))


def _glow(values: Doubles) -> NDArray[np.uint8]:
    """Paint values of [0, 1]: red grows to its most first, then green, then blue."""
    return _bytes(3 * values[:, :, None] - (0, 1, 2))


def _bytes(colors: Doubles) -> NDArray[np.uint8]:
    return np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)
