"""Alpha images of materials, with quick bounds of their values in any rectangle of UV space."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.texture_lookup import bilinear_taps, wrap_texels
from aoprecalc.types import Float32Array, Float64Array, Int64Array, Wrap

_MAX_CELLS = 2048  # along the sides of the finest bounds


@dataclass(frozen=True, eq=False)
class AlphaTexture:
    """An alpha image with bounds of its bilinear look-ups. Locations are (u, 1 - v), in the order of its rows.

    alpha    (h, w) float32
    wraps    the wrap modes along u and v
    bounds   (c, 2) float32: min and max alpha in cells of UV space, grid after grid, row after row
    grids    (l, 3): where each grid begins in bounds, its columns and its rows; each has half as many as the one before
    """

    alpha: Float32Array
    wraps: tuple[Wrap, Wrap]
    bounds: Float32Array
    grids: Int64Array

    @classmethod
    def from_image(cls, alpha: Float32Array, wraps: tuple[Wrap, Wrap]) -> Self:
        """Compute the bounds of an image."""
        pyramids = [list(_pyramid(alpha, wraps, extreme)) for extreme in (np.minimum, np.maximum)]
        sizes = np.array([cells.shape for cells in pyramids[0]])
        starts = np.cumsum(sizes.prod(axis=1)) - sizes.prod(axis=1)
        bounds = np.stack([np.concatenate([cells.ravel() for cells in pyramid]) for pyramid in pyramids], axis=1)
        return cls(alpha, wraps, bounds, np.column_stack([starts, sizes[:, ::-1]]))

    @property
    def varying_size(self) -> tuple[int, int]:
        """Columns and rows, 0 where there is only one: along that axis the alpha is constant."""
        height, width = self.alpha.shape
        return width if width > 1 else 0, height if height > 1 else 0

    def lookup(self, locations: Float64Array) -> Float64Array:
        """Return the bilinear alpha, (m,), at (m, 2) locations."""
        height, width = self.alpha.shape
        left, right, x = bilinear_taps(locations[:, 0] * width, width, self.wraps[0])
        upper, lower, y = bilinear_taps(locations[:, 1] * height, height, self.wraps[1])
        above = _mix(self.alpha[upper, left], self.alpha[upper, right], x)
        return _mix(above, _mix(self.alpha[lower, left], self.alpha[lower, right], x), y)

    def bounds_in(self, low: Float64Array, high: Float64Array) -> Float32Array:
        """Return bounds of the alpha, (m, 2) min and max, in the rectangles from (m, 2) to (m, 2) locations."""
        first, last = (np.floor(end * self.grids[0, 1:]).astype(np.int64) for end in (low, high))
        # The grid in which two columns and two rows contain the rectangle.
        level = np.frexp(np.maximum((last - first).max(axis=1) - 1, 0))[1].clip(max=len(self.grids) - 1)
        start, *sizes = self.grids[level].T
        columns, rows = (
            [wrap_texels(end[:, axis] >> level, sizes[axis], self.wraps[axis]) for end in (first, last)]
            for axis in (0, 1)
        )
        cells = [self.bounds[start + row * sizes[0] + column] for row in rows for column in columns]
        low_alpha, high_alpha = (extreme.reduce(cells)[:, k] for k, extreme in enumerate((np.minimum, np.maximum)))
        return np.stack([low_alpha, high_alpha], axis=1)


def _mix(first: NDArray[np.floating], second: NDArray[np.floating], weight: Float64Array) -> Float64Array:
    # In this form the mix of equal values is exactly that value.
    return first + weight * (second - first)


def _pyramid(alpha: Float32Array, wraps: tuple[Wrap, Wrap], extreme: np.ufunc) -> Iterator[Float32Array]:
    """Yield grids of the extremes of the bilinear alpha, from the finest to a single cell."""
    cells = alpha
    for axis, wrap in enumerate(reversed(wraps)):
        cells = _cell_extremes(cells, axis, wrap, extreme)
    yield cells
    while cells.size > 1:
        for axis in (0, 1):
            cells = extreme.reduceat(cells, np.arange(0, cells.shape[axis], 2), axis)
        yield cells


def _cell_extremes(alpha: Float32Array, axis: int, wrap: Wrap, extreme: np.ufunc) -> Float32Array:
    """Return the extremes of the texels that look-ups in each cell read, for a power of two of cells along an axis."""
    size = alpha.shape[axis]
    count = min(1 << (size - 1).bit_length(), _MAX_CELLS)
    ends = np.arange(count + 1) * (size / count) - 0.5
    # One texel more on either side, and one that reduceat needs.
    texels = alpha.take(wrap_texels(np.arange(-1, size + 2), size, wrap), axis)
    runs = np.column_stack([np.floor(ends[:-1]) + 1, np.ceil(ends[1:]) + 2]).astype(np.int64)
    cells: Float32Array = extreme.reduceat(texels, runs.ravel(), axis).take(np.arange(0, 2 * count, 2), axis)
    return cells
