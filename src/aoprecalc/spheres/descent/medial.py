"""Balls that touch a surface from one side and hold none of it: their centres lie on the medial axis."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.model import Doubles

_MOST_STEPS = 30
_ENOUGH = 1e-3  # of the radius: a ball that shrinks by less has arrived


def medial_balls(points: Doubles, normals: Doubles, samples: Doubles, largest: float) -> tuple[Doubles, Doubles]:
    """Shrink a ball at each point until it holds no sample; returns centres (k, 3) and radii (k,) float64.

    points    (k, 3) on the surface
    normals   (k, 3) unit vectors; the ball at a point lies on the other side
    samples   (s, 3) on the surface
    largest   the radius to start from, which a ball that meets nothing keeps

    (J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest neighbors and the normal field",
    2012.)
    """
    tree = cKDTree(samples)
    radii = np.full(len(points), largest)
    moving = np.arange(len(points))
    for _ in range(_MOST_STEPS):
        centers = points[moving] - normals[moving] * radii[moving, None]
        distances, nearest = tree.query(centers)
        away = points[moving] - samples[nearest]
        height = (away * normals[moving]).sum(axis=1)
        squared = np.square(away).sum(axis=1)
        shrinks = (distances < radii[moving] * (1 - _ENOUGH)) & (height > 0)
        # The ball through both points that touches the surface in the first of them.
        moving = moving[shrinks]
        radii[moving] = np.minimum(squared[shrinks] / (2 * height[shrinks]), radii[moving] * (1 - _ENOUGH))
        if not len(moving):
            break
    return points - normals * radii[:, None], radii
