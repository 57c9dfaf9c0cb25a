"""Moves and resizes spheres so that their silhouettes come closer to a mesh's.

What is lowered is the area in which the silhouettes differ, in the mean over views. Its derivative lies on the outline
of the union of discs: where that runs outside the mesh's silhouette the disc should retreat, where it runs inside the
disc should grow, and what lies inside other discs does not count.
(Shape derivatives of areas: J. Sokolowski, J.-P. Zolesio, "Introduction to Shape Optimization", 1992; the descent:
D. P. Kingma, J. Ba, "Adam", 2015.)
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoprecalc.spheres.silhouettes import Views, spheres_per_pixel
from aoprecalc.types import BoolArray, Float32Array, Float64Array
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO

_BLUR = 0.7  # pixels: the step at a silhouette's edge becomes a slope, in which outlines come to rest
_SPOTS = 3200  # on the outlines of all spheres in one view
_FEWEST, _MOST = 12, 160  # on one
_HELD = 1 << 22  # in all views of a step: bounds memory
_KEEP, _KEEP_SQUARE, _TINY = 0.8, 0.95, 1e-12  # of the descent


class SilhouetteDescent:
    """Spheres on their way: centres (n, 3) and radii (n,) float64."""

    def __init__(self, centers: Float64Array, radii: Float64Array, wanted: BoolArray, seen: Views, batch: int) -> None:
        """Take the mesh's silhouettes, (d, size, size), in the views `seen`.

        batch   how many of them a step looks at; fewer if there are very many spheres
        """
        self.centers, self.radii = centers.copy(), radii.copy()
        self._spots = int(np.clip(_SPOTS // len(radii), _FEWEST, _MOST))
        self._seen, self._batch = seen, max(1, min(batch, len(seen), _HELD // (self._spots * len(radii))))
        # +1 outside the silhouettes, -1 inside, with a border for what leaves the picture.
        signs = np.pad(np.where(wanted, -1.0, 1.0).astype(np.float32), ((0, 0), (1, 1), (1, 1)), constant_values=1.0)
        self._signs: Float32Array = ndimage.gaussian_filter(signs, (0, _BLUR, _BLUR), mode="nearest")
        self._steps = 0
        self._mean = np.zeros((len(radii), 4))
        self._square = np.zeros((len(radii), 4))

    def step(self, pace: float, pull: Float64Array | None = None) -> None:
        """Move the outlines by about `pace` pixels.

        pull   (n, 4), the derivative of something else that is to be lowered, in pixels by (x, y, z, r) in pixels
        """
        seen = self._seen
        start = self._steps * self._batch
        which = np.arange(start, start + self._batch) % len(seen)
        slope = self._slope(which) if pull is None else self._slope(which) + pull
        self._steps += 1
        self._mean += (1 - _KEEP) * (slope - self._mean)
        self._square += (1 - _KEEP_SQUARE) * (slope**2 - self._square)
        mean = self._mean / (1 - _KEEP**self._steps)
        square = self._square / (1 - _KEEP_SQUARE**self._steps)
        move = pace / seen.scale * mean / (np.sqrt(square) + _TINY)
        self.centers -= move[:, :3]
        self.radii = np.maximum(self.radii - move[:, 3], 0.25 / seen.scale)

    def _slope(self, which: NDArray[np.intp]) -> Float64Array:
        """The derivative of the differing area, in pixels, by (x, y, z, r) in pixels, (n, 4): the mean over views."""
        seen = self._seen[which]
        columns, rows = seen.project(self.centers)
        radii = self.radii * seen.scale
        counts = spheres_per_pixel(self.centers, self.radii, seen)
        counts = np.pad(counts, ((0, 0), (1, 1), (1, 1)))

        spots = self._spots
        angles = 2 * np.pi * (np.arange(spots) + self._steps * INV_GOLDEN_RATIO % 1.0) / spots
        along, up = np.cos(angles), np.sin(angles)
        x = columns[..., None] + along * radii[:, None]  # (d, n, spots)
        y = rows[..., None] + up * radii[:, None]
        column = np.clip(np.floor(x) + 1, 0, seen.size + 1)
        row = np.clip(np.floor(y) + 1, 0, seen.size + 1)
        at = ((np.arange(len(which))[:, None, None] * (seen.size + 2) + row) * (seen.size + 2) + column).astype(
            np.int64
        )
        # Whether other discs cover the spot's pixel: all that do, but for the spot's own.
        own = (column - 0.5 - columns[..., None]) ** 2 + (row - 0.5 - rows[..., None]) ** 2 <= radii[:, None] ** 2
        outside = (x < 0) | (x >= seen.size) | (y < 0) | (y >= seen.size)
        free = (np.take(counts.ravel(), at) == own) | outside
        push = np.where(free, np.take(self._signs[which].ravel(), at), 0)
        arc = 2 * np.pi * radii / spots
        sideways, upward, outward = (push @ along) * arc, (push @ up) * arc, push.sum(axis=2) * arc
        slope = np.empty((len(radii), 4))
        slope[:, :3] = (sideways.T @ seen.across + upward.T @ seen.upward) / len(which)
        slope[:, 3] = outward.mean(axis=0)
        return slope
