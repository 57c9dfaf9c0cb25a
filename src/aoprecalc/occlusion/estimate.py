"""Ambient occlusion from visibility sums."""

import numpy as np

from aoprecalc.model import Doubles, Floats, Mask
from aoprecalc.options import Estimator


def estimate(sums: Doubles, directions: int, estimator: Estimator) -> tuple[Floats, Mask]:
    """Return the values of texels, (k,) float32 in [0, 1], and which of them were measured at all, (k,) bool.

    sums   (k, 2): the weight of visible directions, and of all in front of the surface
    ratio  their quotient: self-normalised, exactly 1 on an open point
    mean   4/N times the first (equation 1.1.1.1 by uniform directions), clamped because sampling can make it exceed 1
    """
    visible, whole = sums[:, 0], sums[:, 1]
    measured = whole > 0
    if estimator == "ratio":
        values = np.divide(visible, whole, out=np.zeros_like(visible), where=measured)
    else:
        values = visible * (4.0 / directions)
    return np.clip(values, 0.0, 1.0).astype(np.float32), measured
