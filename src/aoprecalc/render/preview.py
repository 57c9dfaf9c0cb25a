"""Previews: a mesh beside sphere sets, each with its soft shadow on the ground, by one camera and one area light.

The light is a set of directions around its centre. y points up.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from aoprecalc.mesh.normals import shading_normals
from aoprecalc.render.rasterizer import Camera, GBuffer, rasterize_mesh, rasterize_spheres
from aoprecalc.spheres.sampling import NormalizedFrame
from aoprecalc.spheres.silhouettes import Views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Picture, Scene
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, orthonormal_basis

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
