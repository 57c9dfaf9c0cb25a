"""The Z-order curve (G. M. Morton, 1966): an order in which neighbours in space are mostly neighbours in memory."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray, Float32Array, Int32Array, Texels

_BITS = 11  # of a coordinate


def morton_codes(cells: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return where cells, (n, d) whole numbers in 0 .. 2047, d at most 5, come along the curve, (n,) int64."""
    places: NDArray[np.int64] = np.zeros(len(cells), np.int64)
    count = cells.shape[1]
    for axis in range(count):
        for bit in range(_BITS):
            places |= (cells[:, axis].astype(np.int64) >> bit & 1) << (bit * count + axis)
    return places


# What both rasterisers agree on: what a sample is, how the texture is cut into bands, and the rules' numbers.

GRID = 256  # steps a texel: rasterisers snap corners to it
CENTER = (0.5, 0.5)  # where a texel is sampled to tell whether it is covered

# Borders, in texels unless said otherwise.
INSET = 1.0 / 512.0  # a border that runs along a square's side covers nothing of it
INWARD = 0.2  # a border's sample lies this far from the border, inside the face, but
ASIDE = 0.4  # it moves no further than this to get there, and
DEEPEST = 0.3  # no further than this share of the way to the face's third corner
# Depth, in [0, 1], of a border's sample: the first at no distance from where it was wanted, the second more each texel.
BORDER_DEPTH = 0.01  # triangles have depth 0
DISTANCE_DEPTH = 0.4

# The same numbers under the names that the shaders know them by.
BORDER_RULES = {
    "INSET": INSET,
    "INWARD": INWARD,
    "ASIDE": ASIDE,
    "DEEPEST": DEEPEST,
    "BORDER_DEPTH": BORDER_DEPTH,
    "DISTANCE_DEPTH": DISTANCE_DEPTH,
}

BAND_TEXELS = 1 << 22  # texels drawn at a time: bounds memory
_BLOCK = 16  # texels a side; measured: the gather is a tenth to a quarter faster than in rows


@dataclass(frozen=True, eq=False)
class Samples:
    """Where on the surface the sample of each covered texel lies.

    faces     (k,) int32, -1 where the texel has no sample at this spot
    weights   (k, 3) float32, barycentric, >= 0, sum 1; (1, 0, 0) where there is no sample
    """

    faces: Int32Array
    weights: Float32Array


def keep_faces(samples: Samples, faces: BoolArray) -> Samples:
    """Return the samples without those that lie on other faces than these, (f,) bool."""
    away = (samples.faces < 0) | ~faces[samples.faces]
    weights = np.where(away[:, None], np.array((1, 0, 0), np.float32), samples.weights)
    return Samples(np.where(away, np.int32(-1), samples.faces), weights)


class Rasterizer(Protocol):
    """Finds the surface under the texels of a layout. GLRasterizer uses OpenGL, CPURasterizer does not."""

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        ...

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        ...

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return what lies under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        ...


def row_bands(width: int, height: int) -> list[tuple[int, int]]:
    """Cut a texture into runs of whole rows that are drawn at a time: the first row of each, and how many there are.

    Each has at most BAND_TEXELS texels, or one row. Only the last may have fewer rows than the first.
    """
    rows = min(height, max(1, BAND_TEXELS // width))
    return [(row, min(rows, height - row)) for row in range(0, height, rows)]


def order_in_blocks(index: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Order texels by squares of the picture along a Z-order curve: neighbours read the same part of a map."""
    row, column = (at // _BLOCK for at in np.divmod(index, width))
    across = -(-width // _BLOCK)
    blocks = np.column_stack(np.divmod(np.arange(across * (int(row.max(initial=0)) + 1)), across))
    return index[np.argsort(morton_codes(blocks)[row * across + column], kind="stable")]


def clamp_barycentric(weights: Float32Array) -> Float32Array:
    """Return all three weights, (n, 3), of points moved onto their face, from (2, n): those of the last two corners."""
    second, third = np.maximum(weights, 0)
    total = np.maximum(1, second + third)
    second, third = second / total, third / total
    return np.stack([np.maximum(1 - second - third, 0), second, third], axis=1)
