"""A broad light from above: how it falls on surfaces, and the soft shadow that it casts on the ground; y points up."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from aoprecalc.mesh.normals import shading_normals
from aoprecalc.render.rasterizer import Camera, GBuffer, rasterize_mesh, rasterize_spheres
from aoprecalc.spheres.sampling import NormalizedFrame
from aoprecalc.spheres.silhouettes import Views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, orthonormal_basis

LIGHT_DIRECTION = np.array([-0.44, 1.0, 0.06]) / np.linalg.norm([-0.44, 1.0, 0.06])  # towards the middle of the light
_DIRECTIONS, _WIDEST = 64, np.radians(20)  # of the light, and how far they are from its middle
_EVENNESS = 0.6  # 0.5 would spread them evenly over a disc; more draws them together, so that the shadow fades out
_SIZE = 400  # pixels a side of the silhouettes that are cast
_BLUR = 0.016  # units: hides that the light has so many parts and no more
_KEY, _SKY, _BOUNCE = 0.78, 0.36, 0.16  # strength of the light, of the sky, and of what the ground gives back

Silhouettes = Callable[[Views], BoolArray]


def light_directions() -> Float64Array:
    """Return unit vectors towards all parts of the light, (64, 3)."""
    index = np.arange(_DIRECTIONS)
    aside = _WIDEST * ((index + 0.5) / _DIRECTIONS) ** _EVENNESS
    angle = 2 * np.pi * (index * INV_GOLDEN_RATIO % 1.0)
    across, upward = (side[0] for side in orthonormal_basis(LIGHT_DIRECTION[None]))
    around = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * upward
    found: Float64Array = np.sin(aside)[:, None] * around + np.cos(aside)[:, None] * LIGHT_DIRECTION
    return found


def outer() -> Float64Array:
    """Return unit vectors towards the outer parts of the light, all around, (16, 3): beyond hardly any shadow falls."""
    return light_directions()[-32:-16]


def shade(normals: Float64Array) -> Float64Array:
    """Return how bright a white surface with unit normals, (..., 3), is: (...,), about 0.1 to 1, linear."""
    upward = normals[..., 1]
    facing = normals @ LIGHT_DIRECTION
    softened = np.sin(_WIDEST)  # the light's edge still reaches a surface that has turned away from its middle
    key = np.where(facing > softened, facing, np.maximum(facing + softened, 0) ** 2 / (4 * softened))
    bright: Float64Array = _KEY * key + _SKY * (0.5 + 0.5 * upward) + _BOUNCE * (0.5 - 0.5 * upward)
    return bright


def mesh_caster(positions: Float64Array, faces: Int32Array) -> Silhouettes:
    """Return what draws the silhouettes of (f, 3) faces over (v, 3) positions."""
    return lambda seen: mesh_silhouettes(positions, faces, seen)


def sphere_caster(centers: Float64Array, radii: Float64Array) -> Silhouettes:
    """Return what draws the silhouettes of spheres, (n, 3) and (n,)."""
    return lambda seen: spheres_per_pixel(centers, radii, seen) > 0


def ground_shadow(caster: Silhouettes, reach: float, level: float, camera: Camera) -> Float32Array:
    """Return the share of the light that is kept from the plane y = `level` at each pixel, (height, width) in [0, 1].

    reach   > 0: nothing that casts shadows is farther from the origin

    A place of the ground has no light from a direction if it lies in the silhouette that is seen from there.
    """
    ground = camera.unproject(camera.ground_view_z(level)).reshape(-1, 3)
    across, upward = orthonormal_basis(light_directions())
    seen = Views(across, upward, 1.01 * reach, _SIZE)
    kept = np.zeros(len(ground), np.float32)
    for number in range(len(seen)):
        view = seen[number : number + 1]
        mask = caster(view)[0]
        column, row = (np.floor(side[0]).astype(np.int64) for side in view.project(ground))
        inside = (column >= 0) & (column < _SIZE) & (row >= 0) & (row < _SIZE)
        kept[inside] += mask[row[inside], column[inside]]
    share = (kept / len(seen)).reshape(camera.height, camera.width)
    blur = _BLUR * camera.scale
    blurred: Float32Array = gaussian_filter(share, (blur * camera.axes[2, 1], blur), mode="nearest")
    return blurred


# Side by side: a mesh with its shadow, and spheres with theirs, seen by the same camera in the same light.

Picture = NDArray[np.uint8]
Spheres = tuple[Float64Array, Float64Array]
Up = Literal["y", "z"]

_FINER = 3  # pixels are drawn as squares of as many a side, and averaged
_PAPER = np.array([0.93, 0.93, 0.915])  # linear, as all colours here
_STONE, _BLUE = np.array([0.66, 0.59, 0.50]), np.array([0.42, 0.54, 0.66])
_DARKEST = np.array([0.80, 0.77, 0.71])  # share of the paper's colours that the deepest shadow takes away
_SUNK = 1e-6  # in the frame: what is as far below the ground is still seen


def preview_image(
    scene: Scene, centers: Float64Array, radii: Float64Array, size: tuple[int, int] = (1200, 480), up: Up = "y"
) -> Picture:
    """Draw a mesh, on the left, and spheres, (n, 3) and (n,) in its coordinates, on the right.

    size   width and height in pixels, at least 2 x 1
    up     the mesh's upward axis, y or z
    Returns (height, width, 3) uint8, sRGB, the first row on top. The same input gives the same picture.
    """
    width, height = size
    left = width // 2
    panels = preview_panels(scene, [(centers, radii)], (width - left, height), up)
    return np.concatenate([panels[0][:, :left], panels[1]], axis=1)


def preview_panels(
    scene: Scene, sets: list[Spheres], size: tuple[int, int] = (600, 480), up: Up = "y"
) -> list[Picture]:
    """Draw a mesh, then each of several sets of spheres, all seen alike; arguments as of `spheres_picture`.

    Returns 1 + len(sets) pictures, (height, width, 3) uint8 each, of width and height `size`.
    """
    frame = NormalizedFrame.from_positions(scene.positions)
    positions = _y_up(frame.to_normalized(scene.positions), up)
    placed = [(_y_up(frame.to_normalized(centers), up), radii / frame.scale) for centers, radii in sets]
    level = float(positions[:, 1].min())
    camera = Camera.framing(_framed(positions, placed, level), *size)

    normals = _y_up(shading_normals(scene), up)
    seen = rasterize_mesh(positions[scene.faces], normals, camera.supersampled(_FINER))
    reach = float(np.linalg.norm(positions, axis=1).max())
    shadow = ground_shadow(mesh_caster(positions, scene.faces), reach, level, camera)
    panels = [_painted(seen, shadow, level, camera, _STONE)]
    for centers, radii in placed:
        seen = rasterize_spheres(centers, radii, camera.supersampled(_FINER))
        reach = float((np.linalg.norm(centers, axis=1) + radii).max()) or 1.0
        shadow = ground_shadow(sphere_caster(centers, radii), reach, level, camera)
        panels.append(_painted(seen, shadow, level, camera, _BLUE))
    return panels


def _y_up(vectors: NDArray[np.floating], up: Up) -> Float64Array:
    """Turn vectors, (..., 3), so that y points up."""
    turned = vectors if up == "y" else np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)
    return turned.astype(np.float64)


def _framed(positions: Float64Array, sets: list[Spheres], level: float) -> Float64Array:
    """Points, (k, 3), around which all is seen: the mesh, the spheres' boxes above the ground, and their shadows."""
    corners = [positions]
    for centers, radii in sets:
        for signs in np.ndindex(2, 2, 2):
            corners.append(centers + radii[:, None] * (2 * np.array(signs) - 1))
    points = np.concatenate(corners)
    points[:, 1] = np.maximum(points[:, 1], level)
    height = points[:, 1:2] - level
    return np.concatenate([points, *(points - light * (height / light[1]) for light in outer())])


def _painted(seen: GBuffer, shadow: Float32Array, level: float, camera: Camera, color: Float64Array) -> Picture:
    """Colour what is seen, finer than the shadow of the ground, (height, width), and average it to the same size."""
    finer = camera.supersampled(_FINER)
    paper = _PAPER * (1 - _DARKEST * shadow[..., None].astype(np.float64))
    paper = paper.repeat(_FINER, axis=0).repeat(_FINER, axis=1)
    above = seen.mask & (seen.view_z >= finer.ground_view_z(level) - _SUNK / finer.axes[2, 1])
    fine = np.where(above[..., None], color * shade(seen.normals)[..., None], paper)
    linear = fine.reshape(camera.height, _FINER, camera.width, _FINER, 3).mean(axis=(1, 3))
    encoded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    picture: Picture = np.clip(255 * encoded + 0.5, 0, 255).astype(np.uint8)
    return picture
