"""Interleaved directions: neighbouring texels take different groups of axes, and share what they see.

In a pattern of 3 x 3 texels each takes another of nine groups. Where visibility is smooth, the sums over the 3 x 3
texels around a texel do for those of all groups, at a ninth of the rays. Elsewhere a texel takes the other groups too.

Let d be the mean over the nine minus a texel's own value. It is the error of the texel's group, which texels one period
apart share, and what the mean blurs. So d changes over a period by what is blurred: where that is little, visibility is
smooth.
(Ideas: A. Keller, W. Heidrich, "Interleaved Sampling", 2001; B. Segovia, J.-C. Iehl, R. Mitanchey, B. Péroche,
"Non-interleaved Deferred Shading of Interleaved Sample Patterns", 2006.)
"""

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoprecalc.options.bake import AUTO_DIRECTIONS
from aoprecalc.types import BoolArray, Float32Array, Int32Array, Texels
from aoprecalc.visibility.directions import texel_offset

PERIOD = 3  # texels, along both sides of the texture
GROUPS = PERIOD**2  # of axes
# Where the samples of all groups lie on average in a texel's square.
_RIGHT, _DOWN = np.mean([texel_offset(group) for group in range(GROUPS)], axis=0).tolist()
MEAN_OFFSET: tuple[float, float] = _RIGHT, _DOWN

# RMS change of d over a period up to which visibility is smooth, with AUTO_DIRECTIONS. On four meshes the texture then
# has the error of 1000 directions at all texels, from 3% less to 5% more, at 0.17 to 0.33 of the rays. Up to 0.015 it
# has 0 to 4% less, at 0.23 to 0.42 of the rays.
_MAX_CHANGE = 0.019
_WINDOW = 5  # texels along both sides, over which that RMS is taken
_MIN_COSINE = 0.9  # of the normals of texels that share: creases bend more
_REACH = 1 + PERIOD + _WINDOW // 2  # texels that decide about a texel
_BAND_TEXELS = 1 << 18  # whose rows are looked at at a time: bounds memory
_NO_TEXEL = -1


def group_of_texels(texels: Texels) -> NDArray[np.int8]:
    """Return the group of axes that each of k texels takes, (k,) in 0 .. GROUPS - 1."""
    row, column = np.divmod(texels.index, np.int32(texels.width))
    return np.asarray(row % PERIOD * PERIOD + column % PERIOD, np.int8)


def smooth_change(directions: int) -> float:
    """Return the RMS change of d over a period up to which visibility is smooth: in proportion to the sampling error.

    directions   all that there are; their error falls as N^-3/4
    """
    return _MAX_CHANGE * math.pow(AUTO_DIRECTIONS / directions, 0.75)


def share_sums(
    texels: Texels,
    groups: NDArray[np.int8],
    own: Float32Array,
    normals: NDArray[np.floating],
    halves: Float32Array,
    max_change: float = _MAX_CHANGE,
) -> BoolArray:
    """Store the sums over 3 x 3 texels where visibility is smooth; return where, (k,) bool.

    groups    (k,): see `group_of_texels`
    own       (k, columns): the visibility sums of each texel's group
    normals   (k, 3): the shading normals of the samples, unit vectors
    halves    (2, k, columns): receives those of even and of odd groups
    max_change   see `smooth_change`
    """
    smooth: BoolArray = np.zeros(len(texels), bool)
    if not len(texels):
        return smooth
    number: Int32Array = np.full((texels.height, texels.width), _NO_TEXEL, np.int32)
    number.ravel()[texels.index] = np.arange(len(texels), dtype=np.int32)
    rows_at_once = max(1, _BAND_TEXELS // texels.width)
    for top in range(0, texels.height, rows_at_once):
        start, stop = max(0, top - _REACH), min(top + rows_at_once, texels.height)
        band = number[start : stop + _REACH]
        has_texel = band != _NO_TEXEL
        odd = has_texel & (groups[band] % 2 == 1)
        sums = _images(own, band)
        around = np.stack([_over_window(np.where(half, sums, np.float32(0)), PERIOD) for half in (~odd, odd)])
        shares = _shares_normals(_images(normals, band))
        shares &= _over_window((sums[1] > 0).astype(np.float32), PERIOD) == GROUPS
        change, pairs = _change_over_period(_mean(around.sum(axis=0)) - _mean(sums), shares)
        shares &= (pairs > 0) & (change <= max_change**2 * pairs)
        inner = slice(top - start, stop - start)
        rows = band[inner][shares[inner]]
        smooth[rows] = True
        halves[:, rows] = np.moveaxis(around[:, :, inner][:, :, shares[inner]], 1, -1)
    return smooth


def _images(values: NDArray[np.floating], band: Int32Array) -> Float32Array:
    """Return the columns of values of k texels, (k, columns), as images, (columns, rows, width); 0 without a texel.

    band   (rows, width) int32: which texel lies where
    """
    images: Float32Array = np.empty((values.shape[1], *band.shape), np.float32)
    for image, column in zip(images, values.T, strict=True):
        image[:] = np.where(band == _NO_TEXEL, np.float32(0), column[band])
    return images


def _mean(sums: Float32Array) -> Float32Array:
    """Return the visible share, (rows, width), of sums, (columns, rows, width); 0 without any."""
    visible, total = sums[:2]
    share: Float32Array = np.divide(visible, total, out=np.zeros_like(total), where=total > 0)
    return share


def _over_window(images: Float32Array, side: int) -> Float32Array:
    """Return the sums over windows of side x side texels, of images (..., rows, width)."""
    for axis in (-2, -1):
        images = ndimage.correlate1d(images, np.ones(side), axis, mode="constant")
    return images


def _shares_normals(normals: Float32Array) -> BoolArray:
    """Return which texels have eight neighbours whose normals, (3, rows, width), are much like their own."""
    rows, width = normals.shape[1:]
    alike: BoolArray = np.zeros((rows, width), bool)
    inner = alike[1:-1, 1:-1]
    inner[:] = True
    x, y, z = normals[:, 1:-1, 1:-1]
    for down, right in product(range(PERIOD), repeat=2):
        other = normals[:, down : rows - 2 + down, right : width - 2 + right]
        inner &= x * other[0] + y * other[1] + z * other[2] > _MIN_COSINE
    return alike


def _change_over_period(difference: Float32Array, counts: BoolArray) -> tuple[Float32Array, Float32Array]:
    """Return, summed over a window, the squared changes of an image to the texels one period away, and their number.

    counts   texels whose difference counts
    """
    squares, pairs = np.zeros_like(difference), np.zeros_like(difference)
    for axis in (0, 1):
        size = difference.shape[axis]
        first, second = (
            tuple(part if along == axis else slice(None) for along in (0, 1))
            for part in (slice(0, max(0, size - PERIOD)), slice(PERIOD, size))
        )
        both = counts[first] & counts[second]
        change = np.where(both, difference[first] - difference[second], np.float32(0)) ** 2
        for ends in (first, second):
            squares[ends] += change
            pairs[ends] += both
    return _over_window(squares, _WINDOW), _over_window(pairs, _WINDOW)
