"""A page that charts are put into, as images of the cells that they touch.

The largest chart comes first; each goes to the lowest place where it fits, in one of four orientations, so that small
ones fill what large ones leave.
(Ideas: charts as images, P. Sander and others, "Multi-Chart Geometry Images", 2003; the lowest place first, B. Lévy and
others, "Least Squares Conformal Maps for Automatic Texture Atlas Generation", 2002.)
"""

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray

IntArray = NDArray[np.intp]
Tick = Callable[[], None]

_CLASSES = 3  # of widths, and of heights, in a factor of two
# How much is tested together: little at first, as it may be enough, then more.
_FIRST_ROWS, _MOST_ROWS = 16, 1024  # of the page
_FIRST_BYTES, _MOST_BYTES = 4, 256  # of eight places each
_GROWTH = 4
_FIRST_TESTS = 12  # cells of an outline tested at all places of these rows
_CELLS = 4096  # tested together, at least, where places are few
_ALL_TAKEN = 255  # a byte of eight cells


class _Shape(NamedTuple):
    """A chart's mask.

    mask     (rows, columns) bool
    outline  rows and columns of the cells at its outline, those far apart first
    """

    mask: BoolArray
    outline: tuple[IntArray, IntArray]

    @classmethod
    def of(cls, mask: BoolArray) -> Self:
        """Find the outline of a mask."""
        inner = mask.copy()
        inner[[0, -1]] = inner[:, [0, -1]] = False
        inner[1:-1, 1:-1] &= mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        rows, columns = np.nonzero(mask ^ inner)
        around = np.argsort(np.arctan2(rows - mask.shape[0] / 2, columns - mask.shape[1] / 2), kind="stable")
        spread = around[_far_apart(len(around))]
        return cls(mask, (rows[spread], columns[spread]))

    def turned(self, turns: int) -> "_Shape":
        """Return it after quarter turns, 0 to 3, as np.rot90 turns."""
        mask, (rows, columns) = self
        last_row, last_column = mask.shape[0] - 1, mask.shape[1] - 1
        if turns == 1:
            return _Shape(mask.T[::-1], (last_column - columns, rows))
        if turns == 2:
            return _Shape(mask[::-1, ::-1], (last_row - rows, last_column - columns))
        return _Shape(mask.T[:, ::-1], (columns, last_row - rows)) if turns else self


@lru_cache(maxsize=1024)
def _far_apart(count: int) -> IntArray:
    """Return the numbers below `count` in an order whose beginnings are spread evenly (van der Corput)."""
    bits = max(1, (count - 1).bit_length())
    numbers = np.arange(1 << bits)
    reversed_bits = np.zeros_like(numbers)
    for bit in range(bits):
        reversed_bits |= ((numbers >> bit) & 1) << (bits - 1 - bit)
    order: IntArray = reversed_bits[reversed_bits < count]
    order.flags.writeable = False  # one array for all callers
    return order


def reach_of_gutter(gutter: int, cell: int) -> list[int]:
    """Return the cells that a covered one keeps free: by rows of distance, how many columns away they reach.

    Two cells are too near if some of their texels are at most `gutter` apart.
    """

    def texels(cells: int) -> int:
        return (cells - 1) * cell + 1 if cells else 0

    def too_near(rows: int, columns: int) -> bool:
        return texels(rows) ** 2 + texels(columns) ** 2 < (gutter + 1) ** 2

    reach: list[int] = []
    while too_near(len(reach), 0):
        columns = 0
        while too_near(len(reach), columns + 1):
            columns += 1
        reach.append(columns)
    return reach


