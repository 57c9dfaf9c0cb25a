"""Triangles that are quartered again and again, and straight lines through them.

A node is a row of five int32: the number of its triangle, how often its sides were halved, i, j, and 1 or -1. In its
own sides along 0-1 and 0-2 of the triangle its corners are at (i, j), (i +- 1, j) and (i, j +- 1).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.alpha_texture import AlphaTexture
from aoprecalc.types import AlphaMask, BoolArray, Float64Array, Int32Array, Int64Array, Scene

SPECK = 1e-12  # of a length or an area, which is none

_CORNERS = np.array([(0, 0), (1, 0), (0, 1)], np.int32)
_QUARTERS = np.array([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, -1)], np.int32)


def quarters_of(nodes: Int32Array) -> Int32Array:
    """Return the four quarters of each of (m, 5) nodes one after the other, (4 m, 5)."""
    quarters = np.repeat(nodes, 4, axis=0).reshape(-1, 4, 5)
    side = nodes[:, None, 4:]
    quarters[:, :, 1] += 1
    quarters[:, :, 2:4] = 2 * nodes[:, None, 2:4] + side * _QUARTERS[:, :2]
    quarters[:, :, 4:] *= _QUARTERS[:, 2:]
    every: Int32Array = quarters.reshape(-1, 5)
    return every


def quartered(values: Float64Array) -> Float64Array:
    """Return the values at the corners of the quarters, (m, 4, 3), from those at the corners of the wholes, (m, 3)."""
    a, b, c = values.T
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, bc, ca, ab], axis=1).reshape(-1, 4, 3)


def parted(values: Float64Array) -> tuple[Int64Array, Float64Array]:
    """Tell how a line parts triangles, by values at their corners, (..., 3), of both signs.

    Returns the corners in turn, (..., 3), from the one that it parts from two, and how far from that it meets the sides
    to the others, (..., 2), as shares of these.
    """
    opaque = values >= 0
    lonely = np.where(opaque.sum(axis=-1) == 1, opaque.argmax(axis=-1), opaque.argmin(axis=-1))
    turn: Int64Array = (lonely[..., None] + np.arange(3)) % 3
    turned = np.take_along_axis(values, turn, axis=-1)
    return turn, turned[..., :1] / (turned[..., :1] - turned[..., 1:])


def opaque_share(values: Float64Array) -> Float64Array:
    """Return how much of a triangle, (...), has no negative value, from those at its corners, (..., 3)."""
    count = (values >= 0).sum(axis=-1)
    shares: Float64Array = count / 3
    cut = count % 3 > 0
    corner = parted(values[cut])[1].prod(axis=-1)
    shares[cut] = np.where(count[cut] == 1, corner, 1 - corner)
    return shares


def with_share(values: Float64Array, shares: Float64Array) -> Float64Array:
    """Shift the values at the corners of triangles, (m, 3), so that none is negative in just (m,) shares of them."""
    values = np.where(np.ptp(values, axis=1, keepdims=True) > 0, values, (-1.0, 0.0, 1.0))
    low, middle, high = np.sort(values, axis=1).T
    from_high = high - np.sqrt(shares * (high - middle) * (high - low))
    from_low = low + np.sqrt((1 - shares) * (middle - low) * (high - low))
    level = np.where(shares * (high - low) <= high - middle, from_high, from_low)[:, None]
    whole = np.where(shares > 0, 1.0, -1.0)[:, None]
    return np.where(((shares > 0) & (shares < 1))[:, None], values - level, whole)


def node_places(nodes: Int32Array) -> Float64Array:
    """Return the corners of (m, 5) nodes, (m, 3, 2), as weights of the corners 1 and 2 of their triangles."""
    corners = nodes[:, None, 2:4] + nodes[:, None, 4:] * _CORNERS
    places: Float64Array = np.ldexp(corners.astype(np.float64), -nodes[:, None, 1:2])
    return places


def weighted(corners: Float64Array, places: Float64Array) -> Float64Array:
    """Interpolate what (m, 3, x) triangles have at their corners at (m, k, 2) places, (m, k, x)."""
    a, b, c = (corners[:, None, k] for k in range(3))
    one, two = places[..., :1], places[..., 1:]
    return (1 - one - two) * a + one * b + two * c


# The middles of a triangle's sixteenths: places, (16, 2), and weights of all three corners, (16, 3).
MIDDLES = node_places(quarters_of(quarters_of(np.array([(0, 0, 0, 0, 1)], np.int32)))).mean(axis=1)
MIDDLE_WEIGHTS = weighted(np.eye(3)[None], MIDDLES[None])[0]


# The faces with holes, and what is known of their nodes.

UNKNOWN, CLEAR, OPAQUE = 0, -1, 1  # what is certain of a node

_FINEST = 1 / 2048  # of the diagonal of all that takes part: sides of pieces are not halved below it
_TEXELS = 1 / 2  # as long are the sides of the smallest nodes; what single texels draw needs both their halves
_BLOCK = 1 << 15  # nodes looked at together, which the processor's cache can hold
_FARTHEST = 1e9  # UVs beyond it, or not finite, are a fault of the file that must not stop the bake: (0, 0)


@dataclass(frozen=True, eq=False)
class MaskedTriangles:
    """The c faces with holes that are in the light's way, copies of n different triangles.

    marks      (n, 3, 3) float64: u, 1 - v and the factor at each corner
    cutoffs    (n,) float64
    shows      (n,): the number of the picture on each
    halvings   (n,): how often its sides are halved until all are short in texels
    sizes      (n,): how often before the longest is too short for a piece
    pictures   each once
    copies     (n + 1,): where the copies of each begin in corners, and their end
    corners    (c, 3, 3) float64
    """

    marks: Float64Array
    cutoffs: Float64Array
    shows: Int64Array
    halvings: Int64Array
    sizes: Int64Array
    pictures: tuple[AlphaTexture, ...]
    copies: Int64Array
    corners: Float64Array

    @classmethod
    def from_scene(cls, scene: Scene) -> Self | None:
        """Collect them from a scene; None if there are none."""
        parts = [part for part in scene.parts if part.occludes and part.stop > part.start]
        pierced = [(part.faces, part.material.alpha_mask) for part in parts if part.material.alpha_mask is not None]
        if not pierced:
            return None
        # Materials share pictures, and parts share materials.
        keys = [(id(alpha_mask.alpha), alpha_mask.wraps) for _, alpha_mask in pierced]
        distinct = {key: alpha_mask for key, (_, alpha_mask) in zip(keys, pierced, strict=True)}
        pictures = tuple(
            AlphaTexture.from_image(alpha_mask.alpha, alpha_mask.wraps) for alpha_mask in distinct.values()
        )
        numbers = {key: number for number, key in enumerate(distinct)}
        counts = [faces.stop - faces.start for faces, _ in pierced]
        shows = np.repeat([numbers[key] for key in keys], counts)
        cutoffs = np.repeat([alpha_mask.cutoff for _, alpha_mask in pierced], counts)
        marks = np.concatenate([_marks(alpha_mask) for _, alpha_mask in pierced])
        corners = np.concatenate([scene.positions[scene.faces[faces]] for faces, _ in pierced])

        there = scene.corners[scene.occludes | scene.receives].reshape(-1, 3)
        finest = _FINEST * np.linalg.norm(np.ptp(there, axis=0))
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        sizes = np.floor(np.log2(np.maximum(longest / finest, SPECK) if finest > 0 else np.ones(len(corners))))
        copied = np.column_stack([shows, cutoffs, sizes, marks.reshape(-1, 9)])
        _, first, same = np.unique(copied, axis=0, return_index=True, return_inverse=True)
        spread = np.ptp(marks[first, :, :2], axis=1) * np.array([picture.varying for picture in pictures])[shows[first]]
        return cls(
            marks=marks[first],
            cutoffs=cutoffs[first],
            shows=shows[first],
            halvings=np.ceil(np.log2((spread.max(axis=1) / _TEXELS).clip(1, 1 << 30))).astype(np.int64),
            sizes=sizes[first].astype(np.int64),
            pictures=pictures,
            copies=np.cumsum([0, *np.bincount(same.ravel())]),
            corners=corners[np.argsort(same.ravel(), kind="stable")],
        )

    def states(self, nodes: Int32Array) -> NDArray[np.int8]:
        """Tell which of (m, 5) nodes are certainly opaque and which are certainly clear, (m,)."""
        states = np.full(len(nodes), UNKNOWN, np.int8)
        for picture, at in self._blocks(nodes[:, 0]):
            triangle = nodes[at, 0]
            marks = weighted(self.marks[triangle], node_places(nodes[at]))
            low, high = marks.min(axis=1), marks.max(axis=1)
            alpha = picture.between(low[:, :2], high[:, :2])
            products = np.concatenate([alpha * low[:, 2:], alpha * high[:, 2:]], axis=1)
            states[at[products.min(axis=1) >= self.cutoffs[triangle]]] = OPAQUE
            states[at[products.max(axis=1) < self.cutoffs[triangle]]] = CLEAR
        return states

    def cuts(self, nodes: Int32Array) -> Float64Array:
        """Return values at the corners of (m, 5) nodes, (m, 3), that tell what is opaque as if its edge were straight.

        In nodes with sides of many texels edges need not meet a side: there samples tell the slope and the share.
        """
        values = np.empty((len(nodes), 3))
        coarse = self.halvings[nodes[:, 0]] > nodes[:, 1]
        values[~coarse] = self.edges(nodes[~coarse], 1)[0]
        for at in _runs(np.flatnonzero(coarse), _BLOCK // len(MIDDLES)):
            places = weighted(node_places(nodes[at]), MIDDLES[None])
            excess = self.excess(np.repeat(nodes[at, 0], len(MIDDLES)), places.reshape(-1, 2))
            opaque = (excess >= 0).reshape(len(at), -1)
            # The least squares' slope of what is 1 at opaque samples and 0 at clear ones, but for a factor.
            values[at] = with_share(opaque @ MIDDLE_WEIGHTS, opaque.mean(axis=1))
        return values

    def edges(self, nodes: Int32Array, halvings: int) -> tuple[Float64Array, BoolArray]:
        """Return values at the corners of (m, 5) nodes, (m, 3), that vanish where the edge of the hole meets two sides.

        halvings   of a side, before the edge on it is taken to be where a straight line would put it
        Also tell where it does, (m,); elsewhere the three values are 1, or -1.
        """
        places = node_places(nodes)
        excess = self.excess(np.repeat(nodes[:, 0], 3), places.reshape(-1, 2)).reshape(-1, 3)
        # Where texels meet as on a chess board it is just 0 all around a triangle: the centre knows the side.
        doubtful = (excess == 0).any(axis=1)
        centres = self.excess(nodes[doubtful, 0], places[doubtful].mean(axis=1))
        excess[doubtful] = np.where(excess[doubtful] == 0, SPECK * centres[:, None], excess[doubtful])
        values = np.where(excess >= 0, 1.0, -1.0)
        cut: BoolArray = np.ptp(values, axis=1) > 0
        turn, _ = parted(values[cut])
        places, excess = np.take_along_axis(places[cut], turn[..., None], 1), np.take_along_axis(excess[cut], turn, 1)

        # Both sides at the lonely corner: halve the stretch with the edge on it.
        triangle = np.repeat(nodes[cut, 0], 2)
        begin, end = np.repeat(places[:, 0], 2, axis=0), places[:, 1:].reshape(-1, 2)
        from_, to = np.repeat(excess[:, 0], 2), excess[:, 1:].ravel()
        first, last = np.zeros(len(triangle)), np.ones(len(triangle))
        for _ in range(halvings):
            middle = (first + last) / 2
            found = self.excess(triangle, begin + middle[:, None] * (end - begin))
            alike = (found >= 0) == (from_ >= 0)
            first, from_ = np.where(alike, middle, first), np.where(alike, found, from_)
            last, to = np.where(alike, last, middle), np.where(alike, to, found)
        edge = np.maximum(first + (last - first) * from_ / (from_ - to), SPECK).reshape(-1, 2)
        own = np.where(excess[:, :1] >= 0, 1.0, -1.0)
        vanishing = np.empty_like(excess)
        np.put_along_axis(vanishing, turn, np.concatenate([own, own - own / edge], axis=1), 1)
        values[cut] = vanishing
        return values, cut

    def excess(self, triangle: Int32Array, places: Float64Array) -> Float64Array:
        """Return by how much the alpha is above the cutoff, (m,), at (m, 2) places in triangles."""
        excess = np.empty(len(triangle))
        for picture, at in self._blocks(triangle):
            marks = weighted(self.marks[triangle[at]], places[at, None])[:, 0]
            excess[at] = picture.at(marks[:, :2]) * marks[:, 2] - self.cutoffs[triangle[at]]
        return excess

    def count(self, nodes: Int32Array, values: Float64Array) -> int:
        """Return how many pieces (m, 5) nodes with (m, 3) values become, all copies together."""
        own = np.array([0, 1, 2, 1])[(values >= 0).sum(axis=1)]
        return int(own @ np.diff(self.copies)[nodes[:, 0]])

    def pieces(self, nodes: Int32Array, values: Float64Array) -> Iterator[Float64Array]:
        """Yield the opaque pieces, (o, 3, 3), of (m, 5) nodes with (m, 3) values, of all copies."""
        opaque = (values >= 0).sum(axis=1)
        places = node_places(nodes)
        own, triangles = [places[opaque == 3]], [nodes[opaque == 3, 0]]
        cut = opaque % 3 > 0
        turn, shares = parted(values[cut])
        a, b, c = np.take_along_axis(places[cut], turn[..., None], 1).swapaxes(0, 1)
        ab, ac = a + shares[:, :1] * (b - a), a + shares[:, 1:] * (c - a)
        alone, (to_ab, to_ac) = opaque[cut] == 1, shares.T
        for corners, there, area in (
            ((a, ab, ac), alone, to_ab * to_ac),
            ((ab, b, c), ~alone, 1 - to_ab),
            ((ab, c, ac), ~alone, to_ab * (1 - to_ac)),
        ):
            chosen = there & (area > SPECK)
            own.append(np.stack(corners, axis=1)[chosen])
            triangles.append(nodes[cut, 0][chosen])

        places, triangle = np.concatenate(own), np.concatenate(triangles)
        counts = np.diff(self.copies)[triangle]
        piece = np.repeat(np.arange(len(triangle)), counts)
        copy = np.arange(len(piece)) + np.repeat(self.copies[triangle] - np.cumsum(counts) + counts, counts)
        for run in _runs(np.arange(len(piece)), _BLOCK):
            yield weighted(self.corners[copy[run]], places[piece[run]])

    def _blocks(self, triangle: Int32Array) -> Iterator[tuple[AlphaTexture, Int64Array]]:
        """Part numbers of triangles, (m,), into runs that show one picture: yield it and which they are."""
        for run in _runs(np.arange(len(triangle)), _BLOCK):
            shows = self.shows[triangle[run]]
            for number in np.unique(shows):
                yield self.pictures[number], run[shows == number]


def _runs(indices: Int64Array, length: int) -> Iterator[Int64Array]:
    """Yield indices, (m,), in runs of a length at most."""
    for start in range(0, len(indices), length):
        yield indices[start : start + length]


def _marks(alpha_mask: AlphaMask) -> Float64Array:
    """Return u, 1 - v and the factor at the corners of a cut-out's faces, (n, 3, 3)."""
    uvs = np.where(np.abs(alpha_mask.uvs) < _FARTHEST, alpha_mask.uvs, 0.0)
    return np.stack([uvs[..., 0], 1 - uvs[..., 1], alpha_mask.factors], axis=2)
