"""An orthographic camera that looks down a little on what stands on the ground; y points up."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.raster.samples import CENTER
from aoprecalc.raster.spans import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.types import BoolArray, Float64Array, Int64Array

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

    axes: Float64Array
    middle: Float64Array
    scale: float
    width: int
    height: int

    @classmethod
    def framing(cls, points: Float64Array, width: int, height: int) -> Self:
        """Show all points, (k, 3), k >= 1, as large as the picture allows."""
        towards = _TOWARDS / np.linalg.norm(_TOWARDS)
        right = np.array([towards[2], 0.0, -towards[0]]) / np.hypot(towards[0], towards[2])
        axes = np.stack([right, np.cross(towards, right), towards])
        seen = points @ axes[:2].T
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = _MARGIN * float((np.array([width, height]) / np.maximum(high - low, 1e-6)).min())
        return cls(axes, (low + high) / 2, scale, width, height)

    def supersampled(self, times: int) -> "Camera":
        """Return the camera of the same picture with `times` as many pixels each way."""
        return Camera(self.axes, self.middle, self.scale * times, self.width * times, self.height * times)

    def project(self, points: Float64Array) -> Float64Array:
        """Return the column and row, in pixels, and the view_z, in units, of points: (..., 3) from (..., 3)."""
        seen: Float64Array = points @ self.axes.T
        seen[..., 0] = (seen[..., 0] - self.middle[0]) * self.scale + self.width / 2
        seen[..., 1] = (self.middle[1] - seen[..., 1]) * self.scale + self.height / 2
        return seen

    def unproject(self, view_z: Float64Array) -> Float64Array:
        """Return the points of that view_z, (height, width), that the centres of pixels show: (height, width, 3)."""
        across, upward = self._spread()
        right, top, towards = self.axes
        found: Float64Array = across[:, None] * right + upward[:, None, None] * top + view_z[..., None] * towards
        return found

    def ground_view_z(self, level: float) -> Float64Array:
        """Return the view_z, (height, width), of the plane y = `level` at the centres of pixels."""
        upward = self._spread()[1]
        view_z = (level - upward * self.axes[1, 1]) / self.axes[2, 1]
        return np.repeat(view_z[:, None], self.width, axis=1)

    def _spread(self) -> tuple[Float64Array, Float64Array]:
        """Where the centres of columns, (width,), and of rows, (height,), lie along the first two axes."""
        across = self.middle[0] + (np.arange(self.width) + 0.5 - self.width / 2) / self.scale
        return across, self.middle[1] + (self.height / 2 - 0.5 - np.arange(self.height)) / self.scale


# Draws triangles and spheres through a z-buffer: what each pixel's centre shows of them.

_STEPS = float(1 << 30)  # of depth between the nearest and the farthest corner
_NUMBER = 32  # bits that hold the number of a triangle, below its depth
_NOTHING = np.iinfo(np.int64).max


@dataclass(frozen=True, eq=False)
class GBuffer:
    """What is seen at each pixel.

    mask       (height, width) bool: there is something
    view_z   (height, width) float64: towards the camera, -inf where there is nothing
    normals    (height, width, 3) float64: unit vectors on the camera's side, 0 where there is nothing
    """

    mask: BoolArray
    view_z: Float64Array
    normals: Float64Array


def rasterize_mesh(corners: Float64Array, normals: Float64Array, camera: Camera) -> GBuffer:
    """Look at triangles, (f, 3, 3), with normals at their corners, (f, 3, 3), from either side."""
    places = camera.project(corners)
    front = _front(places, camera)
    mask = front >= 0
    found = places[front[mask]]
    weights = _weights(found, np.stack(np.nonzero(mask)[::-1]).astype(np.float64) + 0.5)
    view_z = np.full(front.shape, -np.inf)
    view_z[mask] = (weights * found[..., 2]).sum(axis=1)
    pointing = np.einsum("kc,kcx->kx", weights, normals[front[mask]])
    # The normals' side is that of the face; of one seen from behind they point away.
    sides = corners[front[mask]]
    faces = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    agree = np.einsum("kx,kx->k", faces, pointing) * (faces @ camera.axes[2])
    pointing[agree < 0] *= -1
    lengths = np.linalg.norm(pointing, axis=1, keepdims=True)
    found_normals = np.zeros((*front.shape, 3))
    found_normals[mask] = pointing / np.where(lengths > 0, lengths, 1)
    return GBuffer(mask, view_z, found_normals)


def rasterize_spheres(centers: Float64Array, radii: Float64Array, camera: Camera) -> GBuffer:
    """Look at spheres, (n, 3) and (n,) >= 0, exactly: no triangles."""
    shape = camera.height, camera.width
    view_z, normals = np.full(shape, -np.inf), np.zeros((*shape, 3))
    for (column, row, near), radius in zip(camera.project(centers), radii, strict=True):
        reach = radius * camera.scale
        rows, columns = (
            np.arange(*np.clip([np.ceil(at - reach - 0.5), np.floor(at + reach + 0.5)], 0, most).astype(int))
            for at, most in ((row, camera.height), (column, camera.width))
        )
        if not len(rows) or not len(columns):
            continue
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        across, upward = (columns + 0.5 - column) / camera.scale, (row - rows - 0.5) / camera.scale
        squared = radius**2 - across**2 - upward[:, None] ** 2
        depth = np.sqrt(np.maximum(squared, 0.0))
        front = (squared > 0) & (near + depth > view_z[box])
        view_z[box][front] = (near + depth)[front]
        sides = np.stack([*np.broadcast_arrays(across, upward[:, None]), depth], axis=-1)[front]
        normals[box][front] = sides @ camera.axes / radius
    return GBuffer(np.isfinite(view_z), view_z, normals)


def _front(places: Float64Array, camera: Camera) -> Int64Array:
    """The triangle, of (f, 3, 3) columns, rows and nearnesses, in front at each pixel, (height, width); -1: none."""
    planes = _planes(places)
    nearest, farthest = places[..., 2].max(axis=1), places[..., 2].min(axis=1)
    top, span = nearest.max(), max(float(np.ptp(places[..., 2])), 1e-12)
    drawn = np.full(camera.height * camera.width, _NOTHING)
    shapes = snap_to_grid(places[..., :2].astype(np.float32), CENTER)
    for triangle, first, length in triangle_spans(shapes, camera.width, 0, camera.height):
        for run, step in expand_counts(length):
            number, pixel = triangle[run], first[run] + step
            row, column = np.divmod(pixel, camera.width)
            x, y, constant = planes[:, number]
            near = np.clip(x * (column + 0.5) + y * (row + 0.5) + constant, farthest[number], nearest[number])
            depth = np.rint((top - near) / span * _STEPS).astype(np.int64)
            np.minimum.at(drawn, pixel, depth << _NUMBER | number)
    found: Int64Array = np.where(drawn == _NOTHING, -1, drawn & ((1 << _NUMBER) - 1))
    return found.reshape(camera.height, camera.width)


def _planes(places: Float64Array) -> Float64Array:
    """The view_z of each triangle's plane as x column + y row + constant, (3, f); of one seen edge-on, its middle."""
    (bx, by, bz), (cx, cy, cz) = ((places[:, corner] - places[:, 0]).T for corner in (1, 2))
    area = bx * cy - by * cx
    flat = np.abs(area) < 1e-9
    area = np.where(flat, 1.0, area)
    x, y = (bz * cy - by * cz) / area, (bx * cz - bz * cx) / area
    x[flat], y[flat] = 0, 0
    at = np.where(flat, places[..., 2].mean(axis=1), places[:, 0, 2] - x * places[:, 0, 0] - y * places[:, 0, 1])
    return np.stack([x, y, at])


def _weights(places: Float64Array, pixels: Float64Array) -> Float64Array:
    """Barycentric weights, (k, 3), >= 0 and of sum 1, of (2, k) columns and rows in (k, 3, 3) seen triangles."""
    a, b, c = (places[:, corner, :2].T for corner in range(3))
    (bx, by), (cx, cy), (px, py) = b - a, c - a, pixels - a
    area = bx * cy - by * cx
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    second, third = (px * cy - py * cx) / area, (bx * py - by * px) / area
    weights: Float64Array = np.clip(np.stack([1 - second - third, second, third], axis=1), 0, 1)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights
