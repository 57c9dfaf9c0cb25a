"""A z-buffer rasteriser for triangles and spheres, with an orthographic camera that looks down a little; y points up.

View-space z points towards the camera: of two points at a pixel, the one with the larger z is visible.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.mesh.normals import normalize
from aoprecalc.raster.layout import CENTER
from aoprecalc.raster.spans import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.types import BoolArray, Float64Array, Int64Array

_CAMERA_DIRECTION = np.array([0.38, 0.56, 0.86])  # towards the camera; normalised below
_FRAME_SHARE = 0.92  # of the picture's width or height that the framed points fill

_DEPTH_STEPS = float(1 << 30)  # between the nearest and the farthest corner
_INDEX_BITS = 32  # below the depth in a z-buffer entry
_EMPTY = np.iinfo(np.int64).max


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic camera.

    axes              (3, 3) float64: unit vectors to the picture's right, to its top and towards the camera
    center            (2,) float64: the picture's centre along the first two axes
    pixels_per_unit   > 0
    width, height     of the picture, in pixels
    """

    axes: Float64Array
    center: Float64Array
    pixels_per_unit: float
    width: int
    height: int

    @classmethod
    def framing(cls, points: Float64Array, width: int, height: int) -> Self:
        """Place the camera so that points, (k, 3) with k >= 1, fill the picture."""
        towards = _CAMERA_DIRECTION / np.linalg.norm(_CAMERA_DIRECTION)
        right = np.array([towards[2], 0.0, -towards[0]]) / np.hypot(towards[0], towards[2])
        axes = np.stack([right, np.cross(towards, right), towards])
        projected = points @ axes[:2].T
        low, high = projected.min(axis=0), projected.max(axis=0)
        scale = _FRAME_SHARE * float((np.array([width, height]) / np.maximum(high - low, 1e-6)).min())
        return cls(axes, (low + high) / 2, scale, width, height)

    def supersampled(self, factor: int) -> "Camera":
        """Return the camera of the same view with `factor` times as many pixels along each side."""
        return Camera(self.axes, self.center, self.pixels_per_unit * factor, self.width * factor, self.height * factor)

    def project(self, points: Float64Array) -> Float64Array:
        """Return the column and row in pixels and the view-space z of points, (..., 3) from (..., 3)."""
        projected: Float64Array = points @ self.axes.T
        projected[..., 0] = (projected[..., 0] - self.center[0]) * self.pixels_per_unit + self.width / 2
        projected[..., 1] = (self.center[1] - projected[..., 1]) * self.pixels_per_unit + self.height / 2
        return projected

    def unproject(self, view_z: Float64Array) -> Float64Array:
        """Return the points at pixel centres with view-space z, (height, width); (height, width, 3)."""
        x, y = self._pixel_centers()
        right, top, towards = self.axes
        points: Float64Array = x[:, None] * right + y[:, None, None] * top + view_z[..., None] * towards
        return points

    def ground_view_z(self, level: float) -> Float64Array:
        """Return the view-space z of the plane y = `level` at pixel centres, (height, width)."""
        y = self._pixel_centers()[1]
        view_z = (level - y * self.axes[1, 1]) / self.axes[2, 1]
        return np.repeat(view_z[:, None], self.width, axis=1)

    def _pixel_centers(self) -> tuple[Float64Array, Float64Array]:
        """Return the view-space x of columns, (width,), and y of rows, (height,)."""
        x = self.center[0] + (np.arange(self.width) + 0.5 - self.width / 2) / self.pixels_per_unit
        y = self.center[1] + (self.height / 2 - 0.5 - np.arange(self.height)) / self.pixels_per_unit
        return x, y


@dataclass(frozen=True, eq=False)
class GBuffer:
    """The visible surface at each pixel.

    mask      (height, width) bool: there is a surface
    view_z    (height, width) float64: -inf without a surface
    normals   (height, width, 3) float64: unit vectors that face the camera, 0 without a surface
    """

    mask: BoolArray
    view_z: Float64Array
    normals: Float64Array


def rasterize_mesh(corners: Float64Array, normals: Float64Array, camera: Camera) -> GBuffer:
    """Rasterise triangles, (f, 3, 3), with normals at their corners, (f, 3, 3); both sides are visible."""
    projected = camera.project(corners)
    visible = _visible_triangles(projected, camera)
    mask = visible >= 0
    triangles = projected[visible[mask]]
    weights = _barycentric_weights(triangles, np.stack(np.nonzero(mask)[::-1]).astype(np.float64) + 0.5)
    view_z = np.full(visible.shape, -np.inf)
    view_z[mask] = (weights * triangles[..., 2]).sum(axis=1)
    interpolated = np.einsum("kc,kcx->kx", weights, normals[visible[mask]])
    # Where the back of a face is visible, the normal points away from the camera: flip it.
    positions = corners[visible[mask]]
    face_normals = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
    facing = np.einsum("kx,kx->k", face_normals, interpolated) * (face_normals @ camera.axes[2])
    interpolated[facing < 0] *= -1
    pixel_normals = np.zeros((*visible.shape, 3))
    pixel_normals[mask] = normalize(interpolated)
    return GBuffer(mask, view_z, pixel_normals)


