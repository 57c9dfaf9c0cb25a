"""What both rasterizers of texture space share: surface samples, the order of texels, bands, and the border rules."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray, Float32Array, Int32Array, Int64Array, Texels

GRID = 256  # subpixel steps in a texel, to which rasterizers snap corners
CENTER = (0.5, 0.5)  # where a texel is sampled to decide whether it is covered

# Borders, in texels unless said otherwise.
INSET = 1.0 / 512.0  # shrinks a texel's square, so that a border along its side does not cover it
BORDER_OFFSET = 0.2  # distance from a border to its samples, inside the face, unless a limit below is less
MAX_MOVE = 0.4  # greatest distance that a sample moves from the border towards the face's third corner
MAX_SHARE = 0.3  # greatest share of the way from the border to that corner that a sample moves
# Depth in [0, 1] of a border's sample: at the texel's sample, and more for each texel of distance from it.
BORDER_DEPTH = 0.01  # triangles have depth 0
DEPTH_PER_TEXEL = 0.4

# The same numbers under their names in the shaders.
BORDER_RULES = {
    "INSET": INSET,
    "OFFSET": BORDER_OFFSET,
    "MAX_MOVE": MAX_MOVE,
    "MAX_SHARE": MAX_SHARE,
    "BORDER_DEPTH": BORDER_DEPTH,
    "DEPTH_PER_TEXEL": DEPTH_PER_TEXEL,
}

BAND_TEXELS = 1 << 22  # texels drawn at a time: bounds memory
_BLOCK = 16  # texels a side; measured: the gather is a tenth to a quarter faster than in rows
_MORTON_BITS = 11  # of a coordinate


@dataclass(frozen=True, eq=False)
class Samples:
    """Surface points, one for each of k texels.

    faces     (k,) int32, -1 where the texel has no sample
    weights   (k, 3) float32, barycentric, >= 0, sum 1; (1, 0, 0) where there is no sample
    """

    faces: Int32Array
    weights: Float32Array


def keep_faces(samples: Samples, faces: BoolArray) -> Samples:
    """Drop the samples on faces that are not in the mask, (f,) bool."""
    dropped = (samples.faces < 0) | ~faces[samples.faces]
    weights = np.where(dropped[:, None], np.array((1, 0, 0), np.float32), samples.weights)
    return Samples(np.where(dropped, np.int32(-1), samples.faces), weights)


class Rasterizer(Protocol):
    """Finds the surface under the texels of a layout. GLRasterizer uses OpenGL, CPURasterizer does not."""

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        ...

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        ...

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return the surface under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        ...


def row_bands(width: int, height: int) -> list[tuple[int, int]]:
    """Cut a texture into bands of whole rows: the first row of each, and the number of rows.

    Each has at most BAND_TEXELS texels, or one row. Only the last may have fewer rows than the first.
    """
    rows = min(height, max(1, BAND_TEXELS // width))
    return [(row, min(rows, height - row)) for row in range(0, height, rows)]


def order_in_blocks(index: Int64Array, width: int) -> Int64Array:
    """Sort texels by square blocks along a Z-order curve, so that neighbours read the same part of a depth map."""
    row, column = (position // _BLOCK for position in np.divmod(index, width))
    columns = -(-width // _BLOCK)
    blocks = np.column_stack(np.divmod(np.arange(columns * (int(row.max(initial=0)) + 1)), columns))
    return index[np.argsort(morton_codes(blocks)[row * columns + column], kind="stable")]


def morton_codes(cells: NDArray[np.integer]) -> Int64Array:
    """Return the positions of cells along the Z-order curve, (n,) int64 (G. M. Morton, 1966).

    cells   (n, d) integers in 0 .. 2047, d at most 5
    """
    codes: Int64Array = np.zeros(len(cells), np.int64)
    dimensions = cells.shape[1]
    for axis in range(dimensions):
        for bit in range(_MORTON_BITS):
            codes |= (cells[:, axis].astype(np.int64) >> bit & 1) << (bit * dimensions + axis)
    return codes


def clamp_barycentric(weights: Float32Array) -> Float32Array:
    """Move points onto their faces: all three weights, (n, 3), from those of the last two corners, (2, n)."""
    second, third = np.maximum(weights, 0)
    total = np.maximum(1, second + third)
    second, third = second / total, third / total
    return np.stack([np.maximum(1 - second - third, 0), second, third], axis=1)
