"""What a surface consists of: how many pieces, open or closed."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aoprecalc.model import Ints
from aoprecalc.surface.normals import edge_ids


@dataclass(frozen=True)
class Topology:
    """components: pieces that share no position; watertight: every edge belongs to exactly two faces."""

    components: int
    watertight: bool


def topology(faces: Ints) -> Topology:
    """Describe (f, 3) faces over welded positions; faces that repeat a position are left out."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not proper.any():
        return Topology(components=0, watertight=False)
    faces = faces[proper]
    watertight = bool((np.bincount(edge_ids(faces)) == 2).all())
    return Topology(len(np.unique(islands(faces))), watertight)


def islands(corners: Ints) -> Ints:
    """Return the island of each face, (f,) int32, for (f, 3) corner numbers: faces that share a number are of one."""
    size = int(corners.max()) + 1
    rows = np.concatenate([corners[:, 0], corners[:, 0]])
    columns = np.concatenate([corners[:, 1], corners[:, 2]])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(size, size))
    labels = connected_components(graph, directed=False)[1]
    island: Ints = np.unique(labels[corners[:, 0]], return_inverse=True)[1].astype(np.int32)
    return island