class Page:
    """A page that charts are put into.

    taken    (rows, columns) bool, and some more that stay free: the cells that are taken, or too near to one
    packed   (8, rows, bytes) uint8, eight cells in a byte: the bytes of packed[k] begin at cells k, k + 8, ... of a row
    """

    def __init__(self, columns: int, rows: int, reach: list[int]) -> None:
        """Make an empty page; see `reach_of_gutter`."""
        self._rows, self._columns, self._reach = rows, columns, reach
        width = columns // 8 + 2  # in bytes: all cells of a row are in each of packed[k]
        self._taken = np.zeros((rows + 1, 8 * width), bool)
        self._packed = np.zeros((8, rows + 1, width), np.uint8)
        self._first_row: dict[tuple[int, int], int] = {}  # by size class: where its next chart is looked for

    def place(self, masks: list[BoolArray], tick: Tick | None = None) -> IntArray | None:
        """Place all charts, largest first: (n, 3) rows, columns and quarter turns; None where one does not fit.

        tick   is called before each chart; may raise to stop
        """
        places: IntArray = np.zeros((len(masks), 3), np.intp)
        for number in np.argsort([-sum(mask.shape) for mask in masks], kind="stable").tolist():
            if tick is not None:
                tick()
            shape, best = _Shape.of(masks[number]), None
            for turns in range(4):
                found = self._find(shape, turns, best[0] if best else self._rows + 1)
                if found is not None:
                    best = (found[0] + shape.mask.shape[turns % 2], *found, turns)
            if best is None:
                return None
            _, row, column, turns = best
            self._put(shape.turned(turns).mask, row, column)
            places[number] = row, column, turns
        return places

    def _find(self, shape: _Shape, turns: int, end: int) -> tuple[int, int] | None:
        """Return the lowest, then leftmost place at which a shape, turned, ends before row `end`; None without any."""
        rows, columns = shape.mask.shape[:: -1 if turns % 2 else 1]
        size_class = int(_CLASSES * math.log2(columns)), int(_CLASSES * math.log2(rows))
        first, stop = self._first_row.get(size_class, 0), min(end - 1, self._rows) - rows + 1
        if columns > self._columns or first >= stop:
            return None
        shape = shape.turned(turns)
        for place in self._places(shape, first, stop):
            row, column = divmod(place, self._taken.shape[1])
            if not (self._taken[row : row + rows, column : column + columns] & shape.mask).any():
                self._first_row[size_class] = row
                return row, column
        return None

    def _places(self, shape: _Shape, first: int, stop: int) -> Iterator[int]:
        """Yield the places, indices of cells in rows `first` to `stop` - 1, from which no cell of an outline is taken.

        What lies inside the outline is not tested. The first cells of the outline are tested at all places, eight of
        them in a byte, and the others where these are free.
        """
        _, height, width = self._packed.shape
        stride, cells, packed = 8 * width, self._taken.reshape(-1), self._packed.reshape(8, height * width)
        outline = shape.outline[0] * stride + shape.outline[1]
        tests, others = outline[:_FIRST_TESTS].tolist(), outline[_FIRST_TESTS:]
        beyond = np.packbits(np.arange(stride) > self._columns - shape.mask.shape[1])  # a shape there leaves the page
        for rows in _portions(first, stop, _FIRST_ROWS, _MOST_ROWS):
            begin, size = rows.start * width, len(rows) * width
            taken = np.empty(size, np.uint8)
            taken.reshape(-1, width)[:] = beyond
            for cell in tests:
                at = begin + cell // 8
                taken |= packed[cell % 8, at : at + size]
            free = np.flatnonzero(taken != _ALL_TAKEN)
            for portion in _portions(0, len(free), _FIRST_BYTES, _MOST_BYTES):
                some = free[portion.start : portion.stop]
                byte, bit = np.divmod(np.flatnonzero(np.unpackbits(taken[some]) == 0), 8)
                yield from _fitting(cells, 8 * (begin + some[byte]) + bit, others).tolist()

    def _put(self, mask: BoolArray, row: int, column: int) -> None:
        """Take the cells of a mask, and those that must stay free around it."""
        around = len(self._reach) - 1
        kept = _dilated(mask, self._reach)
        top, left = max(0, row - around), max(0, column - around)
        bottom, right = (
            min(size, start + extent + around)
            for size, start, extent in zip((self._rows, self._columns), (row, column), mask.shape, strict=True)
        )
        shown = kept[top - row + around : bottom - row + around, left - column + around : right - column + around]
        self._taken[top:bottom, left:right] |= shown
        first, stop = max(0, left - 7) // 8, right // 8 + 1  # of the bytes that hold one of these cells
        stride = self._taken.shape[1]
        shape, begin = (8, bottom - top, 8 * (stop - first)), top * stride + 8 * first
        shifted = np.ndarray(shape, bool, self._taken, begin, (1, stride, 1))  # cells from the first, the second, ...
        self._packed[:, top:bottom, first:stop] = np.packbits(shifted, axis=2)


def _portions(start: int, stop: int, size: int, most: int) -> Iterator[range]:
    """Cut the numbers from `start` to `stop` - 1 into portions of growing size."""
    while start < stop:
        yield range(start, min(start + size, stop))
        start, size = start + size, min(size * _GROWTH, most)


def _fitting(cells: BoolArray, places: IntArray, outline: IntArray) -> IntArray:
    """Return those of the places, indices of cells, from which no cell of the outline is taken."""
    tested, step = 0, 4
    while tested < len(outline) and len(places):
        places = places[~cells[places[:, None] + outline[tested : tested + step]].any(axis=1)]
        tested += step
        step = max(4, _CELLS // max(1, len(places)))
    return places


def _dilated(mask: BoolArray, reach: list[int]) -> BoolArray:
    """Return a mask with all cells within reach, larger by its greatest distance on each side."""
    around = len(reach) - 1
    rows, columns = mask.shape
    result: BoolArray = np.zeros((rows + 2 * around, columns + 2 * around), bool)
    spread = np.zeros((rows, columns + 2 * around), bool)  # mask, as far to the sides as is reached at a distance
    spread[:, around : around + columns], wide = mask, 0
    for distance in range(around, -1, -1):
        while wide < reach[distance]:
            wide += 1
            spread[:, around - wide : around - wide + columns] |= mask
            spread[:, around + wide : around + wide + columns] |= mask
        for start in {around - distance, around + distance}:
            result[start : start + rows] |= spread
    return result
