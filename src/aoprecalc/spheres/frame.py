"""The coordinates in which spheres are fitted: the mesh's box, centred and scaled to [-1, 1]."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.model import Doubles


@dataclass(frozen=True, eq=False)
class Frame:
    """Moves a mesh to the origin and scales it, so that its place and size in the file do not matter.

    center     (3,) float64: the middle of the mesh's bounding box, in the mesh's units
    scale      half the longest side of the box, in the mesh's units, > 0
    diagonal   of the box, in units of `scale`: 2 to 2 sqrt(3); 0 for a single point
    """

    center: Doubles
    scale: float
    diagonal: float

    @classmethod
    def around(cls, positions: Doubles) -> Self:
        """Frame the bounding box of finite positions, (v, 3) float64, v >= 1."""
        low, high = positions.min(axis=0) / 2, positions.max(axis=0) / 2  # halved first: no sum overflows
        half = high - low
        scale = float(half.max()) or 1.0
        return cls(low + high, scale, 2 * float(np.linalg.norm(half / scale)))

    def enter(self, positions: Doubles) -> Doubles:
        """Bring positions, (..., 3) float64, from the mesh's coordinates into the frame."""
        return (positions - self.center) / self.scale

    def leave(self, positions: Doubles) -> Doubles:
        """Bring positions, (..., 3) float64, from the frame back to the mesh's coordinates."""
        return positions * self.scale + self.center
