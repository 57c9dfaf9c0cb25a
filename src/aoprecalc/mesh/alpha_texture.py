"""Pictures of alpha, and quick bounds of what they hold in a rectangle."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.texture_lookup import wrapped
from aoprecalc.types import Float32Array, Float64Array, Int64Array, Wrap

_CELLS = 2048  # along the sides of the finest bounds at most


@dataclass(frozen=True, eq=False)
class AlphaTexture:
    """An alpha with its bounds. Places are (u, 1 - v), as rows run.

    alpha    (h, w) float32
    wraps    what it does beyond [0, 1] along u and v
    bounds   (c, 2) float32: least and greatest alpha in cells of UV space, grid after grid, row after row
    grids    (l, 3): where each grid begins in bounds, its columns and its rows; each has half as many as the one before
    """

    alpha: Float32Array
    wraps: tuple[Wrap, Wrap]
    bounds: Float32Array
    grids: Int64Array

    @classmethod
    def from_image(cls, alpha: Float32Array, wraps: tuple[Wrap, Wrap]) -> Self:
        """Make the bounds of an alpha."""
        pyramids = [list(_pyramid(alpha, wraps, extreme)) for extreme in (np.minimum, np.maximum)]
        sizes = np.array([cells.shape for cells in pyramids[0]])
        starts = np.cumsum(sizes.prod(axis=1)) - sizes.prod(axis=1)
        bounds = np.stack([np.concatenate([cells.ravel() for cells in pyramid]) for pyramid in pyramids], axis=1)
        return cls(alpha, wraps, bounds, np.column_stack([starts, sizes[:, ::-1]]))

    @property
    def varying(self) -> tuple[int, int]:
        """Columns and rows, 0 where there is but one."""
        height, width = self.alpha.shape
        return width if width > 1 else 0, height if height > 1 else 0

    def at(self, places: Float64Array) -> Float64Array:
        """Return the bilinear alpha, (m,), at (m, 2) places."""
        height, width = self.alpha.shape
        texels = places * (width, height) - 0.5
        first = np.floor(texels)
        x, y = (texels - first).T
        column, row = first.astype(np.int64).T
        left, right = (wrapped(column + k, width, self.wraps[0]) for k in (0, 1))
        upper, lower = (wrapped(row + k, height, self.wraps[1]) * width for k in (0, 1))
        alpha = self.alpha.ravel()
        above = _mix(alpha[upper + left], alpha[upper + right], x)
        return _mix(above, _mix(alpha[lower + left], alpha[lower + right], x), y)

    def between(self, low: Float64Array, high: Float64Array) -> Float32Array:
        """Return bounds of the alpha, (m, 2), in the rectangles from (m, 2) to (m, 2) places."""
        first, last = (np.floor(end * self.grids[0, 1:]).astype(np.int64) for end in (low, high))
        # The grid in which two columns and two rows hold all.
        level = np.frexp(np.maximum((last - first).max(axis=1) - 1, 0))[1].clip(max=len(self.grids) - 1)
        start, *sizes = self.grids[level].T
        columns, rows = (
            [wrapped(end[:, axis] >> level, sizes[axis], self.wraps[axis]) for end in (first, last)] for axis in (0, 1)
        )
        cells = [self.bounds[start + row * sizes[0] + column] for row in rows for column in columns]
        least, most = (extreme.reduce(cells)[:, k] for k, extreme in enumerate((np.minimum, np.maximum)))
        return np.stack([least, most], axis=1)


def _mix(one: NDArray[np.floating], other: NDArray[np.floating], share: Float64Array) -> Float64Array:
    # What is equal stays equal.
    return one + share * (other - one)


def _pyramid(alpha: Float32Array, wraps: tuple[Wrap, Wrap], extreme: np.ufunc) -> Iterator[Float32Array]:
    """Yield grids of the extremes of the bilinear alpha, from the finest to a single cell."""
    cells = alpha
    for axis, wrap in enumerate(reversed(wraps)):
        cells = _footprints(cells, axis, wrap, extreme)
    yield cells
    while cells.size > 1:
        for axis in (0, 1):
            cells = extreme.reduceat(cells, np.arange(0, cells.shape[axis], 2), axis)
        yield cells


def _footprints(alpha: Float32Array, axis: int, wrap: Wrap, extreme: np.ufunc) -> Float32Array:
    """Return the extremes of the texels that have a say in each of a power of two of cells along an axis."""
    size = alpha.shape[axis]
    count = min(1 << (size - 1).bit_length(), _CELLS)
    ends = np.arange(count + 1) * (size / count) - 0.5
    # One texel more on either side, and one that reduceat wants.
    texels = alpha.take(wrapped(np.arange(-1, size + 2), size, wrap), axis)
    runs = np.column_stack([np.floor(ends[:-1]) + 1, np.ceil(ends[1:]) + 2]).astype(np.int64)
    cells: Float32Array = extreme.reduceat(texels, runs.ravel(), axis).take(np.arange(0, 2 * count, 2), axis)
    return cells
