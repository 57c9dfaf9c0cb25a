"""From samples to the texels that look-ups on the surface read: the least-squares image.

The image is the one whose bilinear look-ups come nearest to the samples, in the sense of least squares.

A viewer does not read texels, it interpolates between four of them. The mean over a texel's square is a blurred value
there, and beside a chart's border that of a point off the texel's centre; the error of both is of first order in the
texel's size. Minimising the error of the look-up itself, weighted by the surface area of each sample, removes it, and
gives a value to each texel that a look-up on the surface can read, covered or not.
(Idea: L. Kavan, A. W. Bargteil, P.-P. Sloan, "Least Squares Vertex Baking", 2011, there for values at vertices.)
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aoprecalc.raster.layout import row_bands
from aoprecalc.texture_lookup import bilinear_taps
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int64Array, Texels, Wrap

# Weight of the initial image, relative to one sample; it decides where samples hardly reach a texel. From 0.02 to 1 the
# errors on two meshes were the same to 1%; a greater weight passes on less of the samples' noise.
_PRIOR = 1.0
_NO_PRIOR = np.float32(0)
_PRECISION = 1e-3  # of the solution: the residual over the first one
_MAX_STEPS = 40

_BAND = 1 << 15  # values of an image that are processed at a time, in the processor's cache
_OFFSET_TOLERANCE = 2.5e-7  # of the image's side: two roundings of a position in 32 bits

_TAPS = ((0, 0), (0, 1), (1, 0), (1, 1))  # (down, right): the texels of a look-up

# Neighbours (down, right) that a look-up can combine with a texel; the four others are their mirror images.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


class LeastSquaresImage:
    """Collects samples at positions in a texture, and fits an image to each of their channels.

    The normal equations are kept as images: the right-hand sides, the diagonal, and one for each of _NEIGHBOURS. These
    have a border of one texel, so that every texel has all neighbours.
    """

    def __init__(self, width: int, height: int, *, repeats: bool, channels: int = 1) -> None:
        """Start without samples; beyond an edge look-ups repeat if `repeats`, else they are clamped."""
        self._shape, self._repeats, self.channels = (height, width), repeats, channels
        self._bordered = bordered = (height + 2, width + 2)
        self._rhs: Float32Array = np.zeros((channels, *bordered), np.float32)
        self._diagonal: Float32Array = np.zeros(bordered, np.float32)
        self._off_diagonal = {neighbour: np.zeros(bordered, np.float32) for neighbour in _NEIGHBOURS}
        self._weight, self._count = 0.0, 0
        # Samples at one offset of their texels, before they are added: weights, and weights times values, of the
        # texels from `_low - 2 * _edge` on. Samples before `_low` have been added to all texels before `_low - _edge`.
        self._offset: tuple[float, float] | None = None
        self._at_offset: Float32Array = np.zeros((1 + channels, 0), np.float32)
        self._low = 0
        self._edge = bordered[1] + 1  # as far as a look-up reads, and the first texel that is not of the border

    def add_samples(
        self,
        positions: Float32Array,
        values: Float32Array,
        weights: Float64Array,
        offset: tuple[float, float] | None = None,
        means_of: int = 1,
    ) -> None:
        """Add samples: (m, 2) float32 positions in texels (right, down), values and (m,) weights >= 0.

        values   (m, channels), or (m,) where there is one channel
        means_of   how many samples each of them is the mean of: the prior weighs as much as one of these
        offset   at which most samples lie in the square of their texel: they are added by bands, which is faster
        """
        values, used = values.reshape(-1, self.channels), weights > 0
        if not used.all():
            positions, values, weights = positions[used], values[used], weights[used]
        self._weight, self._count = self._weight + float(weights.sum()), self._count + means_of * len(weights)
        if offset is not None:
            is_at, texel = self._find_at_offset(offset, positions)
            texel, weights_at = texel[is_at], weights[is_at]
            if len(texel):
                self._make_room(offset, int(texel.min()), int(texel.max()))
                texel -= self._low - 2 * self._edge
                for image, factors in zip(self._at_offset, (1.0, *values[is_at].T), strict=True):
                    np.add.at(image, texel, (weights_at * factors).astype(np.float32))
            positions, values, weights = positions[~is_at], values[~is_at], weights[~is_at]
        self._add_each(positions, values, weights)

    def sampled_texels(self) -> BoolArray:
        """Return which texels a look-up at any of the samples reads, (height, width) bool."""
        self._add_pending()
        mask: BoolArray = _inner(self._diagonal) > 0
        return mask

    def mean_images(self) -> Float32Array:
        """Return the means of the samples that read each texel, by their tap weights; 0 where none does.

        (channels, height, width) float32. Only samples that read the texel count, whatever else lies near it.
        """
        self._complete()
        # The taps of a look-up add up to 1, so this is the sum of weight * tap weight.
        ones, reads = np.ones((2, *self._bordered), np.float32)
        for rows in self._bands():
            self._multiply(ones, rows, reads)
        means: Float32Array = np.zeros((self.channels, *self._shape), np.float32)
        return np.divide(_inner(self._rhs), _inner(reads), out=means, where=_inner(reads) > 0)

    def solve(self, initial: Float32Array, channel: int = 0) -> Float32Array:
        """Return the (height, width) float32 image nearest to the samples, by conjugate gradients from `initial`.

        Texels that no look-up reads keep their initial values, as do all others where all samples agree with these.
        """
        if not self._count:
            return initial
        self._complete()
        prior, bands = np.float32(_PRIOR * self._weight / self._count), self._bands()
        direction, residual, change, response = (np.zeros(self._bordered, np.float32) for _ in range(4))
        _inner(direction)[...] = initial
        _repeat_edges(direction)

        def scaled_residual(rows: slice) -> Float32Array:
            scaled: Float32Array = np.divide(residual[rows], self._diagonal[rows] + prior, out=response[rows])
            return scaled

        power = 0.0
        for rows in bands:
            np.subtract(self._rhs[channel, rows], self._multiply(direction, rows, response), out=residual[rows])
            power += _dot(residual[rows], scaled_residual(rows))
        growth, least = np.float32(0), _PRECISION**2 * power
        for _ in range(_MAX_STEPS):
            if power <= least:
                break
            for rows in bands:
                direction[rows] *= growth
                direction[rows] += response[rows]  # the scaled residual
            _repeat_edges(direction)
            curvature = 0.0
            for rows in bands:
                curvature += _dot(direction[rows], self._multiply(direction, rows, response, prior))
            step = np.float32(power / curvature)
            before, power = power, 0.0
            for rows in bands:
                change[rows] += step * direction[rows]
                residual[rows] -= step * response[rows]
                power += _dot(residual[rows], scaled_residual(rows))
            growth = np.float32(power / before)
        solution = _inner(change)
        solution += initial
        return solution

    def _find_at_offset(self, offset: tuple[float, float], positions: Float32Array) -> tuple[BoolArray, Int64Array]:
        """Return which positions lie at the offset in their texel, off the image's edges, and the texels of all."""
        height, width = self._shape
        at_offset: BoolArray = np.ones(len(positions), bool)
        corners = []
        for position, expected, size in zip(positions.T, offset, (width, height), strict=True):
            corner = np.floor(position)
            at_offset &= (
                (np.abs(position - corner - np.float32(expected)) < _OFFSET_TOLERANCE * max(self._shape))
                & (corner > 0)
                & (corner < size - 1)
            )
            corners.append(corner.astype(np.int64))
        return at_offset, self._index(corners[1], corners[0])

    def _index(self, rows: Int64Array, columns: Int64Array) -> Int64Array:
        """Return the flat indices of texels in images with a border."""
        return (rows + 1) * self._bordered[1] + columns + 1

    def _make_room(self, offset: tuple[float, float], first: int, last: int) -> None:
        """Make room for samples at an offset of the texels first .. last.

        Texels come in bands of rows, see `row_bands`: once they are of a later band, all before it are added. A sample
        of an earlier band first adds all that waits. So that is a few bands where the texture is well covered.
        """
        height, width = self._shape
        columns, reach = self._bordered[1], 2 * self._edge
        band = row_bands(width, height)[0][1] * columns
        low = columns + (first - columns) // band * band
        high = columns + ((last - columns) // band + 1) * band
        if offset != self._offset or low < self._low:
            self._add_pending()
            self._offset, self._low = offset, low
        self._add_until(low - self._edge)
        waiting = self._at_offset[:, low - self._low :]
        missing = high + reach - (low - reach) - waiting.shape[1]
        self._low = low
        self._at_offset = waiting if missing <= 0 else np.pad(waiting, ((0, 0), (0, missing)))

    def _add_pending(self) -> None:
        """Add all samples at one offset that wait."""
        self._add_until(self._diagonal.size)
        self._offset, self._at_offset = None, self._at_offset[:, :0].copy()

    def _add_until(self, end: int) -> None:
        """Add samples at one offset to the texels before `end`: off the edges look-ups share one set of tap weights."""
        if self._offset is None:
            return
        weight, *weighted = self._at_offset
        right, down = self._offset[0] - 0.5, self._offset[1] - 0.5
        first = math.floor(down), math.floor(right)
        below, along = down - first[0], right - first[1]
        taps = {
            (lower, farther): np.float32((below if lower else 1 - below) * (along if farther else 1 - along))
            for lower, farther in _TAPS
        }
        columns, edge, begin = self._bordered[1], self._edge, self._low - 2 * self._edge
        end = min(end, self._diagonal.size - edge, begin + len(weight) - edge)
        for start in range(max(edge, begin + edge), end, _BAND):
            texels = slice(start, min(start + _BAND, end))
            for (lower, farther), tap in taps.items():
                if not tap:
                    continue
                shift = begin + (first[0] + lower) * columns + first[1] + farther
                source = slice(texels.start - shift, texels.stop - shift)
                for rhs, image in zip(self._rhs, weighted, strict=True):
                    rhs.reshape(-1)[texels] += tap * image[source]
                self._diagonal.reshape(-1)[texels] += tap * tap * weight[source]
                for (down_by, right_by), image in self._off_diagonal.items():
                    other = taps.get((lower + down_by, farther + right_by))
                    if other:
                        image.reshape(-1)[texels] += tap * other * weight[source]

    def _add_each(self, positions: Float32Array, values: Float32Array, weights: Float64Array) -> None:
        """Add samples at any positions."""
        taps = dict(self._taps(positions))
        for (down, right), (index, tap) in taps.items():
            texels, inverse = np.unique(index, return_inverse=True)
            weighted = weights * tap
            for rhs, channel in zip(self._rhs, values.T, strict=True):
                _scatter(rhs, texels, inverse, weighted * channel)
            _scatter(self._diagonal, texels, inverse, weighted * tap)
            for (down_by, right_by), image in self._off_diagonal.items():
                other = taps.get((down + down_by, right + right_by))
                if other is not None:
                    _scatter(image, texels, inverse, weighted * other[1])

    def _taps(self, positions: Float32Array) -> Iterator[tuple[tuple[int, int], tuple[Int64Array, Float32Array]]]:
        """Yield the four texels of the look-ups: which one (down, right), its indices and its tap weights."""
        height, width = self._shape
        right, down = positions.T
        wrap: Wrap = "repeat" if self._repeats else "clamp"
        if not self._repeats:  # a look-up beyond the outermost centres reads their texels alone
            right, down = np.clip(right, 0.5, width - 0.5), np.clip(down, 0.5, height - 0.5)
        *columns, along = bilinear_taps(right, width, wrap)
        *rows, below = bilinear_taps(down, height, wrap)
        for lower, farther in _TAPS:
            tap = (below if lower else 1 - below) * (along if farther else 1 - along)
            yield (lower, farther), (self._index(rows[lower], columns[farther]), tap)

    def _complete(self) -> None:
        """Make the normal equations complete: with pending samples, and at the edges."""
        self._add_pending()
        for image in self._off_diagonal.values():
            _repeat_edges(image)

    def _bands(self) -> list[slice]:
        """Cut the rows, without the border, into bands that stay in the processor's cache."""
        height, width = self._bordered
        count = max(1, _BAND // width)
        return [slice(row, min(row + count, height - 1)) for row in range(1, height - 1, count)]

    def _multiply(
        self, image: Float32Array, rows: slice, out: Float32Array, prior: np.float32 = _NO_PRIOR
    ) -> Float32Array:
        """Multiply rows of an image by the symmetric matrix of the normal equations, into `out`.

        The images have a border; that of the product is 0. The prior is added to the diagonal.
        """
        width = self._bordered[1]
        start, stop = rows.start * width + 1, rows.stop * width - 1  # the rows as one, from the first texel to the last
        factors, result = image.reshape(-1), out.reshape(-1)[start:stop]
        np.multiply(self._diagonal.reshape(-1)[start:stop] + prior, factors[start:stop], out=result)
        term = np.empty_like(result)
        for (down, right), plane in self._off_diagonal.items():
            shift, matrix = down * width + right, plane.reshape(-1)
            result += np.multiply(matrix[start:stop], factors[start + shift : stop + shift], out=term)
            before = slice(start - shift, stop - shift)
            result += np.multiply(matrix[before], factors[before], out=term)
        out[rows, 0] = out[rows, -1] = 0
        return out[rows]


def _scatter(image: Float32Array, texels: Int64Array, inverse: Int64Array, values: Float64Array) -> None:
    """Add each value to one of the texels, which are distinct."""
    image.reshape(-1)[texels] += np.bincount(inverse, values, minlength=len(texels)).astype(np.float32)


def _inner(images: Float32Array) -> Float32Array:
    """Return a view of images, (..., rows, columns), without their border."""
    return images[..., 1:-1, 1:-1]


def _repeat_edges(images: Float32Array) -> None:
    """Set the border of images to the opposite edges; look-ups that do not repeat have weights of 0 there."""
    images[..., 0, :], images[..., -1, :] = images[..., -2, :], images[..., 1, :]
    images[..., 0], images[..., -1] = images[..., -2], images[..., 1]


def _dot(a: Float32Array, b: Float32Array) -> float:
    """Sum of products, in an order that does not depend on the number of threads."""
    return float((a * b).sum(dtype=np.float64))


# From the image to the texture.


@dataclass(frozen=True, eq=False)
class ResolvedTexture:
    """The values of the texels that look-ups on the surface read, before padding.

    values   (height, width) float32 in [0, 1], 0 where not known
    known    (height, width) bool: texels that the surface covers or that a look-up on it reads
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    vectors  (height, width, 3) float32: the visibility vectors, 0 where not known; None where they are not wanted
    """

    values: Float32Array
    known: BoolArray
    valid: BoolArray
    vectors: Float32Array | None = None


def resolve_texels(
    texels: Texels,
    values: Float32Array,
    measured: BoolArray,
    reconstruction: LeastSquaresImage,
    vectors: Float32Array | None = None,
) -> ResolvedTexture:
    """Fit the texture to the samples, starting from the mean values of k texels.

    values           (k,) float32 in [0, 1], which count where `measured`, (k,) bool
    reconstruction   holds the samples, as occlusion (1 - AO value), and their visibility vectors as further channels
    vectors          (k, 3) float32; None where they are not wanted
    """
    valid: BoolArray = np.zeros((texels.height, texels.width), bool)
    valid.ravel()[texels.index[measured]] = True
    known = valid | reconstruction.sampled_texels()
    images = _initial_images(texels, values, measured, reconstruction, vectors)
    for channel, image in enumerate(images):
        images[channel] = reconstruction.solve(image, channel)
    occlusion, *components = images
    # As occlusion, which is exactly 0 on an open surface.
    fitted = np.where(known, np.clip(1 - occlusion, 0, 1), np.float32(0))
    if vectors is None:
        return ResolvedTexture(fitted, known, valid)
    return ResolvedTexture(
        fitted, known, valid, np.where(known[..., None], np.stack(components, axis=-1), np.float32(0))
    )


def _initial_images(
    texels: Texels,
    values: Float32Array,
    measured: BoolArray,
    reconstruction: LeastSquaresImage,
    vectors: Float32Array | None,
) -> Float32Array:
    """Return the images to start from, (channels, height, width) float32: means, over each texel where it has one."""
    images, index = reconstruction.mean_images(), texels.index[measured]
    means = (1 - values,) if vectors is None else (1 - values, *vectors.T)
    for image, mean in zip(images, means, strict=True):
        image.reshape(-1)[index] = mean[measured]
    return images


def lighter_of_sides(front: ResolvedTexture, back: ResolvedTexture) -> ResolvedTexture:
    """Return the greater value of two sides at every texel, with that side's vector."""
    vectors = front.vectors
    if front.vectors is not None and back.vectors is not None:
        lighter = (back.values > front.values) | (back.known & ~front.known)
        vectors = np.where(lighter[..., None], back.vectors, front.vectors)
    return ResolvedTexture(
        np.maximum(front.values, back.values), front.known | back.known, front.valid | back.valid, vectors
    )
