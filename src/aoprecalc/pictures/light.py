"""A broad light from above: how it falls on surfaces, and the soft shadow that it casts on the ground; y points up."""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter

from aoprecalc.model import Doubles, Floats, Ints, Mask
from aoprecalc.pictures.camera import Camera
from aoprecalc.spheres.likeness.silhouettes import Views, mesh_silhouettes, sphere_counts
from aoprecalc.surface.directions import GOLDEN
from aoprecalc.surface.frames import perpendiculars

LIGHT = np.array([-0.44, 1.0, 0.06]) / np.linalg.norm([-0.44, 1.0, 0.06])  # towards the middle of the light
_DIRECTIONS, _WIDEST = 64, np.radians(20)  # of the light, and how far they are from its middle
_EVENNESS = 0.6  # 0.5 would spread them evenly over a disc; more draws them together, so that the shadow fades out
_SIZE = 400  # pixels a side of the silhouettes that are cast
_BLUR = 0.016  # units: hides that the light has so many parts and no more
_KEY, _SKY, _BOUNCE = 0.78, 0.36, 0.16  # strength of the light, of the sky, and of what the ground gives back

Silhouettes = Callable[[Views], Mask]


def directions() -> Doubles:
    """Return unit vectors towards all parts of the light, (64, 3)."""
    index = np.arange(_DIRECTIONS)
    aside = _WIDEST * ((index + 0.5) / _DIRECTIONS) ** _EVENNESS
    angle = 2 * np.pi * (index * GOLDEN % 1.0)
    across, upward = (side[0] for side in perpendiculars(LIGHT[None]))
    around = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * upward
    found: Doubles = np.sin(aside)[:, None] * around + np.cos(aside)[:, None] * LIGHT
    return found


def outer() -> Doubles:
    """Return unit vectors towards the outer parts of the light, all around, (16, 3): beyond hardly any shadow falls."""
    return directions()[-32:-16]


def shaded(normals: Doubles) -> Doubles:
    """Return how bright a white surface with unit normals, (..., 3), is: (...,), about 0.1 to 1, linear."""
    upward = normals[..., 1]
    facing = normals @ LIGHT
    softened = np.sin(_WIDEST)  # the light's edge still reaches a surface that has turned away from its middle
    key = np.where(facing > softened, facing, np.maximum(facing + softened, 0) ** 2 / (4 * softened))
    bright: Doubles = _KEY * key + _SKY * (0.5 + 0.5 * upward) + _BOUNCE * (0.5 - 0.5 * upward)
    return bright


def mesh_caster(positions: Doubles, faces: Ints) -> Silhouettes:
    """Return what draws the silhouettes of (f, 3) faces over (v, 3) positions."""
    return lambda seen: mesh_silhouettes(positions, faces, seen)


def sphere_caster(centers: Doubles, radii: Doubles) -> Silhouettes:
    """Return what draws the silhouettes of spheres, (n, 3) and (n,)."""
    return lambda seen: sphere_counts(centers, radii, seen) > 0


def ground_shadow(caster: Silhouettes, reach: float, level: float, camera: Camera) -> Floats:
    """Return the share of the light that is kept from the plane y = `level` at each pixel, (height, width) in [0, 1].

    reach   > 0: nothing that casts shadows is farther from the origin

    A place of the ground has no light from a direction if it lies in the silhouette that is seen from there.
    """
    ground = camera.points(camera.ground(level)).reshape(-1, 3)
    across, upward = perpendiculars(directions())
    seen = Views(across, upward, 1.01 * reach, _SIZE)
    kept = np.zeros(len(ground), np.float32)
    for number in range(len(seen)):
        view = seen[number : number + 1]
        mask = caster(view)[0]
        column, row = (np.floor(side[0]).astype(np.int64) for side in view.places(ground))
        inside = (column >= 0) & (column < _SIZE) & (row >= 0) & (row < _SIZE)
        kept[inside] += mask[row[inside], column[inside]]
    share = (kept / len(seen)).reshape(camera.height, camera.width)
    blur = _BLUR * camera.scale
    blurred: Floats = gaussian_filter(share, (blur * camera.axes[2, 1], blur), mode="nearest")
    return blurred
