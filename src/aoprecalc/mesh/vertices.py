"""Which rows of some arrays are the same: the one idea behind welding positions and splitting vertices at seams."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


def unique_rows(*columns: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the distinct rows of arrays that stand side by side.

    columns  each (n,) or (n, c), numbers without NaN; rows are equal where all their numbers are (so 0.0 equals -0.0)

    Returns (first, which): `first` (d,) holds the first occurrence of each distinct row, in the order of appearance;
    `which` (n,) says for every row which of those d rows it is.
    """
    keys = [numbers for column in columns for numbers in column.reshape(len(column), -1).T]
    order = np.lexsort(keys[::-1])
    fresh = np.zeros(len(order), dtype=bool)
    fresh[:1] = True
    for numbers in keys:
        ordered = numbers[order]
        fresh[1:] |= ordered[1:] != ordered[:-1]

    # lexsort is stable, so a group's first row is the one that appears first.
    sorted_first = order[fresh]
    appearance = np.argsort(sorted_first)
    rank = np.empty_like(appearance)
    rank[appearance] = np.arange(len(appearance))
    which = np.empty_like(order)
    which[order] = rank[np.cumsum(fresh) - 1]
    return sorted_first[appearance], which


# Splitting the corners of faces into vertices, for formats that keep one normal and one UV for each vertex.


@dataclass(frozen=True, eq=False)
class IndexedVertices:
    """Vertices made from corners.

    corner     (n,) for each vertex, a corner (counted through the faces) that has its values
    triangles  (f, 3) the vertex at each corner
    """

    corner: NDArray[np.intp]
    triangles: NDArray[np.intp]


def corners_to_vertices(*values: NDArray[Any]) -> IndexedVertices:
    """Make one vertex for all corners that agree in all values, in the order in which the faces come to them.

    values   each (f, 3) or (f, 3, c) numbers at the corners
    """
    columns = [array.reshape(array.shape[0] * 3, -1) for array in values]
    corner, which = unique_rows(*columns)
    return IndexedVertices(corner, which.reshape(-1, 3))
