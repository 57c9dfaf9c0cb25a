"""How well spheres stand in for the surface that they were fitted to."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.model import Doubles, Mask
from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.lloyd import Clusters

Quality = dict[str, float]


def quality(points: Doubles, clusters: Clusters, radii: Doubles, frame: Frame) -> Quality:
    """Measure a sphere set, in the frame, on the samples that it was fitted to.

    points   (s, 3) float64 in the frame
    radii    (n,) float64 in the frame

    radius_min, radius_mean, radius_max, radius_deviation   spread of the radii, the last their standard deviation,
                         in the mesh's units
    inertia              sum over the samples of their squared distance from their centre, / diagonal of the box squared
    surface_error_mean   mean over the samples of their distance from their own sphere, ||p - c| - r|, / diagonal
    surface_error_max    the greatest of these distances, / diagonal
    coverage             share of the samples that lie inside some sphere, 0 to 1
    """
    own = radii[clusters.labels]
    error = np.abs(clusters.distances - own) / frame.diagonal
    inside = clusters.distances <= own
    inside[~inside] = _inside_any(points[~inside], clusters.centers, radii)
    measured = {
        "radius_min": radii.min() * frame.scale,
        "radius_mean": radii.mean() * frame.scale,
        "radius_max": radii.max() * frame.scale,
        "radius_deviation": radii.std() * frame.scale,
        "inertia": np.square(clusters.distances / frame.diagonal).sum(),
        "surface_error_mean": error.mean(),
        "surface_error_max": error.max(),
        "coverage": inside.mean(),
    }
    return {name: float(value) for name, value in measured.items()}


def _inside_any(points: Doubles, centers: Doubles, radii: Doubles) -> Mask:
    """(k,) bool: which points, (k, 3), lie inside at least one sphere.

    A sphere of radius r becomes a point sqrt(R^2 - r^2) away along a fourth axis, R the greatest radius: |p - c| <= r
    exactly where the distance in four dimensions is <= R, so that one look-up of the nearest centre answers for all.
    """
    largest = radii.max()
    lifted = np.column_stack([centers, np.sqrt((largest - radii) * (largest + radii))])
    distances, _ = cKDTree(lifted).query(np.column_stack([points, np.zeros(len(points))]))
    return np.asarray(distances <= largest, np.bool_)
