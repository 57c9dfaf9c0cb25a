"""The triangles of a scene that stop light: faces without an alpha mask, and the opaque pieces of those with one.

Triangles are quartered until a quarter is certainly opaque, certainly clear or half a texel small. Straight cuts
through the smallest leave pieces; quarters that one cut through the whole describes as well are merged into one piece,
of the same area. Thus depth maps and rays need plain triangles only.

After H. Gruen, C. Benthin, S. Woop: Sub-triangle opacity masks for faster ray tracing of transparent objects, Proc. ACM
Comput. Graph. Interact. Tech. 3(2), 2020, and NVIDIA's opacity micro-maps, which subdivide alike, and once for all
copies of a triangle, but store bits, not pieces. The cuts are those of marching triangles; where a piece is larger than
the details of its mask, it is cut by a line with the right area on either side, as in D. L. Youngs: Time-dependent
multi-material flow with large fluid distortion, Numerical Methods for Fluid Dynamics, 1982.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from aoprecalc.mesh.masked_triangles import (
    OPAQUE,
    UNKNOWN,
    MaskedTriangles,
    opaque_share,
    quarter_nodes,
    quarter_values,
    shift_to_share,
)
from aoprecalc.types import BoolArray, Float64Array, Int32Array, Int64Array, Scene

_MAX_PIECES = 2_000_000
_MAX_NODES = 1_000_000  # subdivided at once
_TOLERANCE = 1 / 200  # of a piece's area: merging quarters may change at most as much


def opaque_triangles(scene: Scene, max_pieces: int = _MAX_PIECES) -> Float64Array:
    """Return the corners, (o, 3, 3), of the triangles that stop light, wound as their faces.

    max_pieces   into which the faces with a mask are cut; two for each are always allowed
    """
    return opaque_pieces(scene, max_pieces)[0]


def opaque_pieces(scene: Scene, max_pieces: int = _MAX_PIECES) -> tuple[Float64Array, Int64Array]:
    """Return the opaque triangles, see `opaque_triangles`, and the face of the scene that each is a piece of, (o,)."""
    uncut = np.flatnonzero(scene.occludes & scene.per_face(part.material.alpha_mask is None for part in scene.parts))
    solid = scene.positions[scene.faces[uncut]]
    masked = MaskedTriangles.from_scene(scene)
    if masked is None:
        return solid, uncut
    max_pieces = max(max_pieces, 2 * len(masked.corners))
    roots = np.zeros((len(masked.attributes), 5), np.int32)
    roots[:, 0], roots[:, 4] = np.arange(len(roots)), 1
    states = masked.classify(roots)
    unknown = roots[states == UNKNOWN]
    certain = roots[states == OPAQUE], np.ones((np.count_nonzero(states == OPAQUE), 3))
    for min_cuts in range(max(int(masked.max_cuts.max()), 0) + 2):
        cuts = _cut(masked, unknown, min_cuts, max(_MAX_NODES, len(roots)))
        final = certain, *cuts.final, (unknown[cuts.simple], cuts.values[cuts.simple])
        if sum(masked.count_pieces(*some) for some in final) <= max_pieces:
            break
    pieces = [piece for some in final for piece in masked.pieces(*some)]
    corners, faces = zip((solid, uncut), *pieces, strict=True)
    return np.concatenate(corners), np.concatenate(faces)


@dataclass(frozen=True, eq=False)
class _Cuts:
    """Straight cuts through m nodes.

    values   (m, 3): linear values at the corners, not negative where the node is opaque
    shares   (m,): of the node that is opaque
    simple   (m,) bool: the values describe the node well enough; else its pieces are among the final nodes
    final    (nodes, values) of quarters that stay separate pieces
    """

    values: Float64Array
    shares: Float64Array
    simple: BoolArray
    final: tuple[tuple[Int32Array, Float64Array], ...] = ()

    @classmethod
    def from_values(cls, values: Float64Array) -> Self:
        """Cut nodes by (m, 3) values."""
        return cls(values, opaque_share(values), np.ones(len(values), bool))

    def __getitem__(self, rows: slice) -> "_Cuts":
        return _Cuts(self.values[rows], self.shares[rows], self.simple[rows])

    def interleave(self, others: "_Cuts", own: BoolArray) -> "_Cuts":
        """Take these in order where `own` is true, (m,), and the others where it is not."""
        order = np.argsort(np.argsort(~own, kind="stable"))
        return _Cuts(
            np.concatenate([self.values, others.values])[order],
            np.concatenate([self.shares, others.shares])[order],
            np.concatenate([self.simple, others.simple])[order],
        )


def _cut(masked: MaskedTriangles, nodes: Int32Array, min_cuts: int, max_nodes: int) -> _Cuts:
    """Cut nodes, (m, 5), that are neither certainly clear nor certainly opaque.

    The largest are quartered first, so that where there are too many nodes the rest are of about the same size.

    min_cuts    nodes whose sides may be halved only as often are merged into one piece
    max_nodes   how many nodes may be opaque or unknown
    """
    halvings, cuts_left = (limit[nodes[:, 0]] - nodes[:, 1] for limit in (masked.halvings, masked.max_cuts))
    split = (halvings > 0) & (cuts_left == cuts_left[halvings > 0].max(initial=-1 << 32))
    quarters = quarter_nodes(nodes[split])
    states = masked.classify(quarters)
    unknown = states == UNKNOWN
    next_nodes = np.concatenate([quarters[unknown], nodes[~split]])
    max_nodes -= int(np.count_nonzero(states == OPAQUE))
    if not split.any() or max_nodes < len(next_nodes):
        return _Cuts.from_values(masked.cuts(nodes))
    below = _cut(masked, next_nodes, min_cuts, max_nodes)

    # Merge quarters that one straight cut describes as well.
    count = int(np.count_nonzero(unknown))
    certain = _Cuts.from_values(np.repeat(states[~unknown, None].astype(np.float64), 3, axis=1))
    parts = below[:count].interleave(certain, unknown)
    shares = parts.shares.reshape(-1, 4)
    merged: BoolArray = np.all(parts.simple.reshape(-1, 4), axis=1)
    edges, has_edge = masked.edges(nodes[split][merged], 1 + int(halvings[split].max()))
    slopes = np.where(has_edge[:, None], edges, shares[merged, :3])
    values = np.zeros((len(merged), 3))
    values[merged] = shift_to_share(slopes, shares[merged].mean(axis=1))
    error = np.abs(opaque_share(quarter_values(values[merged])) - shares[merged]).mean(axis=1)
    merged[merged] = (error <= _TOLERANCE) | (cuts_left[split][merged] <= min_cuts)
    separate = parts.simple & ~np.repeat(merged, 4)

    cuts = _Cuts(values, shares.mean(axis=1), merged).interleave(below[count:], split)
    return replace(cuts, final=(*below.final, (quarters[separate], parts.values[separate])))
