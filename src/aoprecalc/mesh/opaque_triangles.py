"""The triangles of a scene that stop light: those without holes as they are, of others the pieces between the holes.

Triangles are quartered until a quarter is certainly opaque, certainly clear or half a texel small. Straight cuts
through the last leave pieces; quarters that one cut through the whole tells as well become one piece again, of the same
area. Whoever renders or traces rays thus sees triangles alone.

After H. Gruen, C. Benthin, S. Woop: Sub-triangle opacity masks for faster ray tracing of transparent objects, Proc. ACM
Comput. Graph. Interact. Tech. 3(2), 2020, and NVIDIA's opacity micro-maps, which quarter alike, and once for all copies
of a triangle, but keep bits, not pieces. The cuts are those of marching triangles; where a piece must be larger than
what it shows, a line with the right area on either side, as in D. L. Youngs: Time-dependent multi-material flow with
large fluid distortion, Numerical Methods for Fluid Dynamics, 1982.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from aoprecalc.mesh.masked_triangles import (
    OPAQUE,
    UNKNOWN,
    MaskedTriangles,
    opaque_share,
    quartered,
    quarters_of,
    with_share,
)
from aoprecalc.types import BoolArray, Float64Array, Int32Array, Scene

_BUDGET = 2_000_000  # pieces
_WORK = 1_000_000  # nodes that are looked into at once
_TOLERANCE = 1 / 200  # of a piece's area: what must change for quarters to remain


def opaque_triangles(scene: Scene, budget: int = _BUDGET) -> Float64Array:
    """Return the corners, (o, 3, 3), of the triangles that are in the light's way, wound as their faces.

    budget   how many pieces the faces with holes may become; each may become two, whatever it is
    """
    solid = scene.corners[scene.occludes & scene.per_face(part.material.alpha_mask is None for part in scene.parts)]
    cards = MaskedTriangles.from_scene(scene)
    if cards is None:
        return solid
    budget = max(budget, 2 * len(cards.corners))
    wholes = np.zeros((len(cards.marks), 5), np.int32)
    wholes[:, 0], wholes[:, 4] = np.arange(len(wholes)), 1
    states = cards.states(wholes)
    unknown = wholes[states == UNKNOWN]
    certain = wholes[states == OPAQUE], np.ones((np.count_nonzero(states == OPAQUE), 3))
    for shortest in range(max(int(cards.sizes.max()), 0) + 2):
        cuts = _cut(cards, unknown, shortest, max(_WORK, len(wholes)))
        settled = certain, *cuts.settled, (unknown[cuts.simple], cuts.values[cuts.simple])
        if sum(cards.count(*some) for some in settled) <= budget:
            break
    return np.concatenate([solid, *(pieces for some in settled for pieces in cards.pieces(*some))])


@dataclass(frozen=True, eq=False)
class _Cuts:
    """How nodes are cut.

    values    (m, 3): at the corners; linear in between, and not negative where the node is opaque
    shares    (m,): of the node that is opaque
    simple    (m,) bool: the values tell it well enough; else there are pieces of it among the settled
    settled   nodes, with their values, that remain pieces
    """

    values: Float64Array
    shares: Float64Array
    simple: BoolArray
    settled: tuple[tuple[Int32Array, Float64Array], ...] = ()

    @classmethod
    def by(cls, values: Float64Array) -> Self:
        """Cut nodes where (m, 3) values say."""
        return cls(values, opaque_share(values), np.ones(len(values), bool))

    def __getitem__(self, rows: slice) -> "_Cuts":
        return _Cuts(self.values[rows], self.shares[rows], self.simple[rows])

    def among(self, others: "_Cuts", here: BoolArray) -> "_Cuts":
        """Put them where `here` is true, (m,), and others where it is not."""
        every = np.argsort(np.argsort(~here, kind="stable"))
        return _Cuts(
            np.concatenate([self.values, others.values])[every],
            np.concatenate([self.shares, others.shares])[every],
            np.concatenate([self.simple, others.simple])[every],
        )


def _cut(cards: MaskedTriangles, nodes: Int32Array, shortest: int, room: int) -> _Cuts:
    """Cut nodes, (m, 5), of which it is unknown whether they are clear or opaque.

    The largest are quartered first: where that takes too many nodes, the rest are thus about as large.

    shortest   sides are not halved if they could be only that often, in the end; their nodes remain one piece
    room       how many nodes may be opaque or unknown
    """
    halvings, sizes = (those[nodes[:, 0]] - nodes[:, 1] for those in (cards.halvings, cards.sizes))
    split = (halvings > 0) & (sizes == sizes[halvings > 0].max(initial=-1 << 32))
    quarters = quarters_of(nodes[split])
    states = cards.states(quarters)
    unknown = states == UNKNOWN
    opened = np.concatenate([quarters[unknown], nodes[~split]])
    room -= int(np.count_nonzero(states == OPAQUE))
    if not split.any() or room < len(opened):
        return _Cuts.by(cards.cuts(nodes))
    below = _cut(cards, opened, shortest, room)

    # Join quarters that one straight cut tells as well.
    count = int(np.count_nonzero(unknown))
    certain = _Cuts.by(np.repeat(states[~unknown, None].astype(np.float64), 3, axis=1))
    parts = below[:count].among(certain, unknown)
    shares = parts.shares.reshape(-1, 4)
    joined: BoolArray = np.all(parts.simple.reshape(-1, 4), axis=1)
    edges, is_cut = cards.edges(nodes[split][joined], 1 + int(halvings[split].max()))
    slopes = np.where(is_cut[:, None], edges, shares[joined, :3])
    values = np.zeros((len(joined), 3))
    values[joined] = with_share(slopes, shares[joined].mean(axis=1))
    missed = np.abs(opaque_share(quartered(values[joined])) - shares[joined]).mean(axis=1)
    joined[joined] = (missed <= _TOLERANCE) | (sizes[split][joined] <= shortest)
    remain = parts.simple & ~np.repeat(joined, 4)

    cuts = _Cuts(values, shares.mean(axis=1), joined).among(below[count:], split)
    return replace(cuts, settled=(*below.settled, (quarters[remain], parts.values[remain])))
