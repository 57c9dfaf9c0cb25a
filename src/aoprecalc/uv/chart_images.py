"""Charts as images of the cells that they touch, found from the faces at their borders: few of those of a fine mesh."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.types import BoolArray, Float64Array, Int32Array
from aoprecalc.uv.page import IntArray

# Orientation of charts.
_ANGLES = 16  # of a quarter turn
_REFINEMENTS = 5  # halvings of the step between them

# Odd multipliers whose bits look random: 2^64 over the golden ratio, and two primes of xxHash64.
_MIXERS = tuple(np.uint64(odd) for odd in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))


@dataclass(frozen=True, eq=False)
class ChartBorders:
    """The borders of charts: a chart covers the cells that one of `faces` touches, and those inside of `sides`.

    faces  (r,) indices of the faces at a border; of faces that turn back over their chart, or have no area; and of one
           face at least of each chart
    sides  (s,) sides of faces that no other face of their chart continues, as 3 * face + the corner from which they run
    """

    faces: IntArray
    sides: IntArray

    @classmethod
    def of(cls, uvs: Float64Array, chart: Int32Array) -> Self:
        """Find the borders of (f, 3, 2) triangles in charts, (f,), each connected by corners of equal UVs."""
        corner = _hashed(uvs.reshape(-1, 2), np.repeat(chart, 3)).reshape(-1, 3)
        ahead = np.roll(corner, -1, axis=1)
        edge = (corner + ahead).ravel()
        order = np.argsort(edge, kind="stable")
        ordered, runs_up = edge[order], (corner < ahead).ravel()[order]
        # A side is continued where just one other is the same edge, and runs the other way.
        same = np.pad(ordered[1:] == ordered[:-1], 1)  # as the one before
        begins = np.flatnonzero(~same[:-2] & same[1:-1] & ~same[2:] & (runs_up[1:] != runs_up[:-1]))
        continued = np.zeros(len(edge), bool)
        continued[begins] = continued[begins + 1] = True
        sides = np.sort(order[~continued])
        at_border = np.zeros(len(uvs), bool)
        at_border[sides // 3] = True
        side, other = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
        signed = side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]
        at_border |= signed * np.sign(np.bincount(chart, signed))[chart] <= 0
        at_border[np.unique(chart, return_index=True)[1]] = True
        return cls(np.flatnonzero(at_border), sides)


def _hashed(points: Float64Array, chart: Int32Array) -> IntArray:
    """Return a number for each of (n, 2) points in charts, (n,): the same for equal ones of one chart.

    Different points share one with a probability of about 2^-64.
    """
    mixed = chart.astype(np.uint64) * _MIXERS[0]
    for numbers in points.T + 0.0:  # -0.0 becomes 0.0
        mixed = (mixed ^ numbers.view(np.uint64)) * _MIXERS[1]
        mixed = (mixed ^ mixed >> np.uint64(29)) * _MIXERS[2]
        mixed ^= mixed >> np.uint64(32)
    return mixed.view(np.int64)


def in_least_boxes(uvs: Float64Array, chart: Int32Array, borders: ChartBorders) -> Float64Array:
    """Turn each chart of (f, 3, 2) triangles until its bounding box is about as small as can be, and move it to 0."""
    outer = borders.faces[np.argsort(chart[borders.faces], kind="stable")]
    points = uvs[outer].reshape(-1, 2)
    first = np.flatnonzero(np.diff(chart[outer], prepend=-1)) * 3
    of_point = np.repeat(chart[outer], 3)

    def turned(points: Float64Array, of_point: Int32Array, angles: Float64Array) -> tuple[Float64Array, Float64Array]:
        cos, sin = np.cos(angles)[of_point], np.sin(angles)[of_point]
        return points[:, 0] * cos - points[:, 1] * sin, points[:, 0] * sin + points[:, 1] * cos

    def box(angles: Float64Array) -> Float64Array:
        x, y = turned(points, of_point, angles)
        width, height = (np.maximum.reduceat(along, first) - np.minimum.reduceat(along, first) for along in (x, y))
        area: Float64Array = width * height
        return area

    best = np.zeros(len(first))
    smallest = box(best) * (1 - 1e-9)  # turned only where that helps
    step = math.pi / 2 / _ANGLES
    tries = [np.full(len(first), step * number) for number in range(1, _ANGLES)]
    for _ in range(_REFINEMENTS + 1):
        for angles in tries:
            area = box(angles)
            better = area < smallest
            best, smallest = np.where(better, angles, best), np.where(better, area, smallest)
        step /= 2
        tries = [best - step, best + step]
    low = [np.minimum.reduceat(along, first) for along in turned(points, of_point, best)]
    of_corner = np.repeat(chart, 3)
    moved = [
        along - least[of_corner] for along, least in zip(turned(uvs.reshape(-1, 2), of_corner, best), low, strict=True)
    ]
    return np.stack(moved, axis=-1).reshape(-1, 3, 2)


def chart_masks(flat: Float64Array, chart: Int32Array, inset: float, borders: ChartBorders) -> list[BoolArray]:
    """Return one image for each chart, True where one of its triangles touches a cell; rows along the second axis.

    flat    (f, 3, 2) triangles in cells, >= 0, each chart from the origin
    inset   cells by which a triangle may reach into one without touching it
    borders    of these charts
    A cell is covered where a triangle at the border touches it, or else where its centre lies inside the border.
    """
    outer, of_outer = flat[borders.faces], chart[borders.faces]
    extent = np.zeros((int(chart.max()) + 1, 2))
    np.maximum.at(extent, of_outer, outer.max(axis=1))
    columns, rows = np.maximum(np.ceil(extent - inset), 1).astype(np.intp).T
    stops = np.cumsum((columns + 1) * rows)  # each row ends with a cell that stays empty
    starts, total = stops - (columns + 1) * rows, int(stops[-1])
    face, row, low, high = _row_spans(outer, inset, rows[of_outer] - 1)
    of_span = of_outer[face]
    last = columns[of_span] - 1
    row_start = starts[of_span] + row * (columns[of_span] + 1)
    begin = np.clip(np.floor(low + inset), 0, last).astype(np.intp)
    end = np.clip(np.ceil(high - inset) - 1, begin, last).astype(np.intp)
    changes = np.bincount(row_start + begin, minlength=total) - np.bincount(row_start + end + 1, minlength=total)
    touched = np.cumsum(changes) > 0
    of_side = chart[borders.sides // 3]
    corners = [flat[borders.sides // 3, corner] for corner in (borders.sides % 3, (borders.sides + 1) % 3)]
    side, row, column, winding = _crossings(*corners)
    of_crossing = of_side[side]
    at = starts[of_crossing] + row * (columns[of_crossing] + 1) + np.minimum(column, columns[of_crossing])
    touched |= np.cumsum(np.bincount(at, winding, total)) != 0  # sums of ones, which are exact
    return [
        touched[start:stop].reshape(height, width + 1)[:, :width]
        for start, stop, height, width in zip(starts, stops, rows, columns, strict=True)
    ]


def _crossings(starts: Float64Array, ends: Float64Array) -> tuple[IntArray, IntArray, IntArray, Float64Array]:
    """Return where sides, from (s, 2) to (s, 2), cross the middles of rows of cells.

    For each crossing: the side, the row, the first column whose centre lies beyond, and 1.0 for upwards, else -1.0.
    """
    winding = np.where(starts[:, 1] < ends[:, 1], 1.0, -1.0)
    low, high = (extreme(starts[:, 1], ends[:, 1]) for extreme in (np.minimum, np.maximum))
    first, stop = (np.ceil(along - 0.5).astype(np.intp) for along in (low, high))
    count = stop - first
    side = np.repeat(np.arange(len(starts)), count)
    row = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count) + first[side]
    (x, y), (along_x, along_y) = starts[side].T, (ends - starts)[side].T
    column = np.maximum(np.floor(x + (row + 0.5 - y) / along_y * along_x + 0.5), 0).astype(np.intp)
    return side, row, column, winding[side]


def _row_spans(
    triangles: Float64Array, inset: float, last_row: IntArray
) -> tuple[IntArray, IntArray, Float64Array, Float64Array]:
    """Return, for each row of cells that a triangle touches: the triangle, the row, and its least and greatest x there.

    last_row   (f,) the last row that each of (f, 3, 2) triangles may touch
    """
    low, high = triangles[..., 1].min(axis=1), triangles[..., 1].max(axis=1)
    first = np.clip(np.floor(low + inset), 0, last_row).astype(np.intp)
    count = np.clip(np.ceil(high - inset) - 1, first, last_row).astype(np.intp) - first + 1
    face = np.repeat(np.arange(len(triangles)), count)
    row = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count) + first[face]
    least: Float64Array = np.full(len(face), np.inf)
    greatest: Float64Array = np.full(len(face), -np.inf)
    for corner in range(3):
        x, y = triangles[face, corner].T
        along_x, along_y = (triangles[:, (corner + 1) % 3] - triangles[:, corner])[face].T
        crosses = (np.minimum(y, y + along_y) <= row + 1) & (np.maximum(y, y + along_y) >= row)
        safe = np.where(along_y == 0, 1.0, along_y)
        for side in (row, row + 1):  # the edge's part in the row ends at its corners or at the row's sides
            share = np.where(along_y == 0, side - row, np.clip((side - y) / safe, 0.0, 1.0))
            least = np.where(crosses, np.minimum(least, x + share * along_x), least)
            greatest = np.where(crosses, np.maximum(greatest, x + share * along_x), greatest)
    return face, row, least, greatest
