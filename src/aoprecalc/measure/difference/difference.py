"""What a comparison finds, whatever was compared."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from aoprecalc.model import Doubles, Floats

Answer = Literal["equal", "near", "different"]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two pictures to be looked at, of one channel each.

    first, second   (h, w) float32, row 0 on top; they may have different sizes
    flip            (h, w) float32 in [0, 1]: what an eye sees of the difference; None where the sizes differ
    """

    first: Floats
    second: Floats
    flip: Floats | None


@dataclass(frozen=True, eq=False)
class Difference:
    """How far B is from A.

    value      the number that a tolerance is held against, >= 0; None where no number can tell
    equal      every value that was compared is the same
    reason     why no number can tell, in words; empty where one can
    details    what else was measured: plain JSON values
    pair       the pictures that were compared; None where there are none
    warnings   what the user should know about the comparison
    """

    value: float | None
    equal: bool = False
    reason: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    pair: Pair | None = None
    warnings: tuple[str, ...] = ()

    def answer(self, tolerance: float) -> Answer:
        """Return what the difference means where at most `tolerance` is allowed."""
        if self.equal:
            return "equal"
        return "near" if self.value is not None and self.value <= tolerance else "different"


def unlike(reason: str, pair: Pair | None = None, **details: Any) -> Difference:
    """Return the difference of what cannot be laid on one another, for a reason in words."""
    return Difference(None, reason=reason, details=details, pair=pair)


def figure(value: float | np.floating[Any]) -> float:
    """Return a measured number as documents show it, with six digits."""
    return float(f"{value:.6g}")


def shrunk(first: Doubles, second: Doubles) -> tuple[Doubles, Doubles]:
    """Return two arrays of finite numbers, divided by a power of two so that none is beyond 1: squares are finite."""
    exponent = np.frexp(max(np.abs(first).max(), np.abs(second).max()))[1]
    return np.ldexp(first, -exponent), np.ldexp(second, -exponent)


def diagonal(points: Doubles) -> float:
    """Return the diagonal of the box around points, (..., 3), none of them beyond 1; 1 where they are all the same."""
    return float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0))) or 1.0
