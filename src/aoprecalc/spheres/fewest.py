"""As few spheres as are good enough."""

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
SAMPLES = 10  # that each sphere has at least: fewer would be fitted, not stood for


def fewest(
    scene: Scene,
    frame: Frame,
    points: Doubles,
    attempt: Callable[[int], Fitted],
    tolerance: float,
    method: Method,
) -> Fitted:
    """Return a fit whose error is at most `tolerance`, of few spheres: at most MOST, and a tenth of the samples.

    attempt   fits as many spheres, in the frame, by `method`

    The error is 1 - silhouette_iou for the methods shadow and collision, surface_error_mean for others. It need not
    fall with every sphere: what is found is good enough, and one sphere less, which was tried, is not.
    Raises AoprecalcError where no number of spheres will do.
    """
    by_silhouettes = method in ("shadow", "collision")
    positions = frame.enter(scene.positions)
    most = min(MOST, max(1, len(np.unique(points[: SAMPLES * MOST], axis=0)) // SAMPLES))

    def error(made: Fitted) -> float:
        if by_silhouettes:
            return 1.0 - silhouette_quality(scene, positions, made.centers, made.radii)["silhouette_iou"]
        away = signed_distances(points, made.centers, made.radii)
        return float(np.abs(away).mean() / (frame.diagonal or 1.0))

    too_few, count = 0, 1
    failed: list[tuple[float, int]] = []
    while (found := error(made := attempt(count))) > tolerance:
        failed.append((found, count))
        if count == most:
            kind = "1 - silhouette IoU" if by_silhouettes else "mean surface error"
            least, by = min(failed)
            raise AoprecalcError(
                f"{scene.path}: no number of spheres up to {most} was found with an error of --tolerance {tolerance:g} "
                f"({kind}), the least was {least:.4g} with {by}; allow that, or use more --samples or another --method"
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
