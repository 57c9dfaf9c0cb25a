"""The ball that stands for a sphere where a format has only triangles, and the colour of all of them."""

import numpy as np

from aoprecalc.model import Doubles, Ints

COLOR = (0.9, 0.4, 0.1, 0.4)  # red, green, blue and opacity: the mesh shows through

_DIVISIONS = 3  # 1280 triangles; they lie at most 0.5% of the radius inside the sphere


def unit_ball() -> tuple[Doubles, Ints]:
    """Return (points, triangles) of an icosphere around the origin, its points at distance 1.

    points      (642, 3) float64, which are its normals too
    triangles   (1280, 3) int32, counter-clockwise seen from outside
    """
    from trimesh.creation import icosphere  # takes half a second, which other formats should not pay

    ball = icosphere(subdivisions=_DIVISIONS)
    return np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int32)
