"""Which corners, edges and faces belong together: welding, vertices for seams, edges, boundaries, components."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import BoolArray, Float64Array, Int32Array


def unique_rows(*columns: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the distinct rows of arrays side by side, in order of first appearance.

    columns  each (n,) or (n, c), without NaN; rows are equal where all their numbers are (so 0.0 equals -0.0)

    Returns (first, inverse), as `np.unique` does: the index of the first occurrence of each of d distinct rows, (d,),
    and the index into those d of every row, (n,).
    """
    keys = [numbers for column in columns for numbers in column.reshape(len(column), -1).T]
    order = np.lexsort(keys[::-1])
    starts_group = np.zeros(len(order), dtype=bool)
    starts_group[:1] = True
    for numbers in keys:
        ordered = numbers[order]
        starts_group[1:] |= ordered[1:] != ordered[:-1]

    # lexsort is stable, so the first row of a group is the one that appears first.
    first = order[starts_group]
    appearance = np.argsort(first)
    rank = np.empty_like(appearance)
    rank[appearance] = np.arange(len(appearance))
    inverse = np.empty_like(order)
    inverse[order] = rank[np.cumsum(starts_group) - 1]
    return first[appearance], inverse


@dataclass(frozen=True, eq=False)
class IndexedVertices:
    """Vertices made from face corners, for formats with one normal and one UV for each vertex.

    corner     (n,) for each vertex, one of the corners that it stands for: 3 * face + 0, 1 or 2
    triangles  (f, 3) the vertex at each corner
    """

    corner: NDArray[np.intp]
    triangles: NDArray[np.intp]


def corners_to_vertices(*values: NDArray[Any]) -> IndexedVertices:
    """Make one vertex for all corners that agree in all values, in the order in which the faces use them.

    values   each (f, 3) or (f, 3, c) numbers at the corners
    """
    columns = [array.reshape(array.shape[0] * 3, -1) for array in values]
    corner, inverse = unique_rows(*columns)
    return IndexedVertices(corner, inverse.reshape(-1, 3))


@dataclass(frozen=True)
class Topology:
    """components: pieces that share no position; watertight: every edge belongs to exactly two faces."""

    components: int
    watertight: bool


def topology(faces: Int32Array) -> Topology:
    """Count the components of (f, 3) faces over welded positions; faces that repeat a position are ignored."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not proper.any():
        return Topology(components=0, watertight=False)
    faces = faces[proper]
    watertight = bool((np.bincount(edge_ids(faces).ravel()) == 2).all())
    return Topology(len(np.unique(face_components(faces))), watertight)


def face_components(corners: Int32Array) -> Int32Array:
    """Label the connected component of each face, (f,) int32 from 0, for (f, 3) vertex indices."""
    size = int(corners.max()) + 1
    rows = np.concatenate([corners[:, 0], corners[:, 0]])
    columns = np.concatenate([corners[:, 1], corners[:, 2]])
    from scipy.sparse import coo_array  # in functions: its import takes as long as a small preview
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(size, size))
    labels = connected_components(graph, directed=False)[1]
    components: Int32Array = np.unique(labels[corners[:, 0]], return_inverse=True)[1].astype(np.int32)
    return components


def edge_ids(corners: Int32Array) -> Int32Array:
    """Number the undirected edges of (f, 3) vertex indices, (f, 3) int32: equal where faces share the edge.

    Edge c of a face runs from its corner c to the next.
    """
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).astype(np.int64)
    ids = np.unique(ends[..., 0] * (corners.max() + 1) + ends[..., 1], return_inverse=True)[1]
    return ids.astype(np.int32).reshape(-1, 3)


def closed_faces(corners: Int32Array) -> BoolArray:
    """Return which of (f, 3) faces belong to a closed piece: every edge of it belongs to exactly two faces."""
    ids = edge_ids(corners)
    open_ones = (np.bincount(ids.ravel())[ids] != 2).any(axis=1)
    piece = face_components(corners)
    closed: BoolArray = np.bincount(piece[open_ones], minlength=int(piece.max()) + 1)[piece] == 0
    return closed


def boundary_edges(corners: Int32Array) -> BoolArray:
    """Return which edges of (f, 3) vertex indices belong to a single face, (f, 3) bool."""
    ids = edge_ids(corners)
    single: BoolArray = np.bincount(ids.ravel())[ids] == 1
    return single


def adjacent_half_edges(corners: Int32Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return pairs of sides of faces that are one edge, (p,) each: 3 * face + the corner from which the side runs.

    corners   (f, 3) vertex indices; of more than two faces at an edge, each is paired with the next
    """
    edges = edge_ids(corners).ravel()
    order = np.argsort(edges, kind="stable")
    shared = edges[order[1:]] == edges[order[:-1]]
    return order[:-1][shared], order[1:][shared]


