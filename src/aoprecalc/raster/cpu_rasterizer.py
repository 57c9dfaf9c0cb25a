"""Draws the atlas into texture space without OpenGL: the same rules as `raster`, in NumPy."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.raster.layout import Layout, min_corner_weights, move_off_borders
from aoprecalc.raster.samples import (
    ASIDE,
    BORDER_DEPTH,
    CENTER,
    DEEPEST,
    DISTANCE_DEPTH,
    INSET,
    INWARD,
    Samples,
    clamp_barycentric,
    order_in_blocks,
    row_bands,
)
from aoprecalc.raster.spans import edge_texels, expand_counts, snap_to_grid, triangle_spans
from aoprecalc.types import BoolArray, Float32Array, Int32Array, Int64Array, Texels

_DEPTH_STEPS = 2.0**24 - 1.0  # of the depth buffer that `raster` draws with
_NUMBER_BITS = 32  # what the number of a border takes, below its depth
_NUMBER = (1 << _NUMBER_BITS) - 1
_NOTHING = np.iinfo(np.int64).max
_PIECE = 1 << 15  # texels whose weights are computed at a time; measured: a quarter faster than with many more


class CPURasterizer:
    """Finds what `GLRasterizer` finds, where no OpenGL is.

    Works in single precision where the shaders do. The two differ only where borders are as good as equally near, and
    by a hair along edges of triangles that reach beyond a band, which OpenGL cuts there. Takes, beyond what it returns,
    8 bytes a texel of a band and what `spans` makes at a time.
    """

    def __init__(self, layout: Layout) -> None:
        """Prepare what does not depend on where texels are sampled."""
        self.layout = layout
        self._least = min_corner_weights(layout)
        self._bands = row_bands(layout.width, layout.height)
        a, b, c = layout.triangles.transpose(1, 2, 0)
        # Rows of one number for each triangle: where it starts, its two sides from there, and twice its area.
        self._triangles = np.stack([*a, *(b - a), *(c - a), _cross(b - a, c - a)])
        start, end, apex = layout.borders.transpose(1, 2, 0)
        self._borders = np.stack([*start, *(end - start), *apex])
        self._edges = layout.borders[:, :2].astype(np.float64)

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        layout, found = self.layout, []
        for row, rows in self._bands:
            covered = self._counts(row, rows) > 0
            for border, at, column in edge_texels(self._edges, layout.width, row, rows):
                touched = self._meet(border, _low_corners(at, column), CENTER)[2]
                covered[((at - row) * layout.width + column)[touched]] = True
            found.append((order_in_blocks(np.flatnonzero(covered), layout.width) + row * layout.width).astype(np.int32))
        return Texels(layout.width, layout.height, np.concatenate(found))

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        covered = twice = 0
        for row, rows in self._bands:
            counts = self._counts(row, rows)
            covered += int(np.count_nonzero(counts))
            twice += int(np.count_nonzero(counts > 1))
        return twice / covered if covered else 0.0

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return what lies under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        layout, index = self.layout, texels.index
        faces, weights = np.full(len(texels), -1, np.int32), np.zeros((len(texels), 3), np.float32)
        weights[:, 0] = 1
        corners = snap_to_grid(layout.triangles, sample_at)
        kinds = (
            (0, len(layout.faces), layout.faces, self._weights_inside),
            (len(layout.faces), _NOTHING, layout.border_faces, self._weights_beside),
        )
        for row, rows in self._bands:
            drawn = self._draw(corners, row, rows, sample_at)
            start, stop = row * layout.width, (row + rows) * layout.width
            band = np.flatnonzero((index >= start) & (index < stop))
            for piece in np.split(band, range(_PIECE, len(band), _PIECE)):
                seen = drawn[index[piece] - start]
                for least, beyond, of, weigh in kinds:
                    of_kind = (seen >= least) & (seen < beyond)
                    texel, number = piece[of_kind], seen[of_kind] & _NUMBER
                    faces[texel] = of[number]
                    square = _low_corners(*np.divmod(index[texel], layout.width))
                    weights[texel] = clamp_barycentric(weigh(number, square, sample_at))
        return Samples(faces, move_off_borders(weights, faces, self._least))

    def _counts(self, row: int, rows: int) -> NDArray[np.int32]:
        """How many triangles lie over the centre of each texel of a band, (rows * width,)."""
        width = self.layout.width
        changes = np.zeros(rows * width + 1, np.int32)
        for _, first, length in triangle_spans(snap_to_grid(self.layout.triangles, CENTER), width, row, rows):
            # Measured: ten times faster than to add a plain 1, which is not of the array's own type.
            np.add.at(changes, first, np.int32(1))
            np.subtract.at(changes, first + length, np.int32(1))
        return np.cumsum(changes[:-1], dtype=np.int32)

    def _draw(self, corners: Int64Array, row: int, rows: int, sample_at: tuple[float, float]) -> Int64Array:
        """What is seen at each texel of a band, (rows * width,) int64: least is in front, and first drawn on ties.

        The number of a triangle, or that of a border below its depth; _NOTHING where there is neither.
        """
        width = self.layout.width
        drawn = np.full(rows * width, _NOTHING)
        for triangle, first, length in triangle_spans(corners, width, row, rows):
            for span, step in expand_counts(length):
                np.minimum.at(drawn, first[span] + step, triangle[span])
        for border, at, column in edge_texels(self._edges, width, row, rows):
            _, distance, touched = self._meet(border, _low_corners(at, column), sample_at)
            depth = ((BORDER_DEPTH + DISTANCE_DEPTH * distance[touched]) * _DEPTH_STEPS).astype(np.int64)
            seen = depth << _NUMBER_BITS | border[touched]
            np.minimum.at(drawn, ((at - row) * width + column)[touched], seen)
        return drawn

    def _meet(
        self, border: Int64Array, square: Float32Array, sample_at: tuple[float, float]
    ) -> tuple[Float32Array, Float32Array, BoolArray]:
        """Where (n,) borders, within squares with low corners (2, n), are nearest to samples: see border.frag.glsl.

        Returns, (n,) each, the place as a share of the border's length, its distance from the sample in texels, and
        whether the border touches the square at all; else the first two mean nothing.
        """
        starts, alongs = self._borders[:2, border], self._borders[2:4, border]
        enter, leave = np.zeros(len(border), np.float32), np.ones(len(border), np.float32)
        touched = np.ones(len(border), bool)
        for start, along, low, high in zip(starts, alongs, square + INSET, square + (1 - INSET), strict=True):
            still = np.abs(along) < 1e-9
            touched &= ~still | ((start >= low) & (start <= high))
            speed = np.where(still, np.float32(1), along)
            cuts = (low - start) / speed, (high - start) / speed
            enter = np.where(still, enter, np.maximum(enter, np.minimum(*cuts)))
            leave = np.where(still, leave, np.minimum(leave, np.maximum(*cuts)))
        wanted = square + np.asarray(sample_at, np.float32)[:, None]
        nearest = _dot(wanted - starts, alongs) / np.maximum(_dot(alongs, alongs), 1e-20)
        share: Float32Array = np.clip(nearest, enter, leave)
        return share, _length(wanted - (starts + share * alongs)), touched & (enter <= leave)

    def _weights_inside(
        self, triangle: Int64Array, square: Float32Array, sample_at: tuple[float, float]
    ) -> Float32Array:
        """The weights, (2, n), of the second and third corner of triangles at samples: see triangle.frag.glsl."""
        start, to_b, to_c, (whole,) = np.split(self._triangles[:, triangle], [2, 4, 6])
        wanted = square + np.asarray(sample_at, np.float32)[:, None] - start
        whole[whole == 0] = 1
        weights: Float32Array = np.stack([_cross(wanted, to_c), _cross(to_b, wanted)]) / whole
        return weights

    def _weights_beside(self, border: Int64Array, square: Float32Array, sample_at: tuple[float, float]) -> Float32Array:
        """The weights, (2, n), of the second and third corner of borders' faces at the borders' samples."""
        along_share = self._meet(border, square, sample_at)[0]
        start, along, apex = np.split(self._borders[:, border], 3)
        inward_share = _pulled_inward(along, apex - (start + along_share * along))
        weights = np.tile(inward_share, (3, 1))
        corner, each = self.layout.border_corners[border], np.arange(len(border))
        weights[corner, each] = (1 - inward_share) * (1 - along_share)
        weights[(corner + 1) % 3, each] = (1 - inward_share) * along_share
        return weights[1:]


def _pulled_inward(along: Float32Array, inward: Float32Array) -> Float32Array:
    """How far a border's sample moves from the border, as a share of the way to the third corner: see border.frag.glsl.

    along    (2, n) the border, in texels
    inward   (2, n) the way from the sample on the border to the third corner of the border's face, in texels
    """
    height = np.abs(_cross(along, inward)) / np.maximum(_length(along), 1e-9)
    by_height = INWARD / np.maximum(height, 1e-9)
    by_length = ASIDE / np.maximum(_length(inward), 1e-9)
    share: Float32Array = np.minimum(DEEPEST, np.minimum(by_height, by_length))
    return share


def _low_corners(row: Int32Array | Int64Array, column: Int32Array | Int64Array) -> Float32Array:
    """The low corners, (2, n), of the squares of texels."""
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
