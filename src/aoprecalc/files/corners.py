"""Splitting the corners of faces into vertices, for formats that keep one normal and one UV for each vertex."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.distinct import distinct_rows


@dataclass(frozen=True, eq=False)
class Split:
    """Vertices made from corners.

    corner     (n,) for each vertex, a corner (counted through the faces) that has its values
    triangles  (f, 3) the vertex at each corner
    """

    corner: NDArray[np.intp]
    triangles: NDArray[np.intp]


def split_corners(*values: NDArray[Any]) -> Split:
    """Make one vertex for all corners that agree in all values, in the order in which the faces come to them.

    values   each (f, 3) or (f, 3, c) numbers at the corners
    """
    columns = [array.reshape(array.shape[0] * 3, -1) for array in values]
    corner, which = distinct_rows(*columns)
    return Split(corner, which.reshape(-1, 3))
