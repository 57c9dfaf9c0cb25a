"""Soft shadows on the ground: of the key light, a disc of directions, and of the sky."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.render.visible_surface import SurfaceDrawer
from aoprecalc.types import Float32Array, Float64Array
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, orthonormal_basis

_SIZE = 384  # points of the ground along each side of the map
_SKY_DIRECTIONS, _KEY_DIRECTIONS = 64, 64
_MIN_RISE = 0.12  # of a direction: what is nearer to the horizon casts shadows far beyond the picture
_BLUR = 2.0  # points of the map: standard deviation of what hides the steps between directions


@dataclass(frozen=True)
class AreaLight:
    """A round light, infinitely far away.

    direction   the unit vector towards its centre, y > 0
    radius      its angular radius in radians
    """

    direction: tuple[float, float, float]
    radius: float

    def directions(self, count: int = _KEY_DIRECTIONS) -> Float64Array:
        """Return unit vectors towards points spread evenly over it, (count, 3) (H. Vogel's spiral, 1979)."""
        index = np.arange(count)
        theta = self.radius * np.sqrt((index + 0.5) / count)
        phi = 2 * np.pi * (index * INV_GOLDEN_RATIO % 1.0)
        center = np.array(self.direction)
        across, upward = (axis[0] for axis in orthonormal_basis(center[None]))
        radial = np.cos(phi)[:, None] * across + np.sin(phi)[:, None] * upward
        directions: Float64Array = np.sin(theta)[:, None] * radial + np.cos(theta)[:, None] * center
        return directions


def sky_directions(count: int = _SKY_DIRECTIONS) -> Float64Array:
    """Return unit vectors above the ground with a density of their cosine to the upward axis, (count, 3)."""
    index = np.arange(count)
    rise = np.maximum(np.sqrt(1 - (index + 0.5) / count), _MIN_RISE)
    phi = 2 * np.pi * (index * INV_GOLDEN_RATIO % 1.0)
    flat = np.sqrt(1 - rise**2)
    return np.stack([flat * np.cos(phi), rise, flat * np.sin(phi)], axis=1)


@dataclass(frozen=True, eq=False)
class GroundShadow:
    """The shares of light that do not reach the ground, on a square map of it.

    height   y of the ground
    window   x and z of the first corner of the square, and its side, (3,); rows along z, columns along x
    key      (n, n) float32 in [0, 1]: share of the key light that is blocked
    sky      (n, n) float32 in [0, 1]: share of the sky that is blocked, weighted by the cosine to its normal
    """

    height: float
    window: Float64Array
    key: Float32Array
    sky: Float32Array

    @classmethod
    def cast(cls, drawer: SurfaceDrawer, points: Float64Array, light: AreaLight) -> "GroundShadow":
        """Compute the shadows of what `drawer` draws, bounded by (k, 3) points, on the plane below it."""
        height = float(points[:, 1].min())
        window = shadow_window(points, height, light)
        key, sky = (
            drawer.count_shadows(directions, height, window, _SIZE) / np.float32(len(directions))
            for directions in (light.directions(), sky_directions())
        )
        return cls(height, window, _blurred(key), _blurred(sky))

    def look_up(self, x: Float32Array, z: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return the blocked shares of the key light and of the sky at k points of the ground, (k,) each.

        They fade to 0 towards the edge of the map.
        """
        size = len(self.key)
        scale = size / self.window[2]
        column, row = (x - self.window[0]) * scale - 0.5, (z - self.window[1]) * scale - 0.5
        inside = (column >= 0) & (column < size - 1) & (row >= 0) & (row < size - 1)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        left, upper = column.astype(np.int64), row.astype(np.int64)
        across, down = (column - left).astype(np.float32), (row - upper).astype(np.float32)
        first = upper * size + left
        # Smoothly from 1 in the middle to 0 at the edge of the inscribed circle.
        distance = np.hypot(column - size / 2, row - size / 2) / (size / 2)
        fade = np.where(inside, _smooth_step((1 - distance) / 0.3), 0).astype(np.float32)
        shares = []
        for values in (self.key.ravel(), self.sky.ravel()):
            top = values[first] * (1 - across) + values[first + 1] * across
            bottom = values[first + size] * (1 - across) + values[first + size + 1] * across
            shares.append((top * (1 - down) + bottom * down) * fade)
        return shares[0], shares[1]


def shadow_window(points: Float64Array, height: float, light: AreaLight) -> Float64Array:
    """Return the square of the ground around (k, 3) points and their shadows, see GroundShadow."""
    cast = shadow_points(points, height, light)
    both = np.concatenate([points[:, [0, 2]], cast[:, [0, 2]]])
    low, high = both.min(axis=0), both.max(axis=0)
    side = max(1.6 * float((high - low).max()), 0.5)
    return np.array([*((low + high - side) / 2), side])


def shadow_points(points: Float64Array, height: float, light: AreaLight) -> Float64Array:
    """Return where the centre of the light casts the shadows of (k, 3) points, (k, 3)."""
    x, y, z = light.direction
    rise = (points[:, 1] - height) / y
    return np.stack([points[:, 0] - rise * x, np.full(len(points), height), points[:, 2] - rise * z], axis=1)


def _smooth_step(value: Float64Array) -> Float64Array:
    value = np.clip(value, 0, 1)
    return value * value * (3 - 2 * value)


def _blurred(values: Float32Array) -> Float32Array:
    """Convolve (n, n) values with a Gaussian."""
    reach = int(3 * _BLUR)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / _BLUR) ** 2)
    weights /= weights.sum()
    for _ in range(2):
        padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
        blurred = sum(weight * padded[k : k + len(values)] for k, weight in enumerate(weights.astype(np.float32)))
        values = np.ascontiguousarray(np.asarray(blurred, np.float32).T)
    return values
