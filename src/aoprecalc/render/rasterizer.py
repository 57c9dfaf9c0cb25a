"""Previews of a mesh beside sphere sets by a NumPy z-buffer, with an orthographic camera; y points up.

View-space z points towards the camera: of two points at a pixel, the one with the larger z is visible.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from aoprecalc.mesh.surface import normalize, shading_normals
from aoprecalc.raster.cpu_rasterizer import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.raster.layout import CENTER
from aoprecalc.spheres.sampling import NormalizedFrame
from aoprecalc.spheres.silhouettes import Views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, Picture, Scene
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, orthonormal_basis

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


LIGHT_DIRECTION = np.array([-0.44, 1.0, 0.06]) / np.linalg.norm([-0.44, 1.0, 0.06])  # towards the light's centre
_LIGHT_SAMPLES, _LIGHT_RADIUS = 64, np.radians(20)
_CONCENTRATION = 0.6  # 0.5 is uniform on a disc; larger concentrates samples at the centre and fades the penumbra
_SHADOW_RESOLUTION = 400  # pixels per side of the silhouettes that cast shadows
_BLUR = 0.016  # units: hides the steps between light samples
_KEY, _SKY, _BOUNCE = 0.78, 0.36, 0.16  # intensity of the light, of the sky and of the light reflected by the ground

_SUPERSAMPLING = 3  # per axis
_PAPER = np.array([0.93, 0.93, 0.915])  # linear, as all colours here
_MESH_COLOR, _SPHERE_COLOR = np.array([0.66, 0.59, 0.50]), np.array([0.42, 0.54, 0.66])
_SHADOW_ABSORPTION = np.array([0.80, 0.77, 0.71])  # fraction of the paper's colour that full shadow removes
_GROUND_TOLERANCE = 1e-6  # normalised: surfaces this far below the ground are visible

SilhouetteFunction = Callable[[Views], BoolArray]  # returns masks, (d, resolution, resolution)
Spheres = tuple[Float64Array, Float64Array]
Up = Literal["y", "z"]


def preview_image(
    scene: Scene, centers: Float64Array, radii: Float64Array, size: tuple[int, int] = (1200, 480), up: Up = "y"
) -> Picture:
    """Draw a mesh on the left and spheres, (n, 3) and (n,) in its coordinates, on the right.

    size   width and height in pixels, at least 2 x 1
    up     the mesh's upward axis, y or z

    Returns (height, width, 3) uint8, sRGB, row 0 on top. The same input gives the same picture.
    """
    width, height = size
    left = width // 2
    panels = preview_panels(scene, [(centers, radii)], (width - left, height), up)
    return np.concatenate([panels[0][:, :left], panels[1]], axis=1)


def preview_panels(
    scene: Scene, sets: list[Spheres], size: tuple[int, int] = (600, 480), up: Up = "y"
) -> list[Picture]:
    """Draw a mesh, then each sphere set, with the same camera and light; arguments as for `preview_image`.

    Returns 1 + len(sets) pictures, (height, width, 3) uint8 each, of width and height `size`.
    """
    frame = NormalizedFrame.from_positions(scene.positions)
    positions = _to_y_up(frame.to_normalized(scene.positions), up)
    normalized_sets = [(_to_y_up(frame.to_normalized(centers), up), radii / frame.scale) for centers, radii in sets]
    ground = float(positions[:, 1].min())
    camera = Camera.framing(_points_to_frame(positions, normalized_sets, ground), *size)

    normals = _to_y_up(shading_normals(scene), up)
    surface = rasterize_mesh(positions[scene.faces], normals, camera.supersampled(_SUPERSAMPLING))
    max_distance = float(np.linalg.norm(positions, axis=1).max())
    shadow = ground_shadow(mesh_caster(positions, scene.faces), max_distance, ground, camera)
    panels = [_shaded_picture(surface, shadow, ground, camera, _MESH_COLOR)]
    for centers, radii in normalized_sets:
        surface = rasterize_spheres(centers, radii, camera.supersampled(_SUPERSAMPLING))
        max_distance = float((np.linalg.norm(centers, axis=1) + radii).max()) or 1.0
        shadow = ground_shadow(sphere_caster(centers, radii), max_distance, ground, camera)
        panels.append(_shaded_picture(surface, shadow, ground, camera, _SPHERE_COLOR))
    return panels


def light_directions() -> Float64Array:
    """Return unit vectors towards samples of the light, (64, 3), from its centre outwards."""
    index = np.arange(_LIGHT_SAMPLES)
    theta = _LIGHT_RADIUS * ((index + 0.5) / _LIGHT_SAMPLES) ** _CONCENTRATION
    phi = 2 * np.pi * (index * INV_GOLDEN_RATIO % 1.0)
    across, upward = (axis[0] for axis in orthonormal_basis(LIGHT_DIRECTION[None]))
    radial = np.cos(phi)[:, None] * across + np.sin(phi)[:, None] * upward
    directions: Float64Array = np.sin(theta)[:, None] * radial + np.cos(theta)[:, None] * LIGHT_DIRECTION
    return directions


def shade(normals: Float64Array) -> Float64Array:
    """Return the linear brightness of a white surface with unit normals, (..., 3); (...,), about 0.1 to 1."""
    upward = normals[..., 1]
    cos = normals @ LIGHT_DIRECTION
    wrap = np.sin(_LIGHT_RADIUS)  # the light's edge still reaches a surface that faces away from its centre
    key = np.where(cos > wrap, cos, np.maximum(cos + wrap, 0) ** 2 / (4 * wrap))
    brightness: Float64Array = _KEY * key + _SKY * (0.5 + 0.5 * upward) + _BOUNCE * (0.5 - 0.5 * upward)
    return brightness


def mesh_caster(positions: Float64Array, faces: Int32Array) -> SilhouetteFunction:
    """Return the silhouette function of (f, 3) faces over (v, 3) positions."""
    return lambda views: mesh_silhouettes(positions, faces, views)


def sphere_caster(centers: Float64Array, radii: Float64Array) -> SilhouetteFunction:
    """Return the silhouette function of spheres, (n, 3) and (n,)."""
    return lambda views: spheres_per_pixel(centers, radii, views) > 0


def ground_shadow(caster: SilhouetteFunction, max_distance: float, ground: float, camera: Camera) -> Float32Array:
    """Compute the occluded fraction of the light on the plane y = `ground` at each pixel, (height, width) in [0, 1].

    max_distance   of any part of the caster from the origin, > 0

    A point of the ground is in the shadow of a light direction if it projects into the silhouette seen from there.
    """
    points = camera.unproject(camera.ground_view_z(ground)).reshape(-1, 3)
    across, upward = orthonormal_basis(light_directions())
    views = Views(across, upward, 1.01 * max_distance, _SHADOW_RESOLUTION)
    occluded = np.zeros(len(points), np.float32)
    for index in range(len(views)):
        view = views[index : index + 1]
        mask = caster(view)[0]
        column, row = (np.floor(axis[0]).astype(np.int64) for axis in view.project(points))
        inside = (column >= 0) & (column < _SHADOW_RESOLUTION) & (row >= 0) & (row < _SHADOW_RESOLUTION)
        occluded[inside] += mask[row[inside], column[inside]]
    fraction = (occluded / len(views)).reshape(camera.height, camera.width)
    blur = _BLUR * camera.pixels_per_unit
    blurred: Float32Array = gaussian_filter(fraction, (blur * camera.axes[2, 1], blur), mode="nearest")
    return blurred


def _to_y_up(vectors: NDArray[np.floating], up: Up) -> Float64Array:
    """Rotate vectors, (..., 3), so that y points up."""
    rotated = vectors if up == "y" else np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)
    return rotated.astype(np.float64)


def _points_to_frame(positions: Float64Array, sets: list[Spheres], ground: float) -> Float64Array:
    """Return points, (k, 3), that bound the mesh, the spheres above the ground, and their shadows."""
    corners = [positions]
    for centers, radii in sets:
        for signs in np.ndindex(2, 2, 2):
            corners.append(centers + radii[:, None] * (2 * np.array(signs) - 1))
    points = np.concatenate(corners)
    points[:, 1] = np.maximum(points[:, 1], ground)
    height = points[:, 1:2] - ground
    outer_directions = light_directions()[-32:-16]  # outside these there is hardly any shadow
    return np.concatenate([points, *(points - light * (height / light[1]) for light in outer_directions)])


def _shaded_picture(
    surface: GBuffer, shadow: Float32Array, ground: float, camera: Camera, color: Float64Array
) -> Picture:
    """Composite a supersampled surface over the ground with its shadow, (height, width), and average to that size."""
    fine = camera.supersampled(_SUPERSAMPLING)
    paper = _PAPER * (1 - _SHADOW_ABSORPTION * shadow[..., None].astype(np.float64))
    paper = paper.repeat(_SUPERSAMPLING, axis=0).repeat(_SUPERSAMPLING, axis=1)
    above_ground = surface.mask & (surface.view_z >= fine.ground_view_z(ground) - _GROUND_TOLERANCE / fine.axes[2, 1])
    colors = np.where(above_ground[..., None], color * shade(surface.normals)[..., None], paper)
    linear = colors.reshape(camera.height, _SUPERSAMPLING, camera.width, _SUPERSAMPLING, 3).mean(axis=(1, 3))
    srgb = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    picture: Picture = np.clip(255 * srgb + 0.5, 0, 255).astype(np.uint8)
    return picture
