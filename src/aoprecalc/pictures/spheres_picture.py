"""Side by side: a mesh with its shadow, and spheres with theirs, seen by the same camera in the same light."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles, Floats, Scene
from aoprecalc.pictures.camera import Camera
from aoprecalc.pictures.light import ground_shadow, mesh_caster, outer, shaded, sphere_caster
from aoprecalc.pictures.raster import Seen, see_mesh, see_spheres
from aoprecalc.spheres.frame import Frame
from aoprecalc.surface.normals import shading_normals

Picture = NDArray[np.uint8]
Spheres = tuple[Doubles, Doubles]
Up = Literal["y", "z"]

_FINER = 3  # pixels are drawn as squares of as many a side, and averaged
_PAPER = np.array([0.93, 0.93, 0.915])  # linear, as all colours here
_STONE, _BLUE = np.array([0.66, 0.59, 0.50]), np.array([0.42, 0.54, 0.66])
_DARKEST = np.array([0.80, 0.77, 0.71])  # share of the paper's colours that the deepest shadow takes away
_SUNK = 1e-6  # in the frame: what is as far below the ground is still seen


def spheres_picture(
    scene: Scene, centers: Doubles, radii: Doubles, size: tuple[int, int] = (1200, 480), up: Up = "y"
) -> Picture:
    """Draw a mesh, on the left, and spheres, (n, 3) and (n,) in its coordinates, on the right.

    size   width and height in pixels, at least 2 x 1
    up     the mesh's upward axis, y or z
    Returns (height, width, 3) uint8, sRGB, the first row on top. The same input gives the same picture.
    """
    width, height = size
    left = width // 2
    panels = spheres_panels(scene, [(centers, radii)], (width - left, height), up)
    return np.concatenate([panels[0][:, :left], panels[1]], axis=1)


def spheres_panels(
    scene: Scene, sets: list[Spheres], size: tuple[int, int] = (600, 480), up: Up = "y"
) -> list[Picture]:
    """Draw a mesh, then each of several sets of spheres, all seen alike; arguments as of `spheres_picture`.

    Returns 1 + len(sets) pictures, (height, width, 3) uint8 each, of width and height `size`.
    """
    frame = Frame.around(scene.positions)
    positions = _y_up(frame.enter(scene.positions), up)
    placed = [(_y_up(frame.enter(centers), up), radii / frame.scale) for centers, radii in sets]
    level = float(positions[:, 1].min())
    camera = Camera.around(_framed(positions, placed, level), *size)

    normals = _y_up(shading_normals(scene), up)
    seen = see_mesh(positions[scene.faces], normals, camera.finer(_FINER))
    reach = float(np.linalg.norm(positions, axis=1).max())
    shadow = ground_shadow(mesh_caster(positions, scene.faces), reach, level, camera)
    panels = [_painted(seen, shadow, level, camera, _STONE)]
    for centers, radii in placed:
        seen = see_spheres(centers, radii, camera.finer(_FINER))
        reach = float((np.linalg.norm(centers, axis=1) + radii).max()) or 1.0
        shadow = ground_shadow(sphere_caster(centers, radii), reach, level, camera)
        panels.append(_painted(seen, shadow, level, camera, _BLUE))
    return panels


def _y_up(vectors: NDArray[np.floating], up: Up) -> Doubles:
    """Turn vectors, (..., 3), so that y points up."""
    turned = vectors if up == "y" else np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)
    return turned.astype(np.float64)


def _framed(positions: Doubles, sets: list[Spheres], level: float) -> Doubles:
    """Points, (k, 3), around which all is seen: the mesh, the spheres' boxes above the ground, and their shadows."""
    corners = [positions]
    for centers, radii in sets:
        for signs in np.ndindex(2, 2, 2):
            corners.append(centers + radii[:, None] * (2 * np.array(signs) - 1))
    points = np.concatenate(corners)
    points[:, 1] = np.maximum(points[:, 1], level)
    height = points[:, 1:2] - level
    return np.concatenate([points, *(points - light * (height / light[1]) for light in outer())])


def _painted(seen: Seen, shadow: Floats, level: float, camera: Camera, color: Doubles) -> Picture:
    """Colour what is seen, finer than the shadow of the ground, (height, width), and average it to the same size."""
    finer = camera.finer(_FINER)
    paper = _PAPER * (1 - _DARKEST * shadow[..., None].astype(np.float64))
    paper = paper.repeat(_FINER, axis=0).repeat(_FINER, axis=1)
    above = seen.there & (seen.nearness >= finer.ground(level) - _SUNK / finer.axes[2, 1])
    fine = np.where(above[..., None], color * shaded(seen.normals)[..., None], paper)
    linear = fine.reshape(camera.height, _FINER, camera.width, _FINER, 3).mean(axis=(1, 3))
    encoded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    picture: Picture = np.clip(255 * encoded + 0.5, 0, 255).astype(np.uint8)
    return picture