def joined_faces(count: int, one: NDArray[np.intp], other: NDArray[np.intp]) -> Int32Array:
    """Label `count` faces, or other things, (f,) int32 from 0: equal where pairs of them, (p,) each, join them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(one), np.int8), (one, other)), (count, count))
    labels: Int32Array = connected_components(graph, directed=False)[1].astype(np.int32)
    return labels


def corner_groups(faces: Int32Array, first: NDArray[np.intp], second: NDArray[np.intp]) -> Int32Array:
    """Label corners, (f, 3) int32: equal where the faces around a vertex are joined across edges.

    faces           (f, 3) vertex indices
    first, second   (p,) each: pairs of sides of faces that are such edges, see `adjacent_half_edges`
    """
    one, other = list[NDArray[np.intp]](), list[NDArray[np.intp]]()
    for end in (0, 1):
        corner = first // 3 * 3 + (first % 3 + end) % 3
        for other_end in (0, 1):
            opposite = second // 3 * 3 + (second % 3 + other_end) % 3
            same = faces.ravel()[corner] == faces.ravel()[opposite]
            one.append(corner[same])
            other.append(opposite[same])
    return joined_faces(faces.size, np.concatenate(one), np.concatenate(other)).reshape(faces.shape)


_LINKS = (2.0, 1.0, 0.5, 0.25)  # distances at which corners are joined, over the tolerance: the widest that can be
_NEIGHBOURS = 16  # of a corner, that may be joined with it; others are reached through these


def weld_corners(corners: Float64Array, tolerance: float) -> tuple[Float64Array, NDArray[np.intp]]:
    """Return (v, 3) positions and (f, 3) faces into them of (f, 3, 3) corners.

    tolerance   how far a corner at an open edge is moved at most, to meet others; no longer edge loses its length

    Equal corners are one position. Where the surface is still open, corners are joined through others, and meet in the
    middle of their bounding box: the order of the faces does not matter.
    """
    first, which = unique_rows(corners.reshape(-1, 3))
    points, faces = corners.reshape(-1, 3)[first], which.reshape(-1, 3)
    following = np.roll(faces, -1, axis=1)
    keys = np.sort((np.minimum(faces, following) * len(points) + np.maximum(faces, following)).ravel())
    if len(keys) % 2 == 0 and (keys[::2] == keys[1::2]).all():
        return points, faces

    is_open = boundary_edges(faces.astype(np.int32))
    long = np.linalg.norm(points[faces] - points[following], axis=2) > tolerance
    at_open = np.zeros(len(points), dtype=bool)
    at_open[faces[is_open]] = at_open[following[is_open]] = True
    pending = np.flatnonzero(at_open)
    place = points.copy()
    for link in _LINKS:
        if len(pending) < 2:
            break
        label, middle = _clusters(points[pending], link * tolerance)
        unfit = np.zeros(len(middle), dtype=bool)
        unfit[label[np.linalg.norm(points[pending] - middle[label], axis=1) > tolerance]] = True
        cluster = np.full(len(points), -1)
        cluster[pending] = label
        collapsed = long & (cluster[faces] == cluster[following]) & (cluster[faces] >= 0)
        unfit[cluster[faces[collapsed]]] = True
        fit = ~unfit[label]
        place[pending[fit]] = middle[label[fit]]
        pending = pending[~fit]
    first, which = unique_rows(place)
    return place[first], which[faces]


def _clusters(points: Float64Array, distance: float) -> tuple[NDArray[np.intp], Float64Array]:
    """Return the cluster of each of (n, 3) points that are joined at a distance, and the middle of each cluster."""
    from scipy.spatial import cKDTree

    count = len(points)
    nearest = range(2, min(_NEIGHBOURS + 1, count) + 1)  # the first is the point itself, or one at its place
    distances, others = cKDTree(points).query(points, nearest, distance_upper_bound=distance, workers=-1)
    rows, columns = np.nonzero(np.isfinite(distances))
    label = joined_faces(count, rows, others[rows, columns]).astype(np.intp)
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    low, high = (extreme.reduceat(points[order], starts) for extreme in (np.minimum, np.maximum))
    return label, (low + high) / 2


def neighbours_in_a_row(triangles: Int32Array) -> NDArray[np.intp]:
    """Return an order of the triangles, (t,), that walks from each to a neighbour as far as it can (depth first)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, depth_first_order

    count = len(triangles)
    one, other = (half_edge // 3 for half_edge in adjacent_half_edges(triangles))
    _, island = connected_components(coo_array((np.ones(len(one)), (one, other)), (count, count)), directed=False)
    starts = np.unique(island, return_index=True)[1]  # all islands hang on one more node, from which the walk starts
    rows, columns = np.concatenate([one, np.full(len(starts), count)]), np.concatenate([other, starts])
    graph = coo_array((np.ones(len(rows)), (rows, columns)), (count + 1, count + 1)).tocsr()
    walk: NDArray[np.intp] = depth_first_order(graph, count, directed=False, return_predecessors=False)[1:]
    return walk.astype(np.intp)
