"""The orthographic projection of every axis: a square depth map, fitted tightly around the occluders."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from aoprecalc.mesh.normals import area_vectors
from aoprecalc.mesh.surface import active_positions
from aoprecalc.types import Atlas, Float64Array, Scene
from aoprecalc.visibility.directions import light_axes, orthonormal_basis

MIN_SHADOW_SIZE, MAX_SHADOW_SIZE = 512, 2048
_SIZE_STEP = 128
_FINENESS = 1.25  # map texels across a surface texel: one would do for a distant occluder, not for one in contact
_FINE_DIRECTIONS = 1000  # with as many directions maps of that fineness pay off
_SIZING_AXES = 128  # over which the extent of maps is averaged

_ROTATIONS = 16  # about the axis that are tried for the smallest rectangle
_MARGIN = 1.0  # empty map texels around the occluders, so that no rounding draws into a neighbour's tile


@dataclass(frozen=True, eq=False)
class Projections:
    """Projections of points along each of `a` axes.

    rows     (a, 3, 4) float64: rows @ (x, y, z, 1) gives map x and y in map texels, in [0, size], and the depth
             along the axis, greater towards the axis' positive end, in the points' units
    pitch    (a, 2) float64: the sides of a map texel, in the points' units
    below    (a,) float64: 1 or -1 where the positive or the negative end of the axis points below the ground, else 0
    """

    rows: Float64Array
    pitch: Float64Array
    below: Float64Array

    def select(self, chosen: slice) -> "Projections":
        """Return those of a slice of the axes."""
        return Projections(self.rows[chosen], self.pitch[chosen], self.below[chosen])


def convex_hull_points(positions: Float64Array) -> Float64Array:
    """Return the corners of the convex hull of (v, 3) positions, in their plane if flat; of a line its two ends."""
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
    axes: Float64Array, hull: Float64Array, size: int, ground_normal: tuple[float, float, float] | None = None
) -> Projections:
    """Fit a map of `size` x `size` texels to the points `hull`, (h, 3), along each of `axes`, (a, 3).

    ground_normal   the unit vector away from the ground plane, if there is one
    """
    across, upward = orthonormal_basis(axes)
    longest = np.linalg.svd(hull - hull.mean(axis=0), full_matrices=False)[2][0]
    # Align the map with the longest extent, so that thin objects get a thin map.
    along_longest = np.arctan2(upward @ longest, across @ longest)
    angles = [np.full(len(axes), angle) for angle in np.arange(_ROTATIONS) * (np.pi / 2 / _ROTATIONS)]
    min_area = np.full(len(axes), np.inf)
    rows = np.zeros((len(axes), 3, 4))
    pitch = np.ones((len(axes), 2))
    for angle in [along_longest, *angles]:
        cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
        sides = np.stack([cosine * across + sine * upward, cosine * upward - sine * across], axis=1)
        projected = sides @ hull.T
        low, high = projected.min(axis=2), projected.max(axis=2)
        # A flat object seen edge-on has no width; a map texel is never taller than a thousand times its width.
        extent = np.maximum(high - low, 1e-3 * (high - low).max(axis=1, keepdims=True))
        area = extent.prod(axis=1)
        better = area < min_area
        step = extent / (size - 2 * _MARGIN)
        middle = (low + high) / 2
        min_area[better] = area[better]
        pitch[better] = step[better]
        rows[better, :2, :3] = (sides / step[:, :, None])[better]
        rows[better, :2, 3] = (size / 2 - middle / step)[better]
    rows[:, 2, :3] = axes
    below = np.zeros(len(axes)) if ground_normal is None else -np.sign(axes @ ground_normal)
    return Projections(rows, pitch, below)


def auto_shadow_size(scene: Scene, atlas: Atlas, texels: int, directions: int) -> int:
    """Return the side of a depth map, 512 to 2048, that suits `texels` covered texels and a number of directions.

    With 1000 directions or more, map texels are somewhat finer than surface texels; with fewer they are coarser. The
    error that maps add is in proportion to their texels, the error that directions leave to N^-3/4; half of that
    exponent keeps the first below the second (measured on two meshes).

    The size of a map texel is that of its longer side, in the mean over all axes.
    """
    area = 0.5 * np.linalg.norm(area_vectors(scene.corners[atlas.mapped]), axis=1).sum()
    if not texels or not area:
        return MIN_SHADOW_SIZE
    axes, hull = light_axes(2 * _SIZING_AXES), convex_hull_points(active_positions(scene))
    pitch = fit_projections(axes, hull, MAX_SHADOW_SIZE).pitch
    side = float(pitch.max(axis=1).mean()) * MAX_SHADOW_SIZE
    fineness = _FINENESS * min(1.0, (directions / _FINE_DIRECTIONS) ** 0.375)
    size = fineness * side / math.sqrt(area / texels)
    return int(min(MAX_SHADOW_SIZE, max(MIN_SHADOW_SIZE, math.ceil(size / _SIZE_STEP) * _SIZE_STEP)))
