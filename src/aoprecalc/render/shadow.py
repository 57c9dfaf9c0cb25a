"""Soft shadows on the ground: of the key light, a disc of directions, and of the sky."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aoprecalc.render.camera import Camera
from aoprecalc.render.visible_surface import SurfaceDrawer
from aoprecalc.types import Float32Array, Float64Array
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, orthonormal_basis

MAX_MAP, _MIN_MAP = 384, 96  # points along each side of the map
_PER_PIXEL = 0.32  # of them, of the longer side of the picture
_SKY_DIRECTIONS, _KEY_DIRECTIONS = 96, 64
_MIN_RISE = 0.12  # of a direction: what is nearer to the horizon casts shadows far beyond the picture
_WIDEN, _MIN_SIDE = 1.6, 0.5  # side of the map in extents of the shadow, and the least one in radii
_FADE = 0.3  # of half the side: where the shadow fades away
_MANY_TRIANGLES, _STEP = 20_000, 0.01  # beyond as many triangles, vertices that cast shadows lie on a grid; radii
_BLUR = 2.0 / MAX_MAP  # sides of the map: standard deviation of what hides the steps between directions
_MIN_BLUR = 1.2  # points of the map: what hides its steps along the edge where the mesh touches the ground


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
    sky      (n, n) float32 in [0, 1]: share of the sky that is blocked, weighted by the cosine to the ground's normal
    """

    height: float
    window: Float64Array
    key: Float32Array
    sky: Float32Array

    def light(self, camera: Camera, key_share: float, sky_share: float) -> Float32Array:
        """Return the share of its light that the ground has in each pixel, (rows, width) float32; 1 above the horizon.

        key_share, sky_share   what the light's two parts would be without a shadow; the rest is never blocked
        """
        lit = 1 - self._fade() * (np.float32(key_share) * self.key + np.float32(sky_share) * self.sky)
        across, upward = camera.tangents
        x = (2 / camera.width * (np.arange(camera.width) + 0.5) - 1) * across
        y = (1 - 2 / camera.height * (np.arange(*camera.rows) + 0.5)) * upward
        right, top, towards = camera.axes
        rays = y[:, None] * top - towards  # through the middle column; the others differ along the horizontal `right`
        light: Float32Array = np.ones(camera.shape, np.float32)
        falling = np.flatnonzero(rays[:, 1] * (self.height - camera.eye[1]) > 0)
        if len(falling):
            along = (self.height - camera.eye[1]) / rays[falling, 1]
            scale = len(lit) / self.window[2]
            column, row = (
                (
                    ((camera.eye[axis] + along * rays[falling, axis] - corner) * scale)[:, None]
                    + (along * right[axis] * scale)[:, None] * x
                    - 0.5
                ).astype(np.float32)
                for axis, corner in ((0, self.window[0]), (2, self.window[1]))
            )
            light[falling] = _look_up(lit, column, row)
        return light

    def _fade(self) -> Float32Array:
        """Return weights from 1 in the middle of the map to 0 at its edge, (n, n) float32."""
        size = len(self.key)
        at = (2 * np.arange(size, dtype=np.float32) + 1) / size - 1
        distance = np.sqrt(at**2 + at[:, None] ** 2)
        share = np.clip((1 - distance) / np.float32(_FADE), 0, 1)
        return np.asarray(share * share * (3 - 2 * share), np.float32)


def cast_shadow(
    drawer: SurfaceDrawer, directions: Float64Array, height: float, window: Float64Array, size: int = MAX_MAP
) -> Float32Array:
    """Return the share of the directions towards light that are blocked at points of the ground, see GroundShadow."""
    return _blurred(drawer.count_shadows(directions, height, window, size) / np.float32(len(directions)))


def map_size(pixels: int) -> int:
    """Return the points along each side of the map for a picture with as many pixels along its longer side."""
    return min(max(round(_PER_PIXEL * pixels), _MIN_MAP), MAX_MAP)


def shadow_window(points: Float64Array, height: float, lights: Sequence[AreaLight]) -> Float64Array:
    """Return the square of the ground around (k, 3) points and their shadows, see GroundShadow."""
    casts = [points, *(shadow_points(points, height, light) for light in lights)]
    low = np.min([cast[:, [0, 2]].min(axis=0) for cast in casts], axis=0)
    high = np.max([cast[:, [0, 2]].max(axis=0) for cast in casts], axis=0)
    side = max(_WIDEN * float((high - low).max()), _MIN_SIDE)
    return np.array([*((low + high - side) / 2), side])


def shadow_points(points: Float64Array, height: float, light: AreaLight) -> Float64Array:
    """Return where the centre of the light casts the shadows of (k, 3) points, (k, 3)."""
    x, y, z = light.direction
    rise = (points[:, 1] - height) / y
    return np.stack([points[:, 0] - rise * x, np.full(len(points), height), points[:, 2] - rise * z], axis=1)


def simplified(corners: Float32Array) -> Float32Array:
    """Return few triangles, (s, 3, 3), whose shadows are those of (o, 3, 3) corners, where these are very many.

    Vertices are moved to a grid as fine as the map of the ground; triangles without area go (J. Rossignac,
    P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993).
    """
    if len(corners) <= _MANY_TRIANGLES:
        return corners
    steps = np.rint((corners + 1) / np.float32(_STEP)).astype(np.int64)
    keys = np.sort((steps[..., 0] << 40) + (steps[..., 1] << 20) + steps[..., 2], axis=1)
    keys = keys[(keys[:, 0] < keys[:, 1]) & (keys[:, 1] < keys[:, 2])]
    keys = np.unique(keys, axis=0) if len(keys) else np.zeros((1, 3), np.int64)
    back = np.stack([keys >> 40, keys >> 20 & 0xFFFFF, keys & 0xFFFFF], axis=-1)
    return (back * _STEP - 1).astype(np.float32)


def _look_up(values: Float32Array, column: Float32Array, row: Float32Array) -> Float32Array:
    """Look (n, n) values up at k places, in texels from the centre of the first; 1 outside. Bilinear."""
    size = len(values)
    inside = (column >= 0) & (column < size - 1) & (row >= 0) & (row < size - 1)
    found = np.ones(column.shape, np.float32)
    column, row = column[inside], row[inside]
    left, upper = column.astype(np.int32), row.astype(np.int32)
    across, down = column - left, row - upper
    first = upper * size + left
    flat = values.ravel()
    top = flat[first]
    top += (flat[first + 1] - top) * across
    bottom = flat[first + size]
    bottom += (flat[first + size + 1] - bottom) * across
    found[inside] = top + (bottom - top) * down
    return found


def _blurred(values: Float32Array) -> Float32Array:
    """Convolve (n, n) values with a Gaussian."""
    blur = max(_BLUR * len(values), _MIN_BLUR)
    reach = int(np.ceil(3 * blur))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / blur) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for _ in range(2):
        padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
        blurred = np.zeros_like(values)
        for k, weight in enumerate(weights):
            blurred += weight * padded[k : k + len(values)]
        values = np.ascontiguousarray(blurred.T)
    return values
