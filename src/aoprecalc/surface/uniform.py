"""From numbers in [0, 1) to places spread uniformly over a surface: a face by its area, then a point in the face.

(Section 1.2.1 of *Précalcul*.)
"""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles


def faces_by_area(upto: Doubles, where: Doubles) -> NDArray[np.intp]:
    """Return the face at each of k numbers in [0, 1]; one without area is never met.

    upto   (f,) the areas of each face and all before it; the last is > 0
    """
    faces: NDArray[np.intp] = np.searchsorted(upto, np.minimum(where * upto[-1], np.nextafter(upto[-1], 0)), "right")
    return faces


def folded(along: Doubles, across: Doubles) -> tuple[Doubles, Doubles]:
    """Fold numbers in [0, 1), which span a parallelogram, into the triangle that is its half."""
    beyond = along + across > 1
    return np.where(beyond, 1 - along, along), np.where(beyond, 1 - across, across)
