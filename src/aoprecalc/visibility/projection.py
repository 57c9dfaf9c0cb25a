"""The orthographic projection of every axis: a square map, fitted tightly around the occluders."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from aoprecalc.mesh.normals import area_vectors
from aoprecalc.mesh.unit_sphere import active_positions
from aoprecalc.types import Atlas, Float64Array, Scene
from aoprecalc.visibility.directions import light_axes, orthonormal_basis

_TURNS = 16  # rotations about the axis that are tried for the tightest rectangle
_MARGIN = 1.0  # empty map texels around the occluders, so that no rounding draws into a neighbour's tile


@dataclass(frozen=True, eq=False)
class Projections:
    """How points are projected along each of `a` axes.

    rows     (a, 3, 4) float64: rows @ (x, y, z, 1) gives map x and y in map texels, in [0, size], and the depth
             along the axis, greater towards the axis' positive end, in the points' units
    pitch    (a, 2) float64: the sides of a map texel, in the points' units
    below    (a,) float64: 1 or -1 where the positive or the negative end of the axis leads down to a floor, 0: neither
    """

    rows: Float64Array
    pitch: Float64Array
    below: Float64Array

    def select(self, chosen: slice) -> "Projections":
        """Return a run of them."""
        return Projections(self.rows[chosen], self.pitch[chosen], self.below[chosen])


def convex_hull_points(positions: Float64Array) -> Float64Array:
    """Return the corners of the convex hull of (v, 3) positions, flat ones in their plane; of a line its two ends."""
    principal = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)[2]
    for dimensions in (3, 2):
        try:
            corners: Float64Array = positions[ConvexHull(positions @ principal[:dimensions].T).vertices]
        except (QhullError, ValueError):  # no volume or no area, or too few points for any
            continue
        return corners
    along = positions @ principal[0]
    return positions[[along.argmin(), along.argmax()]]


def fit_projections(
    axes: Float64Array, outline: Float64Array, size: int, floor: tuple[float, float, float] | None = None
) -> Projections:
    """Fit a map of `size` x `size` texels to the points `outline`, (h, 3), seen along each of `axes`, (a, 3).

    floor   the unit vector away from it, where there is one
    """
    across, upward = orthonormal_basis(axes)
    longest = np.linalg.svd(outline - outline.mean(axis=0), full_matrices=False)[2][0]
    along_longest = np.arctan2(upward @ longest, across @ longest)  # which makes a needle's map as thin as the needle
    turns = [np.full(len(axes), turn) for turn in np.arange(_TURNS) * (np.pi / 2 / _TURNS)]
    best_area = np.full(len(axes), np.inf)
    rows = np.zeros((len(axes), 3, 4))
    pitch = np.ones((len(axes), 2))
    for turn in [along_longest, *turns]:
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        sides = np.stack([cosine * across + sine * upward, cosine * upward - sine * across], axis=1)
        seen = sides @ outline.T
        low, high = seen.min(axis=2), seen.max(axis=2)
        # A flat object seen edge-on has no width; a map texel is never taller than a thousand times its width.
        extent = np.maximum(high - low, 1e-3 * (high - low).max(axis=1, keepdims=True))
        area = extent.prod(axis=1)
        better = area < best_area
        step = extent / (size - 2 * _MARGIN)
        middle = (low + high) / 2
        best_area[better] = area[better]
        pitch[better] = step[better]
        rows[better, :2, :3] = (sides / step[:, :, None])[better]
        rows[better, :2, 3] = (size / 2 - middle / step)[better]
    rows[:, 2, :3] = axes
    below = np.zeros(len(axes)) if floor is None else -np.sign(axes @ floor)
    return Projections(rows, pitch, below)


# How large near/far maps have to be.

MIN_SHADOW_SIZE, MAX_SHADOW_SIZE = 512, 2048
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
    area = 0.5 * np.linalg.norm(area_vectors(scene.corners[atlas.mapped]), axis=1).sum()
    if not texels or not area:
        return MIN_SHADOW_SIZE
    pitch = fit_projections(
        light_axes(2 * _SOME_AXES), convex_hull_points(active_positions(scene)), MAX_SHADOW_SIZE
    ).pitch
    side = float(pitch.max(axis=1).mean()) * MAX_SHADOW_SIZE
    enough = min(1.0, (directions / _MANY) ** 0.375)
    wanted = _FINER * enough * side / math.sqrt(area / texels)
    return int(min(MAX_SHADOW_SIZE, max(MIN_SHADOW_SIZE, math.ceil(wanted / _STEP) * _STEP)))
