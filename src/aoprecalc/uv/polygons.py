"""Polygons that stay whole in new UVs, for formats that cannot cut them, as USD: no seam runs through them.

Unwrappers know triangles only. Where they have put a seam between the triangles of a polygon, the largest of these
keeps its place and the others are unfolded beside it. Should they lie over others there, the chart is cut again as any
other that is faulty; at last each polygon is a chart of its own.
"""

import numpy as np

from aoprecalc.mesh.surface import area_vectors
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.types import Float64Array, Int32Array, Int64Array

Point = tuple[float, ...]


def join_polygons(
    uvs: Float64Array, chart: Int32Array, positions: Float64Array, faces: Int32Array, polygons: Int32Array
) -> tuple[Float64Array, Int32Array]:
    """Return UVs (f, 3, 2) and charts (f,) in which the triangles of a polygon lie side by side in one chart.

    chart      (f,) of each face; -1 where it is in none, which stays so
    positions  (v, 3)
    faces      (f, 3) indices into them
    polygons   (f,) the polygon of each face
    """
    split = _split_faces(uvs, chart, faces, polygons)
    if not len(split):
        return uvs, chart
    uvs, chart = uvs.copy(), chart.copy()
    areas = np.linalg.norm(area_vectors(positions[faces[split]]), axis=1)
    order = split[np.lexsort([-areas, polygons[split]])]  # by polygon, its largest triangle first
    ends = np.flatnonzero(np.diff(polygons[order])) + 1
    for group in np.split(order, ends):
        _unfold(uvs, chart, positions, faces, group)
    return uvs, chart


def _split_faces(uvs: Float64Array, chart: Int32Array, faces: Int32Array, polygons: Int32Array) -> Int64Array:
    """Return the faces, in charts, of polygons that have more than one UV or chart at a vertex."""
    placed = np.flatnonzero(chart >= 0)
    owner = np.repeat(polygons[placed], 3)
    first, which = unique_rows(owner, faces[placed].reshape(-1))
    at_corner = np.column_stack([uvs[placed].reshape(-1, 2), np.repeat(chart[placed], 3)])
    differs = (at_corner != at_corner[first][which]).any(axis=1)
    return np.asarray(placed[np.isin(polygons[placed], owner[differs])])


def _unfold(
    uvs: Float64Array, chart: Int32Array, positions: Float64Array, faces: Int32Array, group: Int64Array
) -> None:
    """Put the triangles of one polygon beside the first of them, each across the edge that it shares with another."""
    anchor, *waiting = group.tolist()
    placed: dict[int, Point] = {}  # vertex -> UV
    behind: dict[frozenset[int], int] = {}  # edge -> the third vertex of the triangle that is there
    placed.update(zip(faces[anchor].tolist(), map(tuple, uvs[anchor].tolist()), strict=True))
    behind.update(_edges(faces[anchor].tolist()))
    while waiting:
        beside = ((face, edge) for face in waiting for edge in _edges(faces[face].tolist()) if edge in behind)
        face, edge = next(beside, (-1, frozenset[int]()))
        if face < 0:  # a triangle without area, which has no place, is between
            return
        corners = faces[face].tolist()
        start, end = (vertex for vertex in corners if vertex in edge)
        (apex,) = (vertex for vertex in corners if vertex not in edge)
        if apex not in placed:
            sides = [placed[vertex] for vertex in (start, end, behind[edge])]
            placed[apex] = _beside(positions[[start, end, apex]].tolist(), sides)
        uvs[face], chart[face] = [placed[vertex] for vertex in corners], chart[anchor]
        behind.update(_edges(corners))
        waiting.remove(face)


def _edges(corners: list[int]) -> dict[frozenset[int], int]:
    """Return the edges of a triangle, and the vertex opposite to each."""
    return {frozenset(corners) - {vertex}: vertex for vertex in corners}


def _beside(corners: list[list[float]], sides: list[Point]) -> Point:
    """Return the UV of a triangle's third corner.

    corners   (3, 3) positions of its corners
    sides     UVs of the first and the second, and of the corner on the other side of their edge
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    (ua, va), (ub, vb), (uo, vo) = sides
    edge, other = (bx - ax, by - ay, bz - az), (cx - ax, cy - ay, cz - az)
    length = sum(x * x for x in edge) or 1.0
    along = sum(x * y for x, y in zip(edge, other, strict=True)) / length
    height = (max(sum(x * x for x in other) / length - along**2, 0.0)) ** 0.5
    du, dv = ub - ua, vb - va
    if du * (vo - va) - dv * (uo - ua) > 0:
        height = -height
    return ua + along * du - height * dv, va + along * dv + height * du
