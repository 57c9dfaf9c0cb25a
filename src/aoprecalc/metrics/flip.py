"""FLIP: how much of a difference an eye sees that looks at two pictures in turn, of grey pictures.

Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator for Alternating Images",
2020, for the low dynamic range. In a grey picture both opponent colours are 0 before and after any filter, so of the
paper's three channels the achromatic one is left.
"""

import numpy as np
from scipy.ndimage import correlate1d

from aoprecalc.types import Float32Array, Float64Array

PIXELS_PER_DEGREE = 67  # of the visual angle: a display 0.7 m wide, of 3840 pixels, seen from 0.7 m

_CONTRAST = 0.0047  # of the eye's sensitivity to grey: the paper's b1, in square degrees
_WIDEST = 0.04  # the same of blue and yellow, by which the paper sizes the filters of all channels
_EDGE_WIDTH = 0.082  # degrees, of the edges and points that an eye notices
_COLOUR_POWER, _FEATURE_POWER = 0.7, 0.5  # the paper's q_c and q_f
_KNEE, _KNEE_VALUE = 0.4, 0.95  # the paper's p_c and p_t: a share of the largest difference, and what it counts
_LARGEST = 41.27610  # HyAB distance of Hunt-adjusted green and blue, to the power q_c: the paper's c_max
_ROWS = 512  # are worked on at a time, so that memory stays small however high a picture is


def flip(first: Float32Array, second: Float32Array, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Float32Array:
    """Return what an eye sees of the difference at each pixel, (h, w) float32 in [0, 1]; 0 where there is none.

    first, second       (h, w), finite, grey as linear light; what lies outside [0, 1] becomes the nearest end
    pixels_per_degree   > 0: of the visual angle

    Black and white are 0.967 apart: only saturated colours reach 1. The order of the pictures does not matter.
    """
    sensitivity = _bell(np.sqrt(_CONTRAST / 2) / np.pi, 3 * np.sqrt(_WIDEST / 2) / np.pi, pixels_per_degree)
    width = _bell(_EDGE_WIDTH / 2, 3 * _EDGE_WIDTH / 2, pixels_per_degree)
    edge, point = _edge(width), _point(width, _EDGE_WIDTH / 2 * pixels_per_degree)
    halo = max(len(sensitivity), len(width)) // 2
    seen = np.empty(first.shape, np.float32)
    for start in range(0, len(first), _ROWS):
        above = max(0, start - halo)
        rows = slice(above, start + _ROWS + halo)
        a, b = (np.clip(picture[rows].astype(np.float64), 0, 1) for picture in (first, second))
        colour = _colour(a, b, sensitivity)
        feature = np.maximum(
            np.abs(_strength(a, edge, width) - _strength(b, edge, width)),
            np.abs(_strength(a, point, width) - _strength(b, point, width)),
        )
        strange = np.clip(feature / np.sqrt(2), 0, 1) ** _FEATURE_POWER
        seen[start : start + _ROWS] = (colour ** (1 - strange))[start - above :][:_ROWS]
    return seen


def _colour(first: Float64Array, second: Float64Array, sensitivity: Float64Array) -> Float64Array:
    """Return how far apart colours, (h, w), are once the eye has blurred them, in [0, 1]."""
    seen, other = (_lightness(_filter(picture, sensitivity, sensitivity)) for picture in (first, second))
    power = np.abs(seen - other) ** _COLOUR_POWER
    knee = _KNEE * _LARGEST
    beyond = _KNEE_VALUE + (power - knee) / (_LARGEST - knee) * (1 - _KNEE_VALUE)
    found: Float64Array = np.where(power < knee, power * (_KNEE_VALUE / knee), beyond)
    return found


def _strength(picture: Float64Array, across: Float64Array, along: Float64Array) -> Float64Array:
    """Return how strong edges or points are in a picture, (h, w), whatever their direction."""
    return np.hypot(_filter(picture, across, along), _filter(picture, along, across))


def _filter(picture: Float64Array, across: Float64Array, along: Float64Array) -> Float64Array:
    """Filter rows by one kernel and columns by another; beyond its border a picture goes on as it ends."""
    rows: Float64Array = correlate1d(picture, across, axis=1, mode="nearest")
    found: Float64Array = correlate1d(rows, along, axis=0, mode="nearest")
    return found


def _lightness(light: Float64Array) -> Float64Array:
    """Return CIE L*, 0 to 100, of linear light, 0 to 1."""
    small = 6 / 29
    root = np.where(light > small**3, np.cbrt(light), light / (3 * small**2) + 4 / 29)
    lightness: Float64Array = 116 * root - 16
    return lightness


def _bell(deviation: float, reach: float, pixels_per_degree: float) -> Float64Array:
    """Return a Gaussian whose weights add up to 1; both numbers are in degrees."""
    radius = int(np.ceil(reach * pixels_per_degree))
    x = np.arange(-radius, radius + 1) / pixels_per_degree
    weights = np.exp(-(x**2) / (2 * deviation**2))
    bell: Float64Array = weights / weights.sum()
    return bell


def _edge(bell: Float64Array) -> Float64Array:
    """Return the first derivative of a Gaussian; what is above 0 adds up to 1, what is below to -1."""
    return _balanced(-_places(bell) * bell)


def _point(bell: Float64Array, deviation: float) -> Float64Array:
    """Return the second derivative of a Gaussian of that deviation, in pixels, balanced in the same way."""
    return _balanced(((_places(bell) / deviation) ** 2 - 1) * bell)


def _places(kernel: Float64Array) -> Float64Array:
    """Return the places of a kernel's weights, in pixels from its middle."""
    radius = len(kernel) // 2
    return np.arange(-radius, radius + 1, dtype=np.float64)


def _balanced(weights: Float64Array) -> Float64Array:
    above, below = weights.clip(min=0), weights.clip(max=0)
    balanced: Float64Array = above / above.sum() - below / below.sum()
    return balanced
