"""Rasterizes the atlas into texture space without OpenGL, by the same rules as GLRasterizer, in NumPy.

The spans of triangles below it serve whatever rasterizes in NumPy.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from aoprecalc.raster.layout import (
    BORDER_DEPTH,
    BORDER_OFFSET,
    CENTER,
    DEPTH_PER_TEXEL,
    GRID,
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
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, Texels

_DEPTH_STEPS = 2.0**24 - 1.0  # of the depth buffer of GLRasterizer
_INDEX_BITS = 32  # for the index of a border, below its depth
_INDEX = (1 << _INDEX_BITS) - 1
_EMPTY = np.iinfo(np.int64).max
_CHUNK = 1 << 15  # texels whose weights are computed at a time; measured: a quarter faster than with many more
_SPAN_CHUNK = 1 << 16  # entries made at a time: bounds memory; measured: a fifth faster than with four times as many
_HALF = GRID // 2


class CPURasterizer:
    """A Rasterizer that needs no OpenGL.

    Works in single precision where the shaders do. It differs from GLRasterizer only where two borders are nearly
    equally near, and slightly along edges of triangles that reach beyond a band, which OpenGL clips there. Takes,
    beyond what it returns, 8 bytes a texel of a band and the chunks of spans.
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
            start, stop = row * layout.width, (row + rows) * layout.width
            band = np.flatnonzero((index >= start) & (index < stop))
            if not len(band):
                continue
            drawn = self._draw(corners, row, rows, sample_at)
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
        return _count_triangles(snap_to_grid(self.layout.triangles, CENTER), self.layout.width, row, rows)

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


# Texels under triangles and along edges, vectorised over both, exact where rasterizers are.


def expand_counts(counts: Int64Array) -> Iterator[tuple[Int64Array, Int64Array]]:
    """Enumerate 0 .. counts[i] - 1 for each i in order; yields i and the number, (n,) each, in chunks."""
    ends = np.cumsum(counts)
    start, before = 0, 0
    while start < len(counts):
        stop = max(start + 1, int(np.searchsorted(ends, before + _SPAN_CHUNK, side="right")))
        part = counts[start:stop]
        owner = np.repeat(np.arange(start, stop), part)
        if len(owner):
            yield owner, np.arange(len(owner)) - np.repeat(ends[start:stop] - part - before, part)
        start, before = stop, int(ends[stop - 1])


def snap_to_grid(triangles: Float32Array, sample_at: tuple[float, float]) -> Int64Array:
    """Shift triangles, (m, 3, 2) in texels, so that samples fall on texel centres, and snap them to the grid.

    Returns (m, 3, 2) int64 in steps of the grid, the corners of each sorted from top to bottom. Computed in single
    precision, as the shaders do, so that the corners are rounded to the same steps.
    """
    moved = triangles + np.float32(0.5) - np.asarray(sample_at, np.float32)
    corners = np.rint(moved * np.float32(GRID)).astype(np.int64)
    return np.take_along_axis(corners, np.argsort(corners[..., 1], axis=1)[..., None], axis=1)


def triangle_spans(
    corners: Int64Array, width: int, row: int, rows: int
) -> Iterator[tuple[Int64Array, Int64Array, Int64Array]]:
    """Yield the spans of texels whose centres lie in triangles, within rows row..row + rows, in drawing order.

    corners   as from `snap_to_grid`
    Yields, (s,) int64 each, the triangle, the first texel counted from the start of `row`, and the length.

    A centre on an edge is in the triangle if that lies below or to the right of it (the top-left rule), so that it
    belongs to one of the two triangles that share the edge. Integers make that exact.
    """
    top, bottom = (np.clip(_first_center(corners[:, corner, 1]), row, row + rows) for corner in (0, 2))
    for triangle, step in expand_counts(bottom - top):
        line = top[triangle] + step
        corner = np.ascontiguousarray(corners[triangle].transpose(1, 2, 0))
        # One end of the span is on the edge from top to bottom, the other on one of the two other edges.
        lower = corner[1, 1] <= line * GRID + _HALF
        first = _first_column(corner[0], corner[2], line)
        second = _first_column(np.where(lower, corner[1], corner[0]), np.where(lower, corner[2], corner[1]), line)
        left, right = (np.clip(pick(first, second), 0, width) for pick in (np.minimum, np.maximum))
        some = np.flatnonzero(right > left)
        yield triangle[some], ((line - row) * width + left)[some], (right - left)[some]


