"""From the polygons, strips and fans of a file to triangles, and from triangles back to their polygons."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray, Int64Array

Points = NDArray[np.float64]

# A polygon that is no simple fan and has more corners than this is cut as one: cutting ears takes quadratic time.
LARGEST_EAR_CUT = 1000
_FLAT = 1e-9  # the share of its polygon's area up to which a triangle counts as without area
_SAME = 1e-6  # by which rounding may part normals, and UVs, that are meant to be one


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces to write.

    counts   (m,) corners of each
    corners  (sum of counts,) a corner of a triangle that has the values of each: 3 t + c for corner c of triangle t
    owners   (m,) the polygon each is, or is part of; ascending
    """

    counts: Int64Array
    corners: Int64Array
    owners: Int64Array


@dataclass(frozen=True, eq=False)
class Polygons:
    """The polygons of a file that were cut into triangles.

    counts     (p,) corners of each
    triangles  (t, 3) into the corners of all polygons, end to end
    owners     (t,) which polygon each triangle is from, ascending
    """

    counts: Int64Array
    triangles: Int64Array
    owners: Int64Array

    @classmethod
    def of_triangles(cls, number: int) -> Self:
        """Return as many triangles that were polygons themselves."""
        return cls(np.full(number, 3), np.arange(3 * number).reshape(-1, 3), np.arange(number))

    def followed_by(self, other: Self) -> Self:
        """Return these and then the others."""
        return type(self)(
            np.concatenate([self.counts, other.counts]),
            np.concatenate([self.triangles, other.triangles + self.counts.sum()]),
            np.concatenate([self.owners, other.owners + len(self.counts)]),
        )

    def rejoin(self, values: Sequence[NDArray[Any]], decides: BoolArray) -> Faces:
        """Return each polygon whole where its triangles agree at the corners that they share, else its triangles.

        values   each (t, 3, c): what the corners of the triangles have
        decides  (t,) the triangles whose values count; a polygon with a corner at which none counts is not whole
        """
        every = np.arange(self.triangles.size)
        if np.all(self.counts == 3):
            return Faces(self.counts, every, self.owners)
        corners, counts_here = self.triangles.reshape(-1), np.repeat(decides, 3)
        deputy = np.full(self.counts.sum(), -1)  # of each corner of a polygon: a triangle's corner there
        deputy[corners[counts_here]] = every[counts_here]
        whole = self.counts >= 3
        whole[np.repeat(np.arange(len(self.counts)), self.counts)[deputy < 0]] = False
        for array in values:
            rows = array.reshape(len(every), -1)
            differs = (np.abs(rows - rows[deputy[corners]]) > _SAME).any(axis=1)
            whole[self.owners[every[differs & counts_here] // 3]] = False

        cut = ~whole[self.owners]
        counts = np.concatenate([self.counts[whole], np.full(np.count_nonzero(cut), 3)])
        stand_ins = np.concatenate([deputy[np.repeat(whole, self.counts)], every[np.repeat(cut, 3)]])
        owners = np.concatenate([np.flatnonzero(whole), self.owners[cut]])
        order = np.argsort(owners, kind="stable")
        return Faces(counts[order], stand_ins[_ragged(counts, order)], owners[order])


def _ragged(counts: Int64Array, order: Int64Array) -> Int64Array:
    """Return where the corners of faces that lie end to end are, (sum,), the faces taken in another order."""
    starts, taken = np.cumsum(counts) - counts, counts[order]
    moves: Int64Array = np.repeat(starts[order] - (np.cumsum(taken) - taken), taken)
    return np.arange(len(moves)) + moves


def polygon_triangles(counts: Int64Array, vertices: Int64Array, positions: Points) -> tuple[Int64Array, Int64Array]:
    """Cut polygons into triangles that keep their winding, their order and their corners.

    counts     (p,) corners of each polygon; those of less than 3 give nothing
    vertices   (sum of counts,) into positions
    positions  (n, 3); decides how concave polygons are cut

    Returns (corners, polygons): (t, 3) into `vertices`, and (t,) which polygon each triangle is from, ascending.
    """
    starts = np.cumsum(counts) - counts
    cut: list[Int64Array] = []
    owners: list[Int64Array] = []
    for size in np.unique(counts[counts >= 3]):
        chosen = np.flatnonzero(counts == size)
        around = starts[chosen][:, None] + np.arange(size)
        cut.append(_cut_alike(around, positions[vertices[around]]).reshape(-1, 3))
        owners.append(np.repeat(chosen, size - 2))
    if not cut:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(cut)[order], owner[order]


def strip_triangles(strips: Int64Array) -> Int64Array:
    """Return the (t, 3) triangles of strips of vertices laid end to end, (n,) with -1 between them.

    Triangles that repeat a vertex are left out: they are there to turn a corner.
    """
    if len(strips) < 3:
        return np.empty((0, 3), dtype=np.int64)
    triangles = np.lib.stride_tricks.sliding_window_view(strips, 3).astype(np.int64)
    places = np.arange(len(strips))
    starts = np.maximum.accumulate(np.where(strips == -1, places + 1, 0))
    odd = ((places - starts) % 2 == 1)[:-2]
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    kept = (triangles != -1).all(axis=1) & (a != b) & (b != c) & (c != a)
    return np.asarray(triangles[kept])


def fan_triangles(fan: Int64Array) -> Int64Array:
    """Return the (t, 3) triangles of one fan of (n,) vertices around its first."""
    return np.column_stack([np.broadcast_to(fan[:1], max(len(fan) - 2, 0)), fan[1:-1], fan[2:]])


def _cut_alike(around: Int64Array, points: Points) -> Int64Array:
    """Cut (m, n) polygons with (m, n, 3) points into (m, n - 2, 3) triangles."""
    size = around.shape[1]
    fan = fan_triangles(np.arange(size))
    triangles = np.asarray(around[:, fan])
    if size == 3:
        return triangles

    spokes = points - points[:, :1]
    normals = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    # Where a corner lies on a straight side or a triangle is folded over, another corner's fan may do, else ears do.
    poor = np.flatnonzero((_least_area(points, fan, normals) <= _FLAT) & normals.any(axis=1))
    if size > LARGEST_EAR_CUT:
        return triangles
    for turn in range(1, size if len(poor) else 1):
        turned = (fan + turn) % size
        fits = _least_area(points[poor], turned, normals[poor]) > _FLAT
        triangles[poor[fits]] = around[poor[fits]][:, turned]
        poor = poor[~fits]
    for polygon in poor if size > 4 else ():
        triangles[polygon] = around[polygon][_cut_ears(points[polygon], normals[polygon])]
    return triangles


def _least_area(points: Points, triangles: Int64Array, normals: Points) -> Points:
    """Return the (m,) least share of their polygon's area that triangles have: negative where one is folded over."""
    a, b, c = (points[:, triangles[:, corner]] for corner in range(3))
    areas = np.einsum("mtk,mk->mt", np.cross(b - a, c - a), normals)
    whole = np.einsum("mk,mk->m", normals, normals)
    return np.asarray(areas.min(axis=1) / np.where(whole > 0, whole, 1))


def _cut_ears(points: Points, normal: Points) -> Int64Array:
    """Cut one polygon of (n, 3) points into (n - 2, 3) triangles, one ear after another; a fan of what has no ear."""
    keep = np.argsort(np.abs(normal))[:2]  # look along the axis that the polygon faces most
    flat = points[:, np.sort(keep)]
    spokes = flat - flat[0]
    area = _cross(spokes, np.roll(spokes, -1, axis=0)).sum()
    left = list(range(len(points)))
    ears = []
    while len(left) > 3:
        ear = next((at for at in range(len(left)) if _is_ear(flat, left, at, area)), None)
        if ear is None:
            break
        ears.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.concatenate([np.array(ears, dtype=np.int64).reshape(-1, 3), fan_triangles(np.array(left))])


def _is_ear(flat: Points, left: list[int], at: int, area: float) -> bool:
    """Tell whether the corner `at` sticks out and no other corner lies in its triangle; `area` is the polygon's."""
    a, b, c = flat[left[at - 1]], flat[left[at]], flat[left[(at + 1) % len(left)]]
    turn = np.sign(area)
    if turn * _cross(b - a, c - a) <= _FLAT * abs(area):
        return False
    others = flat[left]
    inside = np.ones(len(left), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= turn * _cross(end - start, others - start) >= 0
    is_corner = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    return not np.any(inside & ~is_corner)


def _cross(a: Points, b: Points) -> Points:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
