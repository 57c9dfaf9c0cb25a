"""Triangulate polygons, strips and fans, and merge triangles back into their polygons."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray, Int64Array

Points = NDArray[np.float64]

# Ear clipping takes quadratic time: a polygon with more corners than this becomes a fan, whatever its shape.
_MAX_EAR_CLIPPING = 1000
_FLAT_RATIO = 1e-9  # triangles up to this fraction of their polygon's area count as degenerate
_EQUAL_WITHIN = 1e-6  # normals and UVs that differ by no more are the same but for rounding


@dataclass(frozen=True, eq=False)
class OutputFaces:
    """Faces to write: polygons and, where a polygon cannot stay whole, its triangles.

    counts   (m,) corners of each face
    corners  (sum of counts,) a triangle corner with the values of each face corner: 3 t + c for corner c of triangle t
    owners   (m,) the polygon that each face is or belongs to, ascending
    """

    counts: Int64Array
    corners: Int64Array
    owners: Int64Array


@dataclass(frozen=True, eq=False)
class Polygons:
    """The polygons of a file and their triangles.

    counts     (p,) corners of each polygon
    triangles  (t, 3) indices into the concatenated corners of all polygons
    owners     (t,) the polygon of each triangle, ascending
    """

    counts: Int64Array
    triangles: Int64Array
    owners: Int64Array

    @classmethod
    def of_triangles(cls, number: int) -> Self:
        """Return polygons that are triangles, `number` of them."""
        return cls(np.full(number, 3), np.arange(3 * number).reshape(-1, 3), np.arange(number))

    def concatenate(self, other: Self) -> Self:
        """Return these polygons followed by the others."""
        return type(self)(
            np.concatenate([self.counts, other.counts]),
            np.concatenate([self.triangles, other.triangles + self.counts.sum()]),
            np.concatenate([self.owners, other.owners + len(self.counts)]),
        )

    def merge_triangles(self, values: Sequence[NDArray[Any]], decisive: BoolArray) -> OutputFaces:
        """Return each polygon whole if its triangles have equal values at the corners they share, else its triangles.

        values    each (t, 3, c): values at the corners of the triangles
        decisive  (t,) triangles whose values count; a polygon with a corner at which none counts is not whole
        """
        all_corners = np.arange(self.triangles.size)
        if np.all(self.counts == 3):
            return OutputFaces(self.counts, all_corners, self.owners)
        corners, counted = self.triangles.reshape(-1), np.repeat(decisive, 3)
        representative = np.full(self.counts.sum(), -1)  # polygon corner -> a triangle corner there
        representative[corners[counted]] = all_corners[counted]
        whole = self.counts >= 3
        whole[np.repeat(np.arange(len(self.counts)), self.counts)[representative < 0]] = False
        for array in values:
            rows = array.reshape(len(all_corners), -1)
            differs = (np.abs(rows - rows[representative[corners]]) > _EQUAL_WITHIN).any(axis=1)
            whole[self.owners[all_corners[differs & counted] // 3]] = False

        split = ~whole[self.owners]
        counts = np.concatenate([self.counts[whole], np.full(np.count_nonzero(split), 3)])
        face_corners = np.concatenate([representative[np.repeat(whole, self.counts)], all_corners[np.repeat(split, 3)]])
        owners = np.concatenate([np.flatnonzero(whole), self.owners[split]])
        order = np.argsort(owners, kind="stable")
        return OutputFaces(counts[order], face_corners[_reorder_runs(counts, order)], owners[order])


def _reorder_runs(counts: Int64Array, order: Int64Array) -> Int64Array:
    """Return indices, (sum,), that put concatenated runs of `counts` elements into another order."""
    starts, taken = np.cumsum(counts) - counts, counts[order]
    offsets: Int64Array = np.repeat(starts[order] - (np.cumsum(taken) - taken), taken)
    return np.arange(len(offsets)) + offsets


def polygon_triangles(counts: Int64Array, vertices: Int64Array, positions: Points) -> tuple[Int64Array, Int64Array]:
    """Triangulate polygons; winding, order and corners are kept.

    counts     (p,) corners of each polygon; polygons with fewer than 3 give no triangle
    vertices   (sum of counts,) indices into positions
    positions  (n, 3); they decide how concave polygons are triangulated

    Returns (corners, polygons): (t, 3) indices into `vertices`, and (t,) the polygon of each triangle, ascending.
    """
    starts = np.cumsum(counts) - counts
    triangles: list[Int64Array] = []
    owners: list[Int64Array] = []
    for size in np.unique(counts[counts >= 3]):
        chosen = np.flatnonzero(counts == size)
        loops = starts[chosen][:, None] + np.arange(size)
        triangles.append(_triangulate(loops, positions[vertices[loops]]).reshape(-1, 3))
        owners.append(np.repeat(chosen, size - 2))
    if not triangles:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def strip_triangles(strips: Int64Array) -> Int64Array:
    """Return the (t, 3) triangles of concatenated strips of vertices, (n,) with -1 between strips.

    Degenerate triangles, which repeat a vertex to continue a strip elsewhere, are left out.
    """
    if len(strips) < 3:
        return np.empty((0, 3), dtype=np.int64)
    triangles = np.lib.stride_tricks.sliding_window_view(strips, 3).astype(np.int64)
    index = np.arange(len(strips))
    starts = np.maximum.accumulate(np.where(strips == -1, index + 1, 0))
    odd = ((index - starts) % 2 == 1)[:-2]
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    kept = (triangles != -1).all(axis=1) & (a != b) & (b != c) & (c != a)
    return np.asarray(triangles[kept])


def fan_triangles(fan: Int64Array) -> Int64Array:
    """Return the (t, 3) triangles of one fan of (n,) vertices around the first of them."""
    return np.column_stack([np.broadcast_to(fan[:1], max(len(fan) - 2, 0)), fan[1:-1], fan[2:]])


def _triangulate(loops: Int64Array, points: Points) -> Int64Array:
    """Triangulate (m, n) polygons of n corners each, at the (m, n, 3) points, into (m, n - 2, 3) triangles."""
    size = loops.shape[1]
    fan = fan_triangles(np.arange(size))
    triangles = np.asarray(loops[:, fan])
    if size == 3:
        return triangles

    edges = points - points[:, :1]
    normals = np.cross(edges, np.roll(edges, -1, axis=1)).sum(axis=1)
    # If the fan around the first corner has a degenerate or inverted triangle, try the other corners, then clip ears.
    unsolved = np.flatnonzero((_min_area_ratio(points, fan, normals) <= _FLAT_RATIO) & normals.any(axis=1))
    if size > _MAX_EAR_CLIPPING:
        return triangles
    for first in range(1, size if len(unsolved) else 1):
        rotated = (fan + first) % size
        fits = _min_area_ratio(points[unsolved], rotated, normals[unsolved]) > _FLAT_RATIO
        triangles[unsolved[fits]] = loops[unsolved[fits]][:, rotated]
        unsolved = unsolved[~fits]
    for polygon in unsolved if size > 4 else ():
        triangles[polygon] = loops[polygon][_clip_ears(points[polygon], normals[polygon])]
    return triangles


def _min_area_ratio(points: Points, triangles: Int64Array, normals: Points) -> Points:
    """Return the (m,) smallest ratio of a triangle's signed area to its polygon's; negative if one is inverted."""
    a, b, c = (points[:, triangles[:, corner]] for corner in range(3))
    areas = np.einsum("mtk,mk->mt", np.cross(b - a, c - a), normals)
    whole = np.einsum("mk,mk->m", normals, normals)
    return np.asarray(areas.min(axis=1) / np.where(whole > 0, whole, 1))


def _clip_ears(points: Points, normal: Points) -> Int64Array:
    """Triangulate one polygon of (n, 3) points by ear clipping; a fan of what has no ear left."""
    plane = np.sort(np.argsort(np.abs(normal))[:2])  # project along the largest component of the normal
    flat = points[:, plane]
    edges = flat - flat[0]
    area = _cross(edges, np.roll(edges, -1, axis=0)).sum()
    left = list(range(len(points)))
    ears = []
    while len(left) > 3:
        ear = next((index for index in range(len(left)) if _is_ear(flat, left, index, area)), None)
        if ear is None:
            break
        ears.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.concatenate([np.array(ears, dtype=np.int64).reshape(-1, 3), fan_triangles(np.array(left))])


def _is_ear(flat: Points, left: list[int], index: int, area: float) -> bool:
    """Tell whether the corner left[index] is convex and no other corner lies in its triangle.

    area   signed, of the polygon
    """
    a, b, c = flat[left[index - 1]], flat[left[index]], flat[left[(index + 1) % len(left)]]
    sign = np.sign(area)
    if sign * _cross(b - a, c - a) <= _FLAT_RATIO * abs(area):
        return False
    others = flat[left]
    inside = np.ones(len(left), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= sign * _cross(end - start, others - start) >= 0
    is_corner = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    return not np.any(inside & ~is_corner)


def _cross(a: Points, b: Points) -> Points:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
