"""FLIP, a perceptual difference of two pictures shown in alternation, for grey pictures.

Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, FLIP: A Difference Evaluator for Alternating Images,
2020, for low dynamic range. Both opponent colour channels of a grey picture are 0 before and after any filter, so only
the achromatic channel remains.
"""

import numpy as np
from scipy.ndimage import correlate1d

from aoprecalc.types import Float32Array, Float64Array

PIXELS_PER_DEGREE = 67  # of visual angle: a display 0.7 m wide, of 3840 pixels, at a distance of 0.7 m

_CSF_B = 0.0047  # contrast sensitivity of the achromatic channel: the paper's b1, in square degrees
_MAX_CSF_B = 0.04  # the same of the blue-yellow channel, which determines the filter size of all channels
_FEATURE_WIDTH = 0.082  # degrees, of the edges and points that are detected
_QC, _QF = 0.7, 0.5  # exponents of colour and feature differences
_PC, _PT = 0.4, 0.95  # knee of the colour error: fraction of the maximum difference, and the error assigned to it
_CMAX = 41.27610  # HyAB distance of Hunt-adjusted green and blue, to the power q_c: the paper's c_max
_CHUNK_ROWS = 512  # processed at once, to bound memory


def flip(first: Float32Array, second: Float32Array, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Float32Array:
    """Return the perceived difference of two pictures at each pixel, (h, w) float32 in [0, 1].

    first, second       (h, w), finite, linear grey; clamped to [0, 1]
    pixels_per_degree   > 0: of visual angle

    The difference of black and white is 0.967: only saturated colours reach 1. FLIP is symmetric.
    """
    csf = _gaussian(np.sqrt(_CSF_B / 2) / np.pi, 3 * np.sqrt(_MAX_CSF_B / 2) / np.pi, pixels_per_degree)
    feature_sigma = _FEATURE_WIDTH / 2
    gaussian = _gaussian(feature_sigma, 3 * feature_sigma, pixels_per_degree)
    edge, point = _edge_kernel(gaussian), _point_kernel(gaussian, feature_sigma * pixels_per_degree)
    halo = max(len(csf), len(gaussian)) // 2
    result = np.empty(first.shape, np.float32)
    for start in range(0, len(first), _CHUNK_ROWS):
        top = max(0, start - halo)
        rows = slice(top, start + _CHUNK_ROWS + halo)
        a, b = (np.clip(picture[rows].astype(np.float64), 0, 1) for picture in (first, second))
        colour = _colour_difference(a, b, csf)
        feature = np.maximum(
            np.abs(_feature_magnitude(a, edge, gaussian) - _feature_magnitude(b, edge, gaussian)),
            np.abs(_feature_magnitude(a, point, gaussian) - _feature_magnitude(b, point, gaussian)),
        )
        feature = np.clip(feature / np.sqrt(2), 0, 1) ** _QF
        result[start : start + _CHUNK_ROWS] = (colour ** (1 - feature))[start - top :][:_CHUNK_ROWS]
    return result


def _colour_difference(first: Float64Array, second: Float64Array, csf: Float64Array) -> Float64Array:
    """Return the colour difference of pictures, (h, w) in [0, 1], after the contrast sensitivity filter."""
    a, b = (_lightness(_filter(picture, csf, csf)) for picture in (first, second))
    power = np.abs(a - b) ** _QC
    knee = _PC * _CMAX
    above = _PT + (power - knee) / (_CMAX - knee) * (1 - _PT)
    difference: Float64Array = np.where(power < knee, power * (_PT / knee), above)
    return difference


def _feature_magnitude(picture: Float64Array, kernel: Float64Array, gaussian: Float64Array) -> Float64Array:
    """Return the magnitude of edges or points in a picture, (h, w), in any direction."""
    return np.hypot(_filter(picture, kernel, gaussian), _filter(picture, gaussian, kernel))


def _filter(picture: Float64Array, x_kernel: Float64Array, y_kernel: Float64Array) -> Float64Array:
    """Filter a picture by a separable kernel; pixels outside repeat the border."""
    rows: Float64Array = correlate1d(picture, x_kernel, axis=1, mode="nearest")
    filtered: Float64Array = correlate1d(rows, y_kernel, axis=0, mode="nearest")
    return filtered


def _lightness(luminance: Float64Array) -> Float64Array:
    """Return CIE L*, 0 to 100, of linear luminance, 0 to 1."""
    delta = 6 / 29
    root = np.where(luminance > delta**3, np.cbrt(luminance), luminance / (3 * delta**2) + 4 / 29)
    lightness: Float64Array = 116 * root - 16
    return lightness


def _gaussian(sigma: float, radius: float, pixels_per_degree: float) -> Float64Array:
    """Return a Gaussian kernel of sum 1; `sigma` and `radius` are in degrees."""
    x = _offsets(int(np.ceil(radius * pixels_per_degree))) / pixels_per_degree
    weights = np.exp(-(x**2) / (2 * sigma**2))
    gaussian: Float64Array = weights / weights.sum()
    return gaussian


def _edge_kernel(gaussian: Float64Array) -> Float64Array:
    """Return the first derivative of a Gaussian, scaled so that positive weights sum to 1 and negative ones to -1."""
    return _balanced(-_offsets(len(gaussian) // 2) * gaussian)


def _point_kernel(gaussian: Float64Array, sigma: float) -> Float64Array:
    """Return the second derivative of a Gaussian, `sigma` in pixels, scaled in the same way."""
    return _balanced(((_offsets(len(gaussian) // 2) / sigma) ** 2 - 1) * gaussian)


def _offsets(radius: int) -> Float64Array:
    """Return the offsets of a kernel's weights from its centre, in pixels."""
    return np.arange(-radius, radius + 1, dtype=np.float64)


def _balanced(weights: Float64Array) -> Float64Array:
    positive, negative = weights.clip(min=0), weights.clip(max=0)
    balanced: Float64Array = positive / positive.sum() - negative / negative.sum()
    return balanced
