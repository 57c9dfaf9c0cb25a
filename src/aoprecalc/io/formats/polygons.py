"""Triangulate polygons, strips and fans, and merge triangles back into their polygons."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, one_or_many
from aoprecalc.progress import Note
from aoprecalc.types import BoolArray, Int64Array

Points = NDArray[np.float64]

_MAX_FAN = 8  # corners: of larger polygons only the fan around the first is tried before their ears are cut
_PLANAR_WITHIN = 1e-7  # of its extent: a polygon that leaves its plane by no more counts as planar
_FLAT_RATIO = 1e-9  # triangles up to this fraction of their polygon's area count as degenerate
_EQUAL_WITHIN = 1e-6  # normals and UVs that differ by no more are the same but for rounding
_AFFINE_WITHIN = 1 / 4096  # half a texel of 2048^2: by how much UVs may move if a polygon is cut in another way


@dataclass(frozen=True, eq=False)
class OutputFaces:
    """Faces to write: polygons and, where a polygon cannot stay whole, its triangles.

    counts   (m,) corners of each face
    corners  (sum of counts,) a triangle corner with the values of each face corner: 3 t + c for corner c of triangle t
    owners   (m,) the polygon that each face is or belongs to, ascending
    recut    polygons that are written as triangles since other programs would cut them in other ways
    """

    counts: Int64Array
    corners: Int64Array
    owners: Int64Array
    recut: int = 0


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

    @classmethod
    def concatenate(cls, runs: "Sequence[Polygons]") -> Self:
        """Return the polygons of all runs, at least one, one after the other."""
        counts = [run.counts for run in runs]
        corners = np.cumsum([0, *(each.sum() for each in counts)])
        polygons = np.cumsum([0, *map(len, counts)])
        return cls(
            np.concatenate(counts),
            np.concatenate([run.triangles + start for run, start in zip(runs, corners[:-1], strict=True)]),
            np.concatenate([run.owners + start for run, start in zip(runs, polygons[:-1], strict=True)]),
        )

    def merge_triangles(
        self, values: Sequence[NDArray[Any]], decisive: BoolArray, mapping: "NewUvs | None" = None
    ) -> OutputFaces:
        """Return each polygon whole if its triangles have equal values at the corners they share, else its triangles.

        values    each (t, 3, c): values at the corners of the triangles
        decisive  (t,) triangles whose values count; a polygon with a corner at which none counts is not whole
        mapping   UVs that the file has not had: such a polygon is whole only if programs that cut it in another way
                  show the same, and begins where a fan, the usual way, is the cut that was baked
        """
        all_corners = np.arange(self.triangles.size)
        if np.all(self.counts == 3):
            return OutputFaces(self.counts, all_corners, self.owners)
        corners, counts_in = self.triangles.reshape(-1), np.repeat(decisive, 3)
        representative = np.full(self.counts.sum(), -1)  # polygon corner -> a triangle corner there
        representative[corners[counts_in]] = all_corners[counts_in]
        whole = self.counts >= 3
        whole[np.repeat(np.arange(len(self.counts)), self.counts)[representative < 0]] = False
        for array in values:
            rows = array.reshape(len(all_corners), -1)
            differs = (np.abs(rows - rows[representative[corners]]) > _EQUAL_WITHIN).any(axis=1)
            whole[self.owners[all_corners[differs & counts_in] // 3]] = False
        recut = 0
        if mapping is not None:
            safe, representative = self._safe_from_other_cuts(whole, representative, mapping)
            recut = int(np.count_nonzero(whole & ~safe))
            whole &= safe

        split = ~whole[self.owners]
        counts = np.concatenate([self.counts[whole], np.full(np.count_nonzero(split), 3)])
        face_corners = np.concatenate([representative[np.repeat(whole, self.counts)], all_corners[np.repeat(split, 3)]])
        owners = np.concatenate([np.flatnonzero(whole), self.owners[split]])
        order = np.argsort(owners, kind="stable")
        return OutputFaces(counts[order], face_corners[_reorder_runs(counts, order)], owners[order], recut)

    def _safe_from_other_cuts(
        self, whole: BoolArray, representative: Int64Array, mapping: "NewUvs"
    ) -> tuple[BoolArray, Int64Array]:
        """Return the polygons, (p,) bool, whose UVs depend on no cut, and `representative` in the order of their fans.

        That is where the cut is a fan and the UVs are an affine function of the positions in the polygon's plane.
        """
        safe, representative = np.ones_like(whole), representative.copy()
        starts, first = np.cumsum(self.counts) - self.counts, np.searchsorted(self.owners, np.arange(len(whole)))
        made = np.bincount(self.owners, minlength=len(whole))
        affected = whole & (self.counts > 3) & (made > 0)
        affected[affected] = mapping.new[first[affected]]
        for size in np.unique(self.counts[affected]):
            chosen = np.flatnonzero(affected & (self.counts == size))
            safe[chosen[made[chosen] != size - 2]] = False
            chosen = chosen[made[chosen] == size - 2]
            triangles = self.triangles[first[chosen][:, None] + np.arange(size - 2)] - starts[chosen][:, None, None]
            apex = triangles[:, :1, :1]
            from_apex, fan = (triangles - apex) % size, fan_triangles(np.arange(size))
            is_fan = (from_apex == fan).all(axis=(1, 2)) | (from_apex[:, ::-1] == fan).all(axis=(1, 2))
            loops = representative[starts[chosen][:, None] + (apex[:, 0] + np.arange(size)) % size]
            points, uvs = (array.reshape(-1, array.shape[2])[loops] for array in (mapping.points, mapping.uvs))
            safe[chosen] = is_fan & (_affine_residual(points, uvs) <= _AFFINE_WITHIN)
            representative[starts[chosen][:, None] + np.arange(size)] = loops
        return safe, representative


@dataclass(frozen=True, eq=False)
class NewUvs:
    """UVs of triangles that their file has not had.

    points   (t, 3, 3) positions at the corners
    uvs      (t, 3, 2) UVs there
    new      (t,) bool: the triangles that have new ones
    """

    points: Points
    uvs: NDArray[Any]
    new: BoolArray


def cut_note(faces: OutputFaces) -> tuple[Note, ...]:
    """Return a note on polygons that are written as triangles, if there are any."""
    are = one_or_many(faces.recut, "is", "are")
    cut = f"{counted(faces.recut, 'polygon')} {are} written as triangles: the texture fits no other cut"
    return (Note(cut),) if faces.recut else ()


def _affine_residual(points: Points, uvs: NDArray[Any]) -> Points:
    """Return how far the (m, n, 2) UVs of polygons are from an affine function of positions in their plane, (m,)."""
    points, uvs = points - points.mean(axis=1, keepdims=True), uvs - uvs.mean(axis=1, keepdims=True)
    normals = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0, lengths, 1)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    second = np.cross(normals, first)
    flat = np.stack([np.einsum("mkx,mx->mk", points, axis) for axis in (first, second)], axis=2)
    size = np.abs(flat).max(axis=(1, 2), keepdims=True)
    flat = flat / np.where(size > 0, size, 1)
    moments = np.einsum("mki,mkj->mij", flat, flat) + 1e-12 * np.eye(2)  # solvable for polygons on a line, too
    fitted = flat @ np.linalg.solve(moments, np.einsum("mki,mkj->mij", flat, uvs))
    return np.asarray(np.abs(uvs - fitted).max(axis=(1, 2)))


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
        cut, polygon = _triangulate(loops, positions[vertices[loops]])
        triangles.append(cut)
        owners.append(chosen[polygon])
    if not triangles:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def corner_order(counts: Int64Array, turned: bool) -> Int64Array:
    """Return the face corner at each polygon corner: the same or, turned, from the first of each face backwards.

    counts   (p,) corners of each face
    """
    order = np.arange(counts.sum())
    if not turned:
        return order
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    result: Int64Array = starts + (starts - order) % np.repeat(counts, counts)
    return result


def lost_faces(counts: Int64Array) -> tuple[str, ...]:
    """Return a warning about polygons without an area, of (p,) corner counts, if there are any."""
    lost = int(np.count_nonzero(counts < 3))
    skipped = one_or_many(lost, "is skipped", "are skipped")
    return (f"{counted(lost, 'face')} of fewer than 3 corners {skipped}",) if lost else ()


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


def _triangulate(loops: Int64Array, points: Points) -> tuple[Int64Array, Int64Array]:
    """Triangulate (m, n) polygons of n corners each, at the (m, n, 3) points.

    Returns the (t, 3) triangles and, for each, the index of its polygon.
    """
    size = loops.shape[1]
    fan = fan_triangles(np.arange(size))
    triangles = np.asarray(loops[:, fan])
    polygons = np.repeat(np.arange(len(loops)), size - 2)
    if size == 3:
        return triangles.reshape(-1, 3), polygons

    edges = points - points[:, :1]
    normals = np.cross(edges, np.roll(edges, -1, axis=1)).sum(axis=1)
    # Where the fan around the first corner has a degenerate or inverted triangle, the others are tried, then ears cut.
    unsolved = np.flatnonzero((_min_area_ratio(points, fan, normals) <= _FLAT_RATIO) & normals.any(axis=1))
    for first in range(1, size if len(unsolved) and size <= _MAX_FAN else 1):
        rotated = (fan + first) % size
        fits = _min_area_ratio(points[unsolved], rotated, normals[unsolved]) > _FLAT_RATIO
        triangles[unsolved[fits]] = loops[unsolved[fits]][:, rotated]
        unsolved = unsolved[~fits]
    if size == 4 or not len(unsolved):  # no other cut of four corners is left
        return triangles.reshape(-1, 3), polygons
    whole = np.ones(len(loops), dtype=bool)
    whole[unsolved] = False
    cut = [loops[polygon][_clip_ears(edges[polygon], normals[polygon])] for polygon in unsolved]
    owners = np.concatenate([polygons[whole[polygons]], np.repeat(unsolved, [len(ears) for ears in cut])])
    return np.concatenate([triangles[whole].reshape(-1, 3), *cut]), owners


def _min_area_ratio(points: Points, triangles: Int64Array, normals: Points) -> Points:
    """Return the (m,) smallest ratio of a triangle's signed area to its polygon's; negative if one is inverted."""
    a, b, c = (points[:, triangles[:, corner]] for corner in range(3))
    areas = np.einsum("mtk,mk->mt", np.cross(b - a, c - a), normals)
    whole = np.einsum("mk,mk->m", normals, normals)
    return np.asarray(areas.min(axis=1) / np.where(whole > 0, whole, 1))


def _clip_ears(points: Points, normal: Points) -> Int64Array:
    """Cut one polygon of (n, 3) points, the first of them at the origin, into ears.

    normal   (3,) twice its vector area (Newell): of all planes, its projection is largest in the one across this

    The library leaves out corners on straight edges; they are put back, so that neighbours meet at them.
    """
    from mapbox_earcut import triangulate_float64

    flat = _project(points, normal)
    ears = triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32)).astype(np.int64).reshape(-1, 3)
    if len(ears) == 0:
        return fan_triangles(np.arange(len(points)))
    return ears if len(ears) == len(points) - 2 else _with_all_corners(ears, flat)


def _project(points: Points, normal: Points) -> Points:
    """Return (n, 2) coordinates of points in the plane across a normal, counter-clockwise as seen against it.

    The projection is perpendicular to the plane, and is then seen along an axis, which no cut depends on: what is
    planar keeps its coordinates, so that straight edges stay so to the last bit.
    """
    unit = normal / np.linalg.norm(normal)
    heights = points @ unit
    if np.ptp(heights) > _PLANAR_WITHIN * np.ptp(points, axis=0).max():
        points = points - (heights - heights.mean())[:, None] * unit
    axis = int(np.argmax(np.abs(normal)))
    axes = [(axis + 1) % 3, (axis + 2) % 3]
    return np.ascontiguousarray(points[:, axes if normal[axis] > 0 else axes[::-1]])


def _with_all_corners(triangles: Int64Array, flat: Points) -> Int64Array:
    """Put the corners of a polygon that no triangle has between their neighbours again."""
    used = np.unique(triangles).tolist()
    extent = np.ptp(flat, axis=0).max()
    removed: list[tuple[int, int, int]] = []  # a corner between two others, the last to be put back first
    for start, stop in zip(used, [*used[1:], used[0] + len(flat)], strict=True):
        chain = [start]
        for corner in (number % len(flat) for number in range(start + 1, stop + 1)):
            while len(chain) > 1 and abs(_area(flat, chain[-2], chain[-1], corner)) <= _FLAT_RATIO * extent**2:
                removed.append((chain[-2], chain.pop(), corner))
            chain.append(corner)

    result = [(a, b, c) for a, b, c in triangles.tolist()]
    at_edge = {(row[c], row[(c + 1) % 3]): (number, c) for number, row in enumerate(result) for c in range(3)}
    for before, corner, after in reversed(removed):
        edge, step = flat[after] - flat[before], flat[corner] - flat[before]
        new = [(before, corner, after)]  # without area: corners at one place, or a spike
        number = len(result)
        if (before, after) in at_edge and 0 < step @ edge < edge @ edge:
            number, first = at_edge[before, after]
            apex = result[number][(first + 2) % 3]
            new = [(before, corner, apex), (corner, after, apex)]
        places = [number, len(result)]
        result[number : number + 1] = new[:1]
        result += new[1:]
        for place, row in zip(places, new, strict=False):
            at_edge |= {(row[c], row[(c + 1) % 3]): (place, c) for c in range(3)}
    return np.array(result, dtype=np.int64)


def _area(flat: Points, a: int, b: int, c: int) -> float:
    """Return twice the signed area of a triangle."""
    (ax, ay), (bx, by), (cx, cy) = flat[[a, b, c]].tolist()
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
