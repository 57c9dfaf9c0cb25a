"""A page that charts are put into, as images of the cells that they touch.

The largest chart comes first; each goes to the lowest place where it fits, in one of four orientations, so that small
ones fill what large ones leave.
(Ideas: charts as images, P. Sander and others, "Multi-Chart Geometry Images", 2003; the lowest place first, B. Lévy and
others, "Least Squares Conformal Maps for Automatic Texture Atlas Generation", 2002.)
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray

IntArray = NDArray[np.intp]
Tick = Callable[[], None]

_LEVELS = 7  # of squares whose places are known, 1 to 64 cells a side
_BAND = 64  # rows of the page looked at together
_CHUNK = 2048  # places tested together
_TESTS = 4096  # cells tested together, at least
_CLASSES = 3  # of widths, and of heights, in a factor of two


class _Shape(NamedTuple):
    """A chart's mask in one orientation.

    mask     (rows, columns) bool
    level    the largest square of 2**level cells that fits into it
    square   first row and column of such a square
    outline  rows and columns of the cells at its outline, those far apart first
    """

    mask: BoolArray
    level: int
    square: tuple[int, int]
    outline: tuple[IntArray, IntArray]

    def turned(self) -> "_Shape":
        """Return it after a quarter turn, as np.rot90 turns."""
        last = self.mask.shape[1] - 1
        (row, column), (rows, columns) = self.square, self.outline
        square = last - column - (1 << self.level) + 1, row
        return _Shape(np.rot90(self.mask), self.level, square, (last - columns, rows))


def _shape(mask: BoolArray) -> _Shape:
    level, inside = 0, mask
    while level + 1 < _LEVELS:
        side = 1 << level
        larger = inside[:-side, :-side] & inside[side:, :-side] & inside[:-side, side:] & inside[side:, side:]
        if not larger.any():
            break
        level, inside = level + 1, larger
    squares = np.argwhere(inside)
    row, column = squares[len(squares) // 2].tolist()
    interior = np.zeros_like(mask)
    middle = mask[1:-1, 1:-1]
    interior[1:-1, 1:-1] = middle & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    rows, columns = np.nonzero(mask & ~interior)
    around = np.argsort(np.arctan2(rows - mask.shape[0] / 2, columns - mask.shape[1] / 2), kind="stable")
    spread = around[_far_apart(len(around))]
    return _Shape(mask, level, (row, column), (rows[spread], columns[spread]))


def _far_apart(count: int) -> IntArray:
    """Return the numbers below `count` in an order whose beginnings are spread evenly (van der Corput)."""
    bits = max(1, (count - 1).bit_length())
    numbers = np.arange(1 << bits)
    reversed_bits = np.zeros_like(numbers)
    for bit in range(bits):
        reversed_bits |= ((numbers >> bit) & 1) << (bits - 1 - bit)
    order: IntArray = reversed_bits[reversed_bits < count]
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

    occupied[k][row, column] tells whether a square of 2**k cells, of this first row and column, holds a cell that is
    taken, or reaches out of the page.
    """

    def __init__(self, columns: int, rows: int, reach: list[int]) -> None:
        """Make an empty page; see `reach_of_gutter`."""
        self._rows, self._columns, self._reach = rows, columns, reach
        beyond = 1 << _LEVELS
        self._occupied = [np.ones((rows + beyond, columns + beyond), bool) for _ in range(_LEVELS)]
        for level, occupied in enumerate(self._occupied):
            side = 1 << level
            occupied[: max(0, rows - side + 1), : max(0, columns - side + 1)] = False
        self._first_row: dict[tuple[int, int], int] = {}  # by size class: where its next chart is looked for

    def place(self, masks: list[BoolArray], tick: Tick | None = None) -> IntArray | None:
        """Place all charts, largest first: (n, 3) rows, columns and quarter turns; None where one does not fit.

        tick   is called before each chart; may raise to stop
        """
        places: IntArray = np.zeros((len(masks), 3), np.intp)
        for number in np.argsort([-sum(mask.shape) for mask in masks], kind="stable").tolist():
            if tick is not None:
                tick()
            shape, best = _shape(masks[number]), None
            for turns in range(4):
                found = self._find(shape, best[0] if best else self._rows + 1)
                if found is not None:
                    best = (found[0] + shape.mask.shape[0], *found, turns, shape)
                shape = shape.turned()
            if best is None:
                return None
            _, row, column, turns, shape = best
            self._put(shape.mask, row, column)
            places[number] = row, column, turns
        return places

    def _find(self, shape: _Shape, end: int) -> tuple[int, int] | None:
        """Return the lowest place, then the leftmost, at which a shape ends before row `end`; None where there is none.

        Places are those whose largest square is free; of these the outline is tested. It is enough for charts that are
        larger than what is put already would be inside, so the whole is tested at last.
        """
        rows, columns = shape.mask.shape
        size_class = int(_CLASSES * math.log2(columns)), int(_CLASSES * math.log2(rows))
        width = self._columns - columns + 1
        stop = min(end - 1, self._rows) - rows + 1
        if width <= 0:
            return None
        taken, squares = self._occupied[0], self._occupied[shape.level]
        stride = taken.shape[1]
        cells = taken.reshape(-1)
        outline = shape.outline[0] * stride + shape.outline[1]
        for first in range(self._first_row.get(size_class, 0), stop, _BAND):
            band = squares[first + shape.square[0] : min(first + _BAND, stop) + shape.square[0]]
            free = np.flatnonzero(~band[:, shape.square[1] : shape.square[1] + width])
            row, column = np.divmod(free, width)
            places = (row + first) * stride + column
            for start in range(0, len(places), _CHUNK):
                for place in _fitting(cells, places[start : start + _CHUNK], outline).tolist():
                    row, column = divmod(place, stride)
                    if not (taken[row : row + rows, column : column + columns] & shape.mask).any():
                        self._first_row[size_class] = row
                        return row, column
        return None

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
        self._occupied[0][top:bottom, left:right] |= shown
        for level in range(1, _LEVELS):
            half = 1 << (level - 1)
            top, left = max(0, top - half), max(0, left - half)
            smaller = self._occupied[level - 1]
            ahead, beside = slice(top + half, bottom + half), slice(left + half, right + half)
            here, level_here = slice(top, bottom), slice(left, right)
            self._occupied[level][here, level_here] = (
                smaller[here, level_here] | smaller[ahead, level_here] | smaller[here, beside] | smaller[ahead, beside]
            )


def _fitting(cells: BoolArray, places: IntArray, outline: IntArray) -> IntArray:
    """Return those of the places, indices of cells, from which no cell of the outline is taken."""
    tested, step = 0, 4
    while tested < len(outline) and len(places):
        places = places[~cells[places[:, None] + outline[tested : tested + step]].any(axis=1)]
        tested += step
        step = max(4, _TESTS // max(1, len(places)))
    return places


def _dilated(mask: BoolArray, reach: list[int]) -> BoolArray:
    """Return a mask with all cells within reach, larger by its greatest distance on each side."""
    around = len(reach) - 1
    rows, columns = mask.shape
    result: BoolArray = np.zeros((rows + 2 * around, columns + 2 * around), bool)
    sums = np.zeros((rows, columns + 4 * around + 1), np.int32)
    sums[:, 1:] = np.cumsum(np.pad(mask, ((0, 0), (2 * around, 2 * around))), axis=1)
    width = result.shape[1]
    for distance, wide in enumerate(reach):
        low, high = around - wide, around + wide + 1
        spread = sums[:, high : high + width] > sums[:, low : low + width]
        for start in {around - distance, around + distance}:
            result[start : start + rows] |= spread
    return result
