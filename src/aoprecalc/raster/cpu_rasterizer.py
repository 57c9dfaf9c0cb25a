"""Rasterizes the atlas into texture space without OpenGL, by the same rules as GLRasterizer, in NumPy."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.raster.layout import (
    BORDER_DEPTH,
    BORDER_OFFSET,
    CENTER,
    DEPTH_PER_TEXEL,
    INSET,
    MAX_MOVE,
    MAX_SHARE,
    Layout,
    Samples,
    clamp_barycentric,
    min_corner_weights,
    move_off_borders,
    order_in_blocks,
    row_bands,
)
from aoprecalc.raster.spans import edge_texels, expand_counts, snap_to_grid, triangle_spans
from aoprecalc.types import BoolArray, Float32Array, Int32Array, Int64Array, Texels

_DEPTH_STEPS = 2.0**24 - 1.0  # of the depth buffer of GLRasterizer
_INDEX_BITS = 32  # for the index of a border, below its depth
_INDEX = (1 << _INDEX_BITS) - 1
_EMPTY = np.iinfo(np.int64).max
_CHUNK = 1 << 15  # texels whose weights are computed at a time; measured: a quarter faster than with many more


class CPURasterizer:
    """A Rasterizer that needs no OpenGL.

    Works in single precision where the shaders do. It differs from GLRasterizer only where two borders are nearly
    equally near, and slightly along edges of triangles that reach beyond a band, which OpenGL clips there. Takes,
    beyond what it returns, 8 bytes a texel of a band and the chunks of `spans`.
    """

    def __init__(self, layout: Layout) -> None:
        """Prepare what does not depend on where texels are sampled."""
        self.layout = layout
        self._min_weights = min_corner_weights(layout)
        self._bands = row_bands(layout.width, layout.height)
        a, b, c = layout.triangles.transpose(1, 2, 0)
        # Rows of one number for each triangle: its first corner, its two sides from there, and twice its area.
        self._triangles = np.stack([*a, *(b - a), *(c - a), _cross(b - a, c - a)])
        start, end, apex = layout.borders.transpose(1, 2, 0)
        self._borders = np.stack([*start, *(end - start), *apex])
        self._edges = layout.borders[:, :2].astype(np.float64)

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        layout, index = self.layout, []
        for row, rows in self._bands:
            covered = self._counts(row, rows) > 0
            for border, line, column in edge_texels(self._edges, layout.width, row, rows):
                touches = self._nearest_point(border, _low_corners(line, column), CENTER)[2]
                covered[((line - row) * layout.width + column)[touches]] = True
            index.append((order_in_blocks(np.flatnonzero(covered), layout.width) + row * layout.width).astype(np.int32))
        return Texels(layout.width, layout.height, np.concatenate(index))

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        covered = twice = 0
        for row, rows in self._bands:
            counts = self._counts(row, rows)
            covered += int(np.count_nonzero(counts))
            twice += int(np.count_nonzero(counts > 1))
        return twice / covered if covered else 0.0

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return the surface under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        layout, index = self.layout, texels.index
        faces, weights = np.full(len(texels), -1, np.int32), np.zeros((len(texels), 3), np.float32)
        weights[:, 0] = 1
        corners = snap_to_grid(layout.triangles, sample_at)
        triangles = len(layout.faces)
        primitives = (
            (0, triangles, layout.faces, self._weights_in_triangle),
            (triangles, _EMPTY, layout.border_faces, self._weights_at_border),
        )
        for row, rows in self._bands:
            drawn = self._draw(corners, row, rows, sample_at)
            start, stop = row * layout.width, (row + rows) * layout.width
            band = np.flatnonzero((index >= start) & (index < stop))
            for chunk in np.split(band, range(_CHUNK, len(band), _CHUNK)):
                keys = drawn[index[chunk] - start]
                for low, high, face_of, interpolate in primitives:
                    chosen = (keys >= low) & (keys < high)
                    texel, primitive = chunk[chosen], keys[chosen] & _INDEX
                    faces[texel] = face_of[primitive]
                    square = _low_corners(*np.divmod(index[texel], layout.width))
                    weights[texel] = clamp_barycentric(interpolate(primitive, square, sample_at))
        return Samples(faces, move_off_borders(weights, faces, self._min_weights))

    def _counts(self, row: int, rows: int) -> NDArray[np.int32]:
        """Return the number of triangles over the centre of each texel of a band, (rows * width,)."""
        width = self.layout.width
        changes = np.zeros(rows * width + 1, np.int32)
        for _, first, length in triangle_spans(snap_to_grid(self.layout.triangles, CENTER), width, row, rows):
            # Measured: ten times faster than with a plain 1, whose type is not that of the array.
            np.add.at(changes, first, np.int32(1))
            np.subtract.at(changes, first + length, np.int32(1))
        return np.cumsum(changes[:-1], dtype=np.int32)

    def _draw(self, corners: Int64Array, row: int, rows: int, sample_at: tuple[float, float]) -> Int64Array:
        """Return the key of what is visible at each texel of a band, (rows * width,) int64; the least is in front.

        The key is the index of a triangle (the first drawn wins), or a border's depth above its index; _EMPTY where
        there is neither.
        """
        width = self.layout.width
        drawn = np.full(rows * width, _EMPTY)
        for triangle, first, length in triangle_spans(corners, width, row, rows):
            for span, step in expand_counts(length):
                np.minimum.at(drawn, first[span] + step, triangle[span])
        for border, line, column in edge_texels(self._edges, width, row, rows):
            _, distance, touches = self._nearest_point(border, _low_corners(line, column), sample_at)
            depth = ((BORDER_DEPTH + DEPTH_PER_TEXEL * distance[touches]) * _DEPTH_STEPS).astype(np.int64)
            keys = depth << _INDEX_BITS | border[touches]
            np.minimum.at(drawn, ((line - row) * width + column)[touches], keys)
        return drawn

    def _nearest_point(
        self, border: Int64Array, square: Float32Array, sample_at: tuple[float, float]
    ) -> tuple[Float32Array, Float32Array, BoolArray]:
        """Find the point of each border, within the square of a texel, that is nearest to the sample: border.frag.glsl.

        border   (n,) indices; square: (2, n) the low corners of the squares
        Returns, (n,) each, its position as a share of the border's length, its distance from the sample in texels, and
        whether the border touches the square at all; if not, the others mean nothing.
        """
        starts, alongs = self._borders[:2, border], self._borders[2:4, border]
        enter, leave = np.zeros(len(border), np.float32), np.ones(len(border), np.float32)
        touches = np.ones(len(border), bool)
        for start, along, low, high in zip(starts, alongs, square + INSET, square + (1 - INSET), strict=True):
            parallel = np.abs(along) < 1e-9
            touches &= ~parallel | ((start >= low) & (start <= high))
            speed = np.where(parallel, np.float32(1), along)
            cuts = (low - start) / speed, (high - start) / speed
            enter = np.where(parallel, enter, np.maximum(enter, np.minimum(*cuts)))
            leave = np.where(parallel, leave, np.minimum(leave, np.maximum(*cuts)))
        target = square + np.asarray(sample_at, np.float32)[:, None]
        nearest = _dot(target - starts, alongs) / np.maximum(_dot(alongs, alongs), 1e-20)
        share: Float32Array = np.clip(nearest, enter, leave)
        return share, _length(target - (starts + share * alongs)), touches & (enter <= leave)

    def _weights_in_triangle(
        self, triangle: Int64Array, square: Float32Array, sample_at: tuple[float, float]
    ) -> Float32Array:
        """Return the weights, (2, n), of the second and third corner of triangles at samples: triangle.frag.glsl."""
        start, to_b, to_c, (whole,) = np.split(self._triangles[:, triangle], [2, 4, 6])
        target = square + np.asarray(sample_at, np.float32)[:, None] - start
        whole[whole == 0] = 1
        weights: Float32Array = np.stack([_cross(target, to_c), _cross(to_b, target)]) / whole
        return weights

    def _weights_at_border(
        self, border: Int64Array, square: Float32Array, sample_at: tuple[float, float]
    ) -> Float32Array:
        """Return the weights, (2, n), of the second and third corner of the borders' faces at the borders' samples."""
        along_share = self._nearest_point(border, square, sample_at)[0]
        start, along, apex = np.split(self._borders[:, border], 3)
        inward_share = _inward_share(along, apex - (start + along_share * along))
        weights = np.tile(inward_share, (3, 1))
        corner, each = self.layout.border_corners[border], np.arange(len(border))
        weights[corner, each] = (1 - inward_share) * (1 - along_share)
        weights[(corner + 1) % 3, each] = (1 - inward_share) * along_share
        return weights[1:]


def _inward_share(along: Float32Array, inward: Float32Array) -> Float32Array:
    """Return how far a border's sample moves into the face, as a share of the way to its apex: border.frag.glsl.

    along    (2, n) the border, in texels
    inward   (2, n) from the nearest point on the border to the third corner of its face, in texels
    """
    height = np.abs(_cross(along, inward)) / np.maximum(_length(along), 1e-9)
    by_height = BORDER_OFFSET / np.maximum(height, 1e-9)
    by_length = MAX_MOVE / np.maximum(_length(inward), 1e-9)
    share: Float32Array = np.minimum(MAX_SHARE, np.minimum(by_height, by_length))
    return share


def _low_corners(row: Int32Array | Int64Array, column: Int32Array | Int64Array) -> Float32Array:
    """Return the low corners, (2, n), of the squares of texels."""
    return np.stack([column, row]).astype(np.float32)


def _cross(u: Float32Array, v: Float32Array) -> Float32Array:
    product: Float32Array = u[0] * v[1] - u[1] * v[0]
    return product


def _dot(u: Float32Array, v: Float32Array) -> Float32Array:
    product: Float32Array = u[0] * v[0] + u[1] * v[1]
    return product


def _length(u: Float32Array) -> Float32Array:
    length: Float32Array = np.sqrt(_dot(u, u))
    return length
