"""Triangles with an alpha mask, quartered again and again, and straight cuts through them.

A node is one triangle of such a subdivision, a row of five int32: the index of its root triangle, how often its sides
were halved, i, j, and 1 or -1. In units of its own sides along 0-1 and 0-2 of the root its corners are at (i, j),
(i +- 1, j) and (i, j +- 1).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.texture_lookup import AlphaTexture
from aoprecalc.types import AlphaMask, BoolArray, Float64Array, Int32Array, Int64Array, Scene

EPSILON = 1e-12  # a length or an area that counts as none
UNKNOWN, CLEAR, OPAQUE = 0, -1, 1  # what is certain of a node

_CORNERS = np.array([(0, 0), (1, 0), (0, 1)], np.int32)
_QUARTERS = np.array([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, -1)], np.int32)

_MIN_PIECE = 1 / 2048  # of the diagonal of what receives, or its distance: sides of pieces are not halved below it
_MIN_NODE = 1 / 2  # texels: sides of the smallest nodes; an edge drawn by single texels needs both their halves
_CHUNK = 1 << 15  # nodes processed at a time, which fit into the processor's cache
_MAX_UV = 1e9  # UVs beyond it, or not finite, are a fault of the file that must not stop the bake: they become (0, 0)


def quarter_nodes(nodes: Int32Array) -> Int32Array:
    """Return the four quarters of each of (m, 5) nodes one after the other, (4 m, 5)."""
    quarters = np.repeat(nodes, 4, axis=0).reshape(-1, 4, 5)
    side = nodes[:, None, 4:]
    quarters[:, :, 1] += 1
    quarters[:, :, 2:4] = 2 * nodes[:, None, 2:4] + side * _QUARTERS[:, :2]
    quarters[:, :, 4:] *= _QUARTERS[:, 2:]
    rows: Int32Array = quarters.reshape(-1, 5)
    return rows


def quarter_values(values: Float64Array) -> Float64Array:
    """Return linear values at the corners of quarters, (m, 4, 3), from those at the corners of the nodes, (m, 3)."""
    a, b, c = values.T
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, bc, ca, ab], axis=1).reshape(-1, 4, 3)


def cut_triangles(values: Float64Array) -> tuple[Int64Array, Float64Array]:
    """Cut triangles where linear values at their corners, (..., 3), of both signs, are zero.

    Returns the corners in cyclic order, (..., 3), from the one that the cut separates from the two others, and where it
    crosses the sides from that corner to the others, (..., 2), as shares of their lengths.
    """
    opaque = values >= 0
    single = np.where(opaque.sum(axis=-1) == 1, opaque.argmax(axis=-1), opaque.argmin(axis=-1))
    order: Int64Array = (single[..., None] + np.arange(3)) % 3
    ordered = np.take_along_axis(values, order, axis=-1)
    return order, ordered[..., :1] / (ordered[..., :1] - ordered[..., 1:])


def opaque_share(values: Float64Array) -> Float64Array:
    """Return the share of a triangle, (...), where linear values at its corners, (..., 3), are not negative."""
    count = (values >= 0).sum(axis=-1)
    shares: Float64Array = count / 3
    cut = count % 3 > 0
    corner = cut_triangles(values[cut])[1].prod(axis=-1)
    shares[cut] = np.where(count[cut] == 1, corner, 1 - corner)
    return shares


def shift_to_share(values: Float64Array, shares: Float64Array) -> Float64Array:
    """Shift linear values at the corners of triangles, (m, 3), so that they are not negative in (m,) shares of them."""
    values = np.where(np.ptp(values, axis=1, keepdims=True) > 0, values, (-1.0, 0.0, 1.0))
    low, middle, high = np.sort(values, axis=1).T
    from_high = high - np.sqrt(shares * (high - middle) * (high - low))
    from_low = low + np.sqrt((1 - shares) * (middle - low) * (high - low))
    level = np.where(shares * (high - low) <= high - middle, from_high, from_low)[:, None]
    uncut = np.where(shares > 0, 1.0, -1.0)[:, None]
    return np.where(((shares > 0) & (shares < 1))[:, None], values - level, uncut)


def node_corners(nodes: Int32Array) -> Float64Array:
    """Return the corners of (m, 5) nodes, (m, 3, 2): the weights of the corners 1 and 2 of their root triangles."""
    corners = nodes[:, None, 2:4] + nodes[:, None, 4:] * _CORNERS
    weights: Float64Array = np.ldexp(corners.astype(np.float64), -nodes[:, None, 1:2])
    return weights


def interpolate(corners: Float64Array, weights: Float64Array) -> Float64Array:
    """Interpolate values at corners, (m, 3, x), by weights of the corners 1 and 2, (m, k, 2); returns (m, k, x)."""
    a, b, c = (corners[:, None, k] for k in range(3))
    of_b, of_c = weights[..., :1], weights[..., 1:]
    return (1 - of_b - of_c) * a + of_b * b + of_c * c


# The centres of a triangle's sixteenths: weights of the corners 1 and 2, (16, 2), and of all three, (16, 3).
CENTRES = node_corners(quarter_nodes(quarter_nodes(np.array([(0, 0, 0, 0, 1)], np.int32)))).mean(axis=1)
CENTRE_WEIGHTS = interpolate(np.eye(3)[None], CENTRES[None])[0]


@dataclass(frozen=True, eq=False)
class MaskedTriangles:
    """The c occluding faces with an alpha mask. They are copies of n distinct root triangles.

    attributes   (n, 3, 3) float64: u, 1 - v and the alpha factor at each corner
    cutoffs      (n,) float64: there is a hole where alpha times factor is less
    textures     the distinct alpha textures
    texture_of   (n,): the texture of each
    halvings     (n,): how often its sides are halved until all are short in texels
    max_cuts     (n,): how often its sides may be halved before the longest is too short for a piece
    copy_starts  (n + 1,): where the copies of each begin in corners, and their end
    corners      (c, 3, 3) float64
    faces        (c,): the face of the scene that each is
    """

    attributes: Float64Array
    cutoffs: Float64Array
    textures: tuple[AlphaTexture, ...]
    texture_of: Int64Array
    halvings: Int64Array
    max_cuts: Int64Array
    copy_starts: Int64Array
    corners: Float64Array
    faces: Int64Array

    @classmethod
    def from_scene(cls, scene: Scene) -> Self | None:
        """Collect them from a scene; None if there are none."""
        parts = [part for part in scene.parts if part.occludes and part.stop > part.start]
        masked = [(part.faces, part.material.alpha_mask) for part in parts if part.material.alpha_mask is not None]
        if not masked:
            return None
        # Materials share images, and parts share materials.
        keys = [(id(mask.alpha), mask.wraps) for _, mask in masked]
        distinct = {key: mask for key, (_, mask) in zip(keys, masked, strict=True)}
        textures = tuple(AlphaTexture.from_image(mask.alpha, mask.wraps) for mask in distinct.values())
        numbers = {key: number for number, key in enumerate(distinct)}
        counts = [faces.stop - faces.start for faces, _ in masked]
        texture_of = np.repeat([numbers[key] for key in keys], counts)
        cutoffs = np.repeat([mask.cutoff for _, mask in masked], counts)
        attributes = np.concatenate([_attributes(mask) for _, mask in masked])
        face_of = np.concatenate([np.arange(faces.start, faces.stop) for faces, _ in masked])
        corners = scene.positions[scene.faces[face_of]]

        min_sides = _MIN_PIECE * _seen_size(scene, corners)
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        ratios = np.ones(len(corners))
        ratios = np.maximum(np.divide(longest, min_sides, out=ratios, where=min_sides > 0), EPSILON)
        max_cuts = np.floor(np.log2(ratios))
        rows = np.column_stack([texture_of, cutoffs, max_cuts, attributes.reshape(-1, 9)])
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        by_root = np.argsort(inverse.ravel(), kind="stable")
        sizes = np.array([texture.varying_size for texture in textures])[texture_of[first]]
        longest_in_texels = (np.ptp(attributes[first, :, :2], axis=1) * sizes).max(axis=1)
        return cls(
            attributes=attributes[first],
            cutoffs=cutoffs[first],
            textures=textures,
            texture_of=texture_of[first],
            halvings=np.ceil(np.log2((longest_in_texels / _MIN_NODE).clip(1, 1 << 30))).astype(np.int64),
            max_cuts=max_cuts[first].astype(np.int64),
            copy_starts=np.cumsum([0, *np.bincount(inverse.ravel())]),
            corners=corners[by_root],
            faces=face_of[by_root],
        )

    def classify(self, nodes: Int32Array) -> NDArray[np.int8]:
        """Return which of (m, 5) nodes are certainly OPAQUE or CLEAR, else UNKNOWN, (m,) int8."""
        states = np.full(len(nodes), UNKNOWN, np.int8)
        for texture, chunk in self._chunks(nodes[:, 0]):
            triangle = nodes[chunk, 0]
            attributes = interpolate(self.attributes[triangle], node_corners(nodes[chunk]))
            low, high = attributes.min(axis=1), attributes.max(axis=1)
            alpha = texture.bounds_in(low[:, :2], high[:, :2])
            products = np.concatenate([alpha * low[:, 2:], alpha * high[:, 2:]], axis=1)
            states[chunk[products.min(axis=1) >= self.cutoffs[triangle]]] = OPAQUE
            states[chunk[products.max(axis=1) < self.cutoffs[triangle]]] = CLEAR
        return states

    def cuts(self, nodes: Int32Array) -> Float64Array:
        """Return linear values at the corners of (m, 5) nodes, (m, 3), not negative where a straight cut is opaque.

        In nodes with sides of many texels, the edge of a hole need not meet a side: samples tell slope and share there.
        """
        values = np.empty((len(nodes), 3))
        coarse = self.halvings[nodes[:, 0]] > nodes[:, 1]
        values[~coarse] = self.edges(nodes[~coarse], 1)[0]
        for chunk in _chunks(np.flatnonzero(coarse), _CHUNK // len(CENTRES)):
            weights = interpolate(node_corners(nodes[chunk]), CENTRES[None])
            excess = self.excess(np.repeat(nodes[chunk, 0], len(CENTRES)), weights.reshape(-1, 2))
            opaque = (excess >= 0).reshape(len(chunk), -1)
            # The least-squares slope of what is 1 at opaque samples and 0 at clear ones, up to a factor.
            values[chunk] = shift_to_share(opaque @ CENTRE_WEIGHTS, opaque.mean(axis=1))
        return values

    def edges(self, nodes: Int32Array, halvings: int) -> tuple[Float64Array, BoolArray]:
        """Return linear values at the corners of (m, 5) nodes, (m, 3), zero where the edge of a hole meets two sides.

        halvings   of the stretch of a side with the edge on it, before the edge is found by linear interpolation
        Also return which nodes have such an edge, (m,) bool; the three values of the others are all 1, or all -1.
        """
        corners = node_corners(nodes)
        excess = self.excess(np.repeat(nodes[:, 0], 3), corners.reshape(-1, 2)).reshape(-1, 3)
        # In a chessboard of texels the excess is 0 all around a triangle: its centre decides.
        undecided = (excess == 0).any(axis=1)
        centres = self.excess(nodes[undecided, 0], corners[undecided].mean(axis=1))
        excess[undecided] = np.where(excess[undecided] == 0, EPSILON * centres[:, None], excess[undecided])
        values = np.where(excess >= 0, 1.0, -1.0)
        cut: BoolArray = np.ptp(values, axis=1) > 0
        order, _ = cut_triangles(values[cut])
        corners = np.take_along_axis(corners[cut], order[..., None], 1)
        excess = np.take_along_axis(excess[cut], order, 1)

        # Bisect both sides at the separated corner.
        triangle = np.repeat(nodes[cut, 0], 2)
        begin, end = np.repeat(corners[:, 0], 2, axis=0), corners[:, 1:].reshape(-1, 2)
        from_, to = np.repeat(excess[:, 0], 2), excess[:, 1:].ravel()
        first, last = np.zeros(len(triangle)), np.ones(len(triangle))
        for _ in range(halvings):
            middle = (first + last) / 2
            at_middle = self.excess(triangle, begin + middle[:, None] * (end - begin))
            same_sign = (at_middle >= 0) == (from_ >= 0)
            first, from_ = np.where(same_sign, middle, first), np.where(same_sign, at_middle, from_)
            last, to = np.where(same_sign, last, middle), np.where(same_sign, to, at_middle)
        edge = np.maximum(first + (last - first) * from_ / (from_ - to), EPSILON).reshape(-1, 2)
        own = np.where(excess[:, :1] >= 0, 1.0, -1.0)
        zero_at_edge = np.empty_like(excess)
        np.put_along_axis(zero_at_edge, order, np.concatenate([own, own - own / edge], axis=1), 1)
        values[cut] = zero_at_edge
        return values, cut

    def excess(self, triangle: Int32Array, weights: Float64Array) -> Float64Array:
        """Return how much the alpha is above the cutoff, (m,), at points of root triangles given by (m, 2) weights."""
        excess = np.empty(len(triangle))
        for texture, chunk in self._chunks(triangle):
            attributes = interpolate(self.attributes[triangle[chunk]], weights[chunk, None])[:, 0]
            excess[chunk] = texture.lookup(attributes[:, :2]) * attributes[:, 2] - self.cutoffs[triangle[chunk]]
        return excess

    def count_pieces(self, nodes: Int32Array, values: Float64Array) -> int:
        """Return how many pieces (m, 5) nodes with (m, 3) values become, over all copies."""
        each = np.array([0, 1, 2, 1])[(values >= 0).sum(axis=1)]
        return int(each @ np.diff(self.copy_starts)[nodes[:, 0]])

    def pieces(self, nodes: Int32Array, values: Float64Array) -> Iterator[tuple[Float64Array, Int64Array]]:
        """Yield the opaque pieces of (m, 5) nodes with (m, 3) values, for all copies: (o, 3, 3) corners, (o,) faces."""
        opaque = (values >= 0).sum(axis=1)
        corners = node_corners(nodes)
        weights, triangles = [corners[opaque == 3]], [nodes[opaque == 3, 0]]
        cut = opaque % 3 > 0
        order, shares = cut_triangles(values[cut])
        a, b, c = np.take_along_axis(corners[cut], order[..., None], 1).swapaxes(0, 1)
        ab, ac = a + shares[:, :1] * (b - a), a + shares[:, 1:] * (c - a)
        single, (to_ab, to_ac) = opaque[cut] == 1, shares.T
        for piece, exists, area in (
            ((a, ab, ac), single, to_ab * to_ac),
            ((ab, b, c), ~single, 1 - to_ab),
            ((ab, c, ac), ~single, to_ab * (1 - to_ac)),
        ):
            chosen = exists & (area > EPSILON)
            weights.append(np.stack(piece, axis=1)[chosen])
            triangles.append(nodes[cut, 0][chosen])

        piece_weights, triangle = np.concatenate(weights), np.concatenate(triangles)
        counts = np.diff(self.copy_starts)[triangle]
        index = np.repeat(np.arange(len(triangle)), counts)
        copy = np.arange(len(index)) + np.repeat(self.copy_starts[triangle] - np.cumsum(counts) + counts, counts)
        for chunk in _chunks(np.arange(len(index)), _CHUNK):
            yield interpolate(self.corners[copy[chunk]], piece_weights[index[chunk]]), self.faces[copy[chunk]]

    def roots_of_faces(self, count: int) -> Int32Array:
        """Return the root triangle of each of the `count` faces of the scene, (count,); -1 for those without a mask."""
        roots = np.full(count, -1, np.int32)
        roots[self.faces] = np.repeat(np.arange(len(self.attributes)), np.diff(self.copy_starts))
        return roots

    def _chunks(self, triangle: Int32Array) -> Iterator[tuple[AlphaTexture, Int64Array]]:
        """Group root triangles, (m,), into chunks with one texture; yield it and their positions in `triangle`."""
        for chunk in _chunks(np.arange(len(triangle)), _CHUNK):
            texture_of = self.texture_of[triangle[chunk]]
            for number in np.unique(texture_of):
                yield self.textures[number], chunk[texture_of == number]


def _chunks(indices: Int64Array, length: int) -> Iterator[Int64Array]:
    """Yield indices, (m,), in chunks of at most `length`."""
    for start in range(0, len(indices), length):
        yield indices[start : start + length]


def _seen_size(scene: Scene, corners: Float64Array) -> Float64Array:
    """Return how large what matters is at each of (k, 3, 3) triangles, (k,), in the scene's units.

    It is the diagonal of what receives or, if that is more, the distance from it, at most the diagonal of the scene.
    """
    receiving, active = (
        scene.corners[faces].reshape(-1, 3) for faces in (scene.receives, scene.receives | scene.occludes)
    )
    whole = float(np.linalg.norm(np.ptp(active, axis=0)))
    if not len(receiving):
        return np.full(len(corners), whole)
    low, high = receiving.min(axis=0), receiving.max(axis=0)
    away = np.linalg.norm(np.maximum(np.maximum(low - corners.max(axis=1), corners.min(axis=1) - high), 0), axis=1)
    sizes: Float64Array = np.minimum(np.maximum(np.linalg.norm(high - low), away), whole)
    return sizes


def _attributes(mask: AlphaMask) -> Float64Array:
    """Return u, 1 - v and the alpha factor at the corners of a mask's faces, (n, 3, 3)."""
    uvs = np.where(np.abs(mask.uvs) < _MAX_UV, mask.uvs, 0.0)
    return np.stack([uvs[..., 0], 1 - uvs[..., 1], mask.factors], axis=2)
