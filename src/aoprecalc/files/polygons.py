"""From the polygons, strips and fans of a file to triangles."""

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]
Points = NDArray[np.float64]

# A concave polygon of more corners than this is cut as a fan: cutting ears takes quadratic time.
LARGEST_EAR_CUT = 1000


def polygon_triangles(counts: Indices, vertices: Indices, positions: Points) -> tuple[Indices, Indices]:
    """Cut polygons into triangles that keep their winding, their order and their corners.

    counts     (p,) corners of each polygon; those of less than 3 give nothing
    vertices   (sum of counts,) into positions
    positions  (n, 3); decides how concave polygons are cut

    Returns (corners, polygons): (t, 3) into `vertices`, and (t,) which polygon each triangle is from, ascending.
    """
    starts = np.cumsum(counts) - counts
    cut: list[Indices] = []
    owners: list[Indices] = []
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


def strip_triangles(strips: Indices) -> Indices:
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


def fan_triangles(fan: Indices) -> Indices:
    """Return the (t, 3) triangles of one fan of (n,) vertices around its first."""
    return np.column_stack([np.broadcast_to(fan[:1], max(len(fan) - 2, 0)), fan[1:-1], fan[2:]])


def _cut_alike(around: Indices, points: Points) -> Indices:
    """Cut (m, n) polygons with (m, n, 3) points into (m, n - 2, 3) triangles."""
    size = around.shape[1]
    fan = fan_triangles(np.arange(size))
    triangles = np.asarray(around[:, fan])
    if size == 3:
        return triangles

    spokes = points - points[:, :1]
    normals = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    folded = _least_area(points, fan, normals) < 0
    if size == 4:
        other = (fan + 1) % 4  # the other diagonal
        better = folded & (_least_area(points, other, normals) >= 0)
        triangles[better] = around[better][:, other]
    elif size <= LARGEST_EAR_CUT:
        for polygon in np.flatnonzero(folded):
            triangles[polygon] = around[polygon][_cut_ears(points[polygon], normals[polygon])]
    return triangles


def _least_area(points: Points, triangles: Indices, normals: Points) -> Points:
    """Return the (m,) least signed area of the triangles of each polygon: negative where one is folded over."""
    a, b, c = (points[:, triangles[:, corner]] for corner in range(3))
    areas = np.einsum("mtk,mk->mt", np.cross(b - a, c - a), normals)
    slack = 1e-9 * np.einsum("mk,mk->m", normals, normals)
    return np.asarray(areas.min(axis=1) + slack)


def _cut_ears(points: Points, normal: Points) -> Indices:
    """Cut one polygon of (n, 3) points into (n - 2, 3) triangles, one ear after another; a fan of what has no ear."""
    keep = np.argsort(np.abs(normal))[:2]  # look along the axis that the polygon faces most
    flat = points[:, np.sort(keep)]
    turn = np.sign(_cross(flat, np.roll(flat, -1, axis=0)).sum())
    left = list(range(len(points)))
    ears = []
    while len(left) > 3:
        ear = next((at for at in range(len(left)) if _is_ear(flat, left, at, turn)), None)
        if ear is None:
            break
        ears.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.concatenate([np.array(ears, dtype=np.int64).reshape(-1, 3), fan_triangles(np.array(left))])


def _is_ear(flat: Points, left: list[int], at: int, turn: float) -> bool:
    """Tell whether the corner `at` sticks out and no other corner lies in its triangle."""
    a, b, c = flat[left[at - 1]], flat[left[at]], flat[left[(at + 1) % len(left)]]
    if turn * _cross(b - a, c - a) <= 0:
        return False
    others = flat[left]
    inside = np.ones(len(left), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= turn * _cross(end - start, others - start) >= 0
    is_corner = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    return not np.any(inside & ~is_corner)


def _cross(a: Points, b: Points) -> Points:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
