"""Ambient occlusion from visibility sums."""

import numpy as np

from aoprecalc.model import Floats, Mask
from aoprecalc.options import Estimator, Sampling


def estimate(sums: Floats, directions: int, estimator: Estimator) -> tuple[Floats, Mask]:
    """Return the values of texels, (k,) float32 >= 0, and which of them were measured at all, (k,) bool.

    sums   (k, 2): the weight of visible directions, and of all in front of the surface
    ratio  their quotient: self-normalised, exactly 1 on an open point
    mean   4/N times the first (equation 1.1.1.1 by uniform directions), which sampling can make greater than 1
    """
    visible, whole = sums[:, 0], sums[:, 1]
    measured = whole > 0
    if estimator == "mean":
        return visible * np.float32(4.0 / directions), measured
    return np.divide(visible, whole, out=np.zeros_like(visible), where=measured), measured


def sampling_error(halves: Floats, directions: list[int], estimator: Estimator, sampling: Sampling) -> float | None:
    """Return the error to expect of the two halves together, RMS over the texels that both measured; None without any.

    halves       (2, k, 2): visibility sums of the halves
    directions   how many each has used
    Let p and q be the halves' shares of the directions. If they erred independently their difference would be
    1 / sqrt(pq) times the error of the whole. But the halves of an even set complete each other: its error falls as
    N^-3/4, which makes the difference greater by sqrt(p^-1/2 + q^-1/2 - 1), 1.35 for equal halves. Random directions
    have no such bond.
    """
    if not all(directions):
        return None
    (first, in_first), (second, in_second) = (
        estimate(sums, count, estimator) for sums, count in zip(halves, directions, strict=True)
    )
    both = in_first & in_second
    if not both.any():
        return None
    difference = np.sqrt(((first[both] - second[both]) ** 2).mean(dtype=np.float64))
    p, q = np.divide(directions, sum(directions))
    bond = 1.0 if sampling == "random" else p**-0.5 + q**-0.5 - 1.0
    return float(difference * np.sqrt(p * q / bond))
