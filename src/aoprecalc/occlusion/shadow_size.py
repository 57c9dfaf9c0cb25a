"""How large near/far maps have to be."""

import math

import numpy as np

from aoprecalc.model import Atlas, Scene
from aoprecalc.occlusion.axes import axes
from aoprecalc.occlusion.projection import extreme_points, project
from aoprecalc.surface.normals import area_vectors
from aoprecalc.surface.unit import taking_part

LEAST, MOST = 512, 2048
_STEP = 128
_FINER = 1.25  # map texels across a surface texel: one would do for a distant occluder, not for one that touches
_MANY = 1000  # directions that are worth maps of that fineness
_SOME_AXES = 128


def auto_shadow_size(scene: Scene, atlas: Atlas, texels: int, directions: int) -> int:
    """Return the side of a map, 512 to 2048, whose texels are somewhat finer than the `texels` of the surface.

    That is with 1000 directions or more; with fewer they are coarser.

    What maps add to the error is in proportion to their texels, what directions leave to N^-3/4; half of that exponent
    keeps the first below the second (measured on two meshes).

    What counts is the longer side of a map, in the mean over all axes.
    """
    area = 0.5 * np.linalg.norm(area_vectors(scene.corners[atlas.covers]), axis=1).sum()
    if not texels or not area:
        return LEAST
    pitch = project(axes(2 * _SOME_AXES), extreme_points(taking_part(scene)), MOST).pitch
    side = float(pitch.max(axis=1).mean()) * MOST
    enough = min(1.0, (directions / _MANY) ** 0.375)
    wanted = _FINER * enough * side / math.sqrt(area / texels)
    return int(min(MOST, max(LEAST, math.ceil(wanted / _STEP) * _STEP)))