def rasterize_spheres(centers: Float64Array, radii: Float64Array, camera: Camera) -> GBuffer:
    """Rasterise spheres, (n, 3) and (n,) >= 0, analytically."""
    shape = camera.height, camera.width
    view_z, normals = np.full(shape, -np.inf), np.zeros((*shape, 3))
    for (column, row, center_z), radius in zip(camera.project(centers), radii, strict=True):
        pixel_radius = radius * camera.pixels_per_unit
        rows, columns = (
            np.arange(
                *np.clip([np.ceil(at - pixel_radius - 0.5), np.floor(at + pixel_radius + 0.5)], 0, end).astype(int)
            )
            for at, end in ((row, camera.height), (column, camera.width))
        )
        if not len(rows) or not len(columns):
            continue
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        x, y = (columns + 0.5 - column) / camera.pixels_per_unit, (row - rows - 0.5) / camera.pixels_per_unit
        squared = radius**2 - x**2 - y[:, None] ** 2
        z = np.sqrt(np.maximum(squared, 0.0))
        visible = (squared > 0) & (center_z + z > view_z[box])
        view_z[box][visible] = (center_z + z)[visible]
        offsets = np.stack([*np.broadcast_arrays(x, y[:, None]), z], axis=-1)[visible]
        normals[box][visible] = offsets @ camera.axes / radius
    return GBuffer(np.isfinite(view_z), view_z, normals)


def _visible_triangles(projected: Float64Array, camera: Camera) -> Int64Array:
    """Return the index of the projected triangle, (f, 3, 3), visible at each pixel, (height, width); -1 if none."""
    planes = _plane_equations(projected)
    max_z, min_z = projected[..., 2].max(axis=1), projected[..., 2].min(axis=1)
    nearest, extent = max_z.max(), max(float(np.ptp(projected[..., 2])), 1e-12)
    z_buffer = np.full(camera.height * camera.width, _EMPTY)
    snapped = snap_to_grid(projected[..., :2].astype(np.float32), CENTER)
    for triangle, first, length in triangle_spans(snapped, camera.width, 0, camera.height):
        for span, step in expand_counts(length):
            index, pixel = triangle[span], first[span] + step
            row, column = np.divmod(pixel, camera.width)
            a, b, c = planes[:, index]
            z = np.clip(a * (column + 0.5) + b * (row + 0.5) + c, min_z[index], max_z[index])
            depth = np.rint((nearest - z) / extent * _DEPTH_STEPS).astype(np.int64)
            np.minimum.at(z_buffer, pixel, depth << _INDEX_BITS | index)
    indices: Int64Array = np.where(z_buffer == _EMPTY, -1, z_buffer & ((1 << _INDEX_BITS) - 1))
    return indices.reshape(camera.height, camera.width)


def _plane_equations(projected: Float64Array) -> Float64Array:
    """Return (a, b, c), (3, f), with view-space z = a column + b row + c; edge-on triangles get their mean z."""
    (bx, by, bz), (cx, cy, cz) = ((projected[:, corner] - projected[:, 0]).T for corner in (1, 2))
    area = bx * cy - by * cx
    edge_on = np.abs(area) < 1e-9
    area = np.where(edge_on, 1.0, area)
    a, b = (bz * cy - by * cz) / area, (bx * cz - bz * cx) / area
    a[edge_on], b[edge_on] = 0, 0
    c = projected[:, 0, 2] - a * projected[:, 0, 0] - b * projected[:, 0, 1]
    return np.stack([a, b, np.where(edge_on, projected[..., 2].mean(axis=1), c)])


def _barycentric_weights(triangles: Float64Array, pixels: Float64Array) -> Float64Array:
    """Return weights, (k, 3), >= 0 and of sum 1, of pixels, (2, k) columns and rows, in triangles, (k, 3, 3)."""
    a, b, c = (triangles[:, corner, :2].T for corner in range(3))
    (bx, by), (cx, cy), (px, py) = b - a, c - a, pixels - a
    area = bx * cy - by * cx
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    second, third = (px * cy - py * cx) / area, (bx * py - by * px) / area
    weights: Float64Array = np.clip(np.stack([1 - second - third, second, third], axis=1), 0, 1)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights
