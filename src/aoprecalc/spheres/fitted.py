"""What every method of fitting gives."""

from dataclasses import dataclass

from aoprecalc.types import Float64Array


@dataclass(frozen=True, eq=False)
class SphereFit:
    """n spheres in the frame.

    centers      (n, 3) float64
    radii        (n,) float64 >= 0
    iterations   rounds of pairing, or steps of the descent
    converged    the last iteration changed no sample's sphere; a descent always goes all its way
    guarded      how often a guard decided instead of the least squares (algebraic only)
    """

    centers: Float64Array
    radii: Float64Array
    iterations: int
    converged: bool
    guarded: int = 0
