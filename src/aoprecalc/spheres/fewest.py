"""The fewest spheres that are as good as asked for."""

from collections.abc import Callable

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.model import Doubles, Scene
from aoprecalc.options import Method
from aoprecalc.spheres.fitted import Fitted
from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.likeness.distance import signed_distances
from aoprecalc.spheres.likeness.quality import silhouette_quality

MOST = 4096


def fewest(
    scene: Scene,
    frame: Frame,
    points: Doubles,
    attempt: Callable[[int], Fitted],
    tolerance: float,
    method: Method,
) -> Fitted:
    """Return the fit of the fewest spheres, up to MOST, whose error is at most `tolerance`.

    attempt   fits as many spheres, in the frame, by `method`

    The error is 1 - silhouette_iou for the methods shadow and collision, surface_error_mean for others. It need not
    fall with every sphere: what is found is good enough, and one sphere less, which was tried, is not.
    Raises AoprecalcError where no number of spheres will do.
    """
    by_silhouettes = method in ("shadow", "collision")
    positions = frame.enter(scene.positions)
    most = min(MOST, len(np.unique(points[: 2 * MOST], axis=0)))

    def error(made: Fitted) -> float:
        if by_silhouettes:
            return 1.0 - silhouette_quality(scene, positions, made.centers, made.radii)["silhouette_iou"]
        away = signed_distances(points, made.centers, made.radii)
        return float(np.abs(away).mean() / (frame.diagonal or 1.0))

    too_few, count = 0, 1
    while (found := error(made := attempt(count))) > tolerance:
        if count == most:
            kind = "1 - silhouette IoU" if by_silhouettes else "mean surface error"
            raise AoprecalcError(
                f"{scene.path}: {count} spheres leave an error of {found:.4g} ({kind}), more than --tolerance "
                f"{tolerance:g}; allow a greater one, or use another --method"
            )
        too_few, count = count, min(2 * count, most)
    while count - too_few > 1:
        middle = (too_few + count) // 2
        tried = attempt(middle)
        if error(tried) <= tolerance:
            made, count = tried, middle
        else:
            too_few = middle
    return made
