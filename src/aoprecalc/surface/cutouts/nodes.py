"""Triangles that are quartered again and again, and straight lines through them.

A node is a row of five int32: the number of its triangle, how often its sides were halved, i, j, and 1 or -1. In its
own sides along 0-1 and 0-2 of the triangle its corners are at (i, j), (i +- 1, j) and (i, j +- 1).
"""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles, Ints

Indices = NDArray[np.int64]

SPECK = 1e-12  # of a length or an area, which is none

_CORNERS = np.array([(0, 0), (1, 0), (0, 1)], np.int32)
_QUARTERS = np.array([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, -1)], np.int32)


def quarters_of(nodes: Ints) -> Ints:
    """Return the four quarters of each of (m, 5) nodes one after the other, (4 m, 5)."""
    quarters = np.repeat(nodes, 4, axis=0).reshape(-1, 4, 5)
    side = nodes[:, None, 4:]
    quarters[:, :, 1] += 1
    quarters[:, :, 2:4] = 2 * nodes[:, None, 2:4] + side * _QUARTERS[:, :2]
    quarters[:, :, 4:] *= _QUARTERS[:, 2:]
    every: Ints = quarters.reshape(-1, 5)
    return every


def quartered(values: Doubles) -> Doubles:
    """Return the values at the corners of the quarters, (m, 4, 3), from those at the corners of the wholes, (m, 3)."""
    a, b, c = values.T
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, bc, ca, ab], axis=1).reshape(-1, 4, 3)


def parted(values: Doubles) -> tuple[Indices, Doubles]:
    """Tell how a line parts triangles, by values at their corners, (..., 3), of both signs.

    Returns the corners in turn, (..., 3), from the one that it parts from two, and how far from that it meets the sides
    to the others, (..., 2), as shares of these.
    """
    opaque = values >= 0
    lonely = np.where(opaque.sum(axis=-1) == 1, opaque.argmax(axis=-1), opaque.argmin(axis=-1))
    turn: Indices = (lonely[..., None] + np.arange(3)) % 3
    turned = np.take_along_axis(values, turn, axis=-1)
    return turn, turned[..., :1] / (turned[..., :1] - turned[..., 1:])


def opaque_share(values: Doubles) -> Doubles:
    """Return how much of a triangle, (...), has no negative value, from those at its corners, (..., 3)."""
    count = (values >= 0).sum(axis=-1)
    shares: Doubles = count / 3
    cut = count % 3 > 0
    corner = parted(values[cut])[1].prod(axis=-1)
    shares[cut] = np.where(count[cut] == 1, corner, 1 - corner)
    return shares


def with_share(values: Doubles, shares: Doubles) -> Doubles:
    """Shift the values at the corners of triangles, (m, 3), so that none is negative in just (m,) shares of them."""
    values = np.where(np.ptp(values, axis=1, keepdims=True) > 0, values, (-1.0, 0.0, 1.0))
    low, middle, high = np.sort(values, axis=1).T
    from_high = high - np.sqrt(shares * (high - middle) * (high - low))
    from_low = low + np.sqrt((1 - shares) * (middle - low) * (high - low))
    level = np.where(shares * (high - low) <= high - middle, from_high, from_low)[:, None]
    whole = np.where(shares > 0, 1.0, -1.0)[:, None]
    return np.where(((shares > 0) & (shares < 1))[:, None], values - level, whole)


def node_places(nodes: Ints) -> Doubles:
    """Return the corners of (m, 5) nodes, (m, 3, 2), as weights of the corners 1 and 2 of their triangles."""
    corners = nodes[:, None, 2:4] + nodes[:, None, 4:] * _CORNERS
    places: Doubles = np.ldexp(corners.astype(np.float64), -nodes[:, None, 1:2])
    return places


def weighted(corners: Doubles, places: Doubles) -> Doubles:
    """Interpolate what (m, 3, x) triangles have at their corners at (m, k, 2) places, (m, k, x)."""
    a, b, c = (corners[:, None, k] for k in range(3))
    one, two = places[..., :1], places[..., 1:]
    return (1 - one - two) * a + one * b + two * c


# The middles of a triangle's sixteenths: places, (16, 2), and weights of all three corners, (16, 3).
MIDDLES = node_places(quarters_of(quarters_of(np.array([(0, 0, 0, 0, 1)], np.int32)))).mean(axis=1)
MIDDLE_WEIGHTS = weighted(np.eye(3)[None], MIDDLES[None])[0]
