"""An orthographic camera that looks down a little on what stands on the ground; y points up."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.model import Doubles

_TOWARDS = np.array([0.38, 0.56, 0.86])  # the camera, from what it looks at; made a unit vector below
_MARGIN = 0.92  # share of the picture that may be filled


@dataclass(frozen=True, eq=False)
class Camera:
    """Where points are seen in a picture.

    axes            (3, 3) float64: the unit vectors to the picture's right, to its top and towards the camera
    middle          (2,) float64: what is seen in the middle of the picture, along the first two axes
    scale           pixels a unit, > 0
    width, height   of the picture, in pixels
    """

    axes: Doubles
    middle: Doubles
    scale: float
    width: int
    height: int

    @classmethod
    def around(cls, points: Doubles, width: int, height: int) -> Self:
        """Show all points, (k, 3), k >= 1, as large as the picture allows."""
        towards = _TOWARDS / np.linalg.norm(_TOWARDS)
        right = np.array([towards[2], 0.0, -towards[0]]) / np.hypot(towards[0], towards[2])
        axes = np.stack([right, np.cross(towards, right), towards])
        seen = points @ axes[:2].T
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = _MARGIN * float((np.array([width, height]) / np.maximum(high - low, 1e-6)).min())
        return cls(axes, (low + high) / 2, scale, width, height)

    def finer(self, times: int) -> "Camera":
        """Return the camera of the same picture with `times` as many pixels each way."""
        return Camera(self.axes, self.middle, self.scale * times, self.width * times, self.height * times)

    def places(self, points: Doubles) -> Doubles:
        """Return the column and row, in pixels, and the nearness, in units, of points: (..., 3) from (..., 3)."""
        seen: Doubles = points @ self.axes.T
        seen[..., 0] = (seen[..., 0] - self.middle[0]) * self.scale + self.width / 2
        seen[..., 1] = (self.middle[1] - seen[..., 1]) * self.scale + self.height / 2
        return seen

    def points(self, nearness: Doubles) -> Doubles:
        """Return the points of that nearness, (height, width), that the centres of pixels show: (height, width, 3)."""
        across, upward = self._spread()
        right, top, towards = self.axes
        found: Doubles = across[:, None] * right + upward[:, None, None] * top + nearness[..., None] * towards
        return found

    def ground(self, level: float) -> Doubles:
        """Return the nearness, (height, width), of the plane y = `level` at the centres of pixels."""
        upward = self._spread()[1]
        nearness = (level - upward * self.axes[1, 1]) / self.axes[2, 1]
        return np.repeat(nearness[:, None], self.width, axis=1)

    def _spread(self) -> tuple[Doubles, Doubles]:
        """Where the centres of columns, (width,), and of rows, (height,), lie along the first two axes."""
        across = self.middle[0] + (np.arange(self.width) + 0.5 - self.width / 2) / self.scale
        return across, self.middle[1] + (self.height / 2 - 0.5 - np.arange(self.height)) / self.scale