def _count_triangles(corners: Int64Array, width: int, row: int, rows: int) -> NDArray[np.int32]:
    """Return the number of triangles over the centre of each texel of a band, (rows * width,)."""
    changes = np.zeros(rows * width + 1, np.int32)
    for _, first, length in triangle_spans(corners, width, row, rows):
        # Measured: ten times faster than with a plain 1, whose type is not that of the array.
        np.add.at(changes, first, np.int32(1))
        np.subtract.at(changes, first + length, np.int32(1))
    return np.cumsum(changes[:-1], dtype=np.int32)


def overlapping_triangles(triangles: Float32Array, width: int, height: int) -> BoolArray:
    """Return which triangles, (m, 3, 2) in texels, share the centre of a texel with another one, (m,) bool."""
    corners, overlapping = snap_to_grid(triangles, CENTER), np.zeros(len(triangles), bool)
    for row, rows in row_bands(width, height):
        twice = np.concatenate([[0], np.cumsum(_count_triangles(corners, width, row, rows) > 1)])
        if twice[-1]:
            for triangle, first, length in triangle_spans(corners, width, row, rows):
                overlapping[triangle[twice[first + length] > twice[first]]] = True
    return overlapping


def edge_texels(
    edges: Float64Array, width: int, row: int, rows: int
) -> Iterator[tuple[Int64Array, Int64Array, Int64Array]]:
    """Yield the texels whose squares edges touch, within rows row..row + rows, in drawing order.

    edges   (e, 2, 2): from and to, in texels
    Yields, (n,) int64 each, the edge, and the row and column of the texel.
    """
    (start_x, start_y), (along_x, along_y) = edges[:, 0].T, (edges[:, 1] - edges[:, 0]).T
    ends_y = edges[..., 1]
    top = np.clip(np.ceil(ends_y.min(axis=1) - 1), row, row + rows).astype(np.int64)
    bottom = np.clip(np.floor(ends_y.max(axis=1)) + 1, row, row + rows).astype(np.int64)
    level = along_y == 0
    for edge, step in expand_counts(bottom - top):
        line = top[edge] + step
        # The part of the edge in this row of texels, as shares of its length.
        flat, slope = level[edge], np.where(level, 1.0, along_y)[edge]
        enter, leave = (np.clip((line + side - start_y[edge]) / slope, 0, 1) for side in (0, 1))
        ends_x = np.stack([start_x[edge] + along_x[edge] * np.where(flat, *ends) for ends in ((0, enter), (1, leave))])
        first = np.clip(np.ceil(ends_x.min(axis=0) - 1), 0, width).astype(np.int64)
        stop = np.clip(np.floor(ends_x.max(axis=0)) + 1, 0, width).astype(np.int64)
        for part, column in expand_counts(np.maximum(stop - first, 0)):
            yield edge[part], line[part], first[part] + column


def _first_center(coordinates: Int64Array) -> Int64Array:
    """Return the first texel whose centre is at or beyond each coordinate, in steps of the grid."""
    first: Int64Array = -((_HALF - coordinates) // GRID)
    return first


def _first_column(start: Int64Array, end: Int64Array, row: Int64Array) -> Int64Array:
    """Return the first column whose centre is on or right of the edge from start to end, (2, s), at a row's centres.

    The end lies below the start, in steps of the grid; the products stay below 2^62 for coordinates below 2^23 texels.
    """
    run, drop = end - start
    across = (start[0] - _HALF) * drop + (row * GRID + _HALF - start[1]) * run
    first: Int64Array = -(-across // (GRID * drop))
    return first
