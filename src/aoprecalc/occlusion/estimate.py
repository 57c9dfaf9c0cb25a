"""Ambient occlusion from visibility sums."""

import numpy as np

from aoprecalc.model import Doubles, Mask
from aoprecalc.options import Estimator, Sampling

_COMPLETION = (2.0**1.5 - 1.0) ** 0.5  # see sampling_error


def estimate(sums: Doubles, directions: int, estimator: Estimator) -> tuple[Doubles, Mask]:
    """Return the values of texels, (k,) float64 >= 0, and which of them were measured at all, (k,) bool.

    sums   (k, 2): the weight of visible directions, and of all in front of the surface
    ratio  their quotient: self-normalised, exactly 1 on an open point
    mean   4/N times the first (equation 1.1.1.1 by uniform directions), which sampling can make greater than 1
    """
    visible, whole = sums[:, 0], sums[:, 1]
    measured = whole > 0
    if estimator == "mean":
        return visible * (4.0 / directions), measured
    return np.divide(visible, whole, out=np.zeros_like(visible), where=measured), measured


def sampling_error(
    halves: Doubles, directions: list[int], estimator: Estimator, sampling: Sampling = "fibonacci"
) -> float | None:
    """Return the error to expect of the two halves together, RMS over the texels that both measured; None without any.

    halves       (2, k, 2): visibility sums of the halves
    directions   how many each has used
    Half the difference would be the answer if the halves erred independently. The halves of an even set complete each
    other: its error falls as N^-3/4, so that each half errs 2^(3/4) times as much as the whole, and half the difference
    is sqrt(2^(3/2) - 1) = 1.35 times the error of the whole. Random directions have no such bond.
    """
    if not all(directions):
        return None
    (first, in_first), (second, in_second) = (
        estimate(sums, count, estimator) for sums, count in zip(halves, directions, strict=True)
    )
    both = in_first & in_second
    if not both.any():
        return None
    difference = first[both] - second[both]
    share = np.sqrt(directions[0] * directions[1]) / sum(directions)  # 1/2 for equal halves
    return float(share / (_COMPLETION if sampling == "fibonacci" else 1.0) * np.sqrt((difference**2).mean()))
