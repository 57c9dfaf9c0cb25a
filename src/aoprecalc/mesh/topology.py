"""What a surface consists of: how many pieces, open or closed."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aoprecalc.types import BoolArray, Int32Array


@dataclass(frozen=True)
class Topology:
    """components: pieces that share no position; watertight: every edge belongs to exactly two faces."""

    components: int
    watertight: bool


def topology(faces: Int32Array) -> Topology:
    """Describe (f, 3) faces over welded positions; faces that repeat a position are left out."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not proper.any():
        return Topology(components=0, watertight=False)
    faces = faces[proper]
    watertight = bool((np.bincount(edge_ids(faces).ravel()) == 2).all())
    return Topology(len(np.unique(face_components(faces))), watertight)


def face_components(corners: Int32Array) -> Int32Array:
    """Return the island of each face, (f,) int32, for (f, 3) corner numbers: faces that share a number are of one."""
    size = int(corners.max()) + 1
    rows = np.concatenate([corners[:, 0], corners[:, 0]])
    columns = np.concatenate([corners[:, 1], corners[:, 2]])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(size, size))
    labels = connected_components(graph, directed=False)[1]
    island: Int32Array = np.unique(labels[corners[:, 0]], return_inverse=True)[1].astype(np.int32)
    return island


def edge_ids(corners: Int32Array) -> Int32Array:
    """Return a number for each edge of (f, 3) corner numbers, (f, 3) int32, equal where two faces share the edge.

    Edge c of a face runs from its corner c to the next.
    """
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).astype(np.int64)
    ids = np.unique(ends[..., 0] * (corners.max() + 1) + ends[..., 1], return_inverse=True)[1]
    return ids.astype(np.int32).reshape(-1, 3)


def boundary_edges(corners: Int32Array) -> BoolArray:
    """Return which edges, (f, 3), belong to one face alone."""
    ids = edge_ids(corners)
    alone: BoolArray = np.bincount(ids.ravel())[ids] == 1
    return alone
