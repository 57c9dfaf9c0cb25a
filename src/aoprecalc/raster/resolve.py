"""From samples to a whole texture: the least-squares image, padding around the charts, and a fill.

The image is the one whose bilinear look-ups come nearest to the samples, in the sense of least squares.

A viewer does not read texels, it interpolates between four of them. The mean over a texel's square is a blurred value
there, and beside a chart's border that of a point off the texel's centre; the error of both is of first order in the
texel's size. Minimising the error of the look-up itself, weighted by the surface area of each sample, removes it, and
gives a value to each texel that a look-up on the surface can read, covered or not.
(Idea: L. Kavan, A. W. Bargteil, P.-P. Sloan, "Least Squares Vertex Baking", 2011, there for values at vertices.)
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoprecalc.options import Fill
from aoprecalc.texture_lookup import bilinear_taps
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int64Array, Texels, Texture, Wrap

# Weight of the initial image, relative to one sample; it decides where samples hardly reach a texel. From 0.02 to 1 the
# errors on two meshes were the same to 1%; a greater weight passes on less of the samples' noise.
_PRIOR = 1.0
_PRECISION = 1e-3  # of the solution: the residual over the first one
_MAX_STEPS = 40

_Texel = TypeVar("_Texel", bound=np.generic)

_OFFSET_TOLERANCE = 2.5e-7  # of the image's side: two roundings of a position in 32 bits

_TAPS = ((0, 0), (0, 1), (1, 0), (1, 1))  # (down, right): the texels of a look-up

# Neighbours (down, right) that a look-up can combine with a texel; the four others are their mirror images.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


class LeastSquaresImage:
    """Collects samples at positions in a texture, and fits an image to each of their channels.

    The normal equations are kept as images: the right-hand sides, the diagonal, and one for each of _NEIGHBOURS.
    """

    def __init__(self, width: int, height: int, *, repeats: bool, channels: int = 1) -> None:
        """Start without samples; beyond an edge look-ups repeat if `repeats`, else they are clamped."""
        self._shape, self._repeats, self.channels = (height, width), repeats, channels
        self._rhs: Float32Array = np.zeros((channels, *self._shape), np.float32)
        self._diagonal: Float32Array = np.zeros(self._shape, np.float32)
        self._off_diagonal = {neighbour: np.zeros(self._shape, np.float32) for neighbour in _NEIGHBOURS}
        self._weight, self._count = 0.0, 0
        # Samples at one offset of their texels, before they are added: weights, and weights times values.
        self._offset: tuple[float, float] | None = None
        self._at_offset: Float32Array = np.zeros((0, *self._shape), np.float32)

    def add_samples(
        self,
        positions: Float32Array,
        values: Float32Array,
        weights: Float64Array,
        offset: tuple[float, float] | None = None,
    ) -> None:
        """Add samples: (m, 2) float32 positions in texels (right, down), values and (m,) weights >= 0.

        values   (m, channels), or (m,) where there is one channel
        offset   at which most samples lie in the square of their texel: all of these are added at once, which is faster
        """
        values, used = values.reshape(-1, self.channels), weights > 0
        if not used.all():
            positions, values, weights = positions[used], values[used], weights[used]
        self._weight, self._count = self._weight + float(weights.sum()), self._count + len(weights)
        if offset is not None:
            if offset != self._offset:
                self._add_pending()
                self._offset = offset
                self._at_offset = np.zeros((1 + self.channels, *self._shape), np.float32)
            is_at, texel = self._find_at_offset(offset, positions)
            texel, weights_at = texel[is_at], weights[is_at]
            for image, factors in zip(self._at_offset, (1.0, *values[is_at].T), strict=True):
                np.add.at(image.reshape(-1), texel, (weights_at * factors).astype(np.float32))
            positions, values, weights = positions[~is_at], values[~is_at], weights[~is_at]
        self._add_each(positions, values, weights)

    def sampled_texels(self) -> BoolArray:
        """Return which texels a look-up at any of the samples reads, (height, width) bool."""
        self._add_pending()
        mask: BoolArray = self._diagonal > 0
        return mask

    def mean_image(self, channel: int = 0) -> Float32Array:
        """Return the mean of the samples that read each texel, by their tap weights; 0 where none does.

        (height, width) float32. Only samples that read the texel count, whatever else lies near it.
        """
        self._add_pending()
        # The taps of a look-up add up to 1, so this is the sum of weight * tap weight.
        reads = self._multiply(np.ones(self._shape, np.float32), self._diagonal)
        mean: Float32Array = np.divide(self._rhs[channel], reads, out=np.zeros_like(reads), where=reads > 0)
        return mean

    def solve(self, initial: Float32Array, channel: int = 0) -> Float32Array:
        """Return the (height, width) float32 image nearest to the samples, by conjugate gradients from `initial`.

        Texels that no look-up reads keep their initial values, as do all others where all samples agree with these.
        """
        if not self._count:
            return initial
        self._add_pending()
        prior = np.float32(_PRIOR * self._weight / self._count)
        diagonal = self._diagonal + prior
        residual = self._rhs[channel] - self._multiply(initial, self._diagonal)
        change = np.zeros_like(initial)
        scaled = residual / diagonal
        direction = scaled.copy()
        power = first = _dot(residual, scaled)
        for _ in range(_MAX_STEPS):
            if power <= _PRECISION**2 * first:
                break
            response = self._multiply(direction, diagonal)
            step = np.float32(power / _dot(direction, response))
            change += step * direction
            residual -= step * response
            scaled = residual / diagonal
            power, before = _dot(residual, scaled), power
            direction = scaled + np.float32(power / before) * direction
        return initial + change

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
        return at_offset, corners[1] * width + corners[0]

    def _add_pending(self) -> None:
        """Add the samples at one offset of texels off the edges: their look-ups share one set of tap weights."""
        if self._offset is None:
            return
        offset, (weight, *weighted) = self._offset, self._at_offset
        self._offset, self._at_offset = None, self._at_offset[:0]
        right, down = offset[0] - 0.5, offset[1] - 0.5
        first = math.floor(down), math.floor(right)
        below, along = down - first[0], right - first[1]
        taps = {
            (lower, farther): np.float32((below if lower else 1 - below) * (along if farther else 1 - along))
            for lower, farther in _TAPS
        }
        for (lower, farther), tap in taps.items():
            shift = first[0] + lower, first[1] + farther
            for rhs, image in zip(self._rhs, weighted, strict=True):
                _add_shifted(rhs, shift, tap * image)
            _add_shifted(self._diagonal, shift, tap * tap * weight)
            for (down_by, right_by), image in self._off_diagonal.items():
                other = taps.get((lower + down_by, farther + right_by))
                if other is not None:
                    _add_shifted(image, shift, tap * other * weight)

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
        """Yield the four texels of the look-ups: which one (down, right), its flat indices and its tap weights."""
        height, width = self._shape
        right, down = positions.T
        wrap: Wrap = "repeat" if self._repeats else "clamp"
        if not self._repeats:  # a look-up beyond the outermost centres reads their texels alone
            right, down = np.clip(right, 0.5, width - 0.5), np.clip(down, 0.5, height - 0.5)
        *columns, along = bilinear_taps(right, width, wrap)
        *rows, below = bilinear_taps(down, height, wrap)
        for lower, farther in _TAPS:
            tap = (below if lower else 1 - below) * (along if farther else 1 - along)
            yield (lower, farther), (rows[lower] * width + columns[farther], tap)

    def _multiply(self, image: Float32Array, diagonal: Float32Array) -> Float32Array:
        """Multiply an image by the symmetric matrix of the normal equations with this diagonal."""
        result: Float32Array = diagonal * image
        for (down, right), off_diagonal in self._off_diagonal.items():
            result += off_diagonal * np.roll(image, (-down, -right), axis=(0, 1))
            result += np.roll(off_diagonal * image, (down, right), axis=(0, 1))
        return result


def _scatter(image: Float32Array, texels: Int64Array, inverse: Int64Array, values: Float64Array) -> None:
    """Add each value to one of the texels, which are distinct."""
    image.reshape(-1)[texels] += np.bincount(inverse, values, minlength=len(texels)).astype(np.float32)


def _add_shifted(image: Float32Array, shift: tuple[int, int], added: Float32Array) -> None:
    """Add an image, 0 at its edges, shifted (down, right) by at most one texel each."""
    to = tuple(slice(max(0, by), size + min(0, by)) for by, size in zip(shift, image.shape, strict=True))
    of = tuple(slice(max(0, -by), size + min(0, -by)) for by, size in zip(shift, image.shape, strict=True))
    image[to] += added[of]


def _dot(a: Float32Array, b: Float32Array) -> float:
    """Sum of products, in an order that does not depend on the number of threads."""
    return float((a * b).sum(dtype=np.float64))


# From the image to the texture.

_BAND_ROWS = 512  # rows at a time, where padding is looked for


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
    shape = texels.height, texels.width
    valid: BoolArray = np.zeros(shape, bool)
    index = texels.index[measured]
    valid.ravel()[index] = True
    known = valid | reconstruction.sampled_texels()

    def fit(means: Float32Array, channel: int) -> Float32Array:
        initial = reconstruction.mean_image(channel)
        initial.ravel()[index] = means[measured]
        return reconstruction.solve(initial, channel)

    # As occlusion, which is exactly 0 on an open surface.
    fitted = np.where(known, np.clip(1 - fit(1 - values, 0), 0, 1), np.float32(0))
    if vectors is None:
        return ResolvedTexture(fitted, known, valid)
    components = [np.where(known, fit(means, channel), np.float32(0)) for channel, means in enumerate(vectors.T, 1)]
    return ResolvedTexture(fitted, known, valid, np.stack(components, axis=-1))


def fill_missed(resolved: ResolvedTexture, missed: Texels) -> ResolvedTexture:
    """Give covered texels whose value could not be measured one, smoothly from what lies around them.

    They count as known from then on, so that the gutters are padded with them, but not as valid.
    """
    empty: BoolArray = np.zeros(resolved.known.shape, bool)
    empty.ravel()[missed.index] = True
    empty &= ~resolved.known
    if not empty.any():
        return resolved

    def filled(image: Float32Array) -> Float32Array:
        return np.where(empty, push_pull(image, resolved.known), image)

    vectors = resolved.vectors
    if vectors is not None:
        vectors = np.stack([filled(vectors[..., axis]) for axis in range(3)], axis=-1)
    return replace(resolved, values=filled(resolved.values), known=resolved.known | empty, vectors=vectors)


def lighter_of_sides(front: ResolvedTexture, back: ResolvedTexture) -> ResolvedTexture:
    """Return the greater value of two sides at every texel, with that side's vector."""
    vectors = front.vectors
    if front.vectors is not None and back.vectors is not None:
        lighter = (back.values > front.values) | (back.known & ~front.known)
        vectors = np.where(lighter[..., None], back.vectors, front.vectors)
    return ResolvedTexture(
        np.maximum(front.values, back.values), front.known | back.known, front.valid | back.valid, vectors
    )


def pad_and_fill(resolved: ResolvedTexture, padding: int, fill: Fill, *, repeats: bool = False) -> Texture:
    """Return the finished texture (Précalcul, section 1.1.3), its vectors as they are; see `finish`."""
    values = finish(resolved.values, resolved.known, resolved.valid, padding, fill, repeats=repeats)
    return Texture(values, resolved.valid, resolved.known, resolved.vectors)


def finish(
    image: Float32Array, known: BoolArray, valid: BoolArray, padding: int, fill: Fill, *, repeats: bool = False
) -> Float32Array:
    """Return an image, of any number of channels, padded and filled.

    known     (height, width) bool: texels that have a value
    valid     those of which the mean is taken
    padding   texels in the gutter take the value of the nearest known texel at most this far away
    fill      the remaining texels: mean (of the valid ones, as in Précalcul), pushpull or none (0)
    repeats   the texture repeats, so that padding continues across its edges
    """
    if not valid.any():
        return image
    padded, filled = pad(image, known, padding, repeats=repeats)
    if fill == "mean":
        padded[~filled] = image[valid].mean(axis=0, dtype=np.float64)
    elif fill == "pushpull":
        channels = [push_pull(channel, filled) for channel in np.moveaxis(np.atleast_3d(padded), -1, 0)]
        padded = np.stack(channels, axis=-1).reshape(padded.shape)
    return padded


def pad(
    image: NDArray[_Texel], valid: BoolArray, distance: int, *, repeats: bool = False
) -> tuple[NDArray[_Texel], BoolArray]:
    """Dilate valid texels by `distance` texels; returns the image and the mask of all texels that now have a value.

    image   (height, width) or (height, width, channels)
    Each new texel copies the nearest valid one, so charts never mix. Texels farther away are 0.
    """
    if not distance:
        return image.copy(), valid.copy()
    height, width = valid.shape
    sides = (min(distance, height), min(distance, width)) if repeats else (0, 0)
    margin = [(side, side) for side in sides]
    source: NDArray[_Texel] = np.pad(image, margin + [(0, 0)] * (image.ndim - 2), mode="wrap")
    mask: BoolArray = np.pad(valid, margin, mode="wrap")
    result, known = np.zeros_like(source), np.zeros_like(mask)
    for start in range(0, len(source), _BAND_ROWS):
        stop = min(start + _BAND_ROWS, len(source))
        low, high = max(0, start - distance), min(stop + distance, len(source))
        if not mask[low:high].any():
            continue
        nearest = ndimage.distance_transform_edt(~mask[low:high], return_distances=False, return_indices=True)
        rows, columns = nearest[:, start - low : stop - low]
        down, right = rows - np.arange(start - low, stop - low)[:, None], columns - np.arange(source.shape[1])
        near = down**2 + right**2 <= distance * distance
        known[start:stop] = near
        result[start:stop][near] = source[low:high][rows[near], columns[near]]
    inner = slice(sides[0], sides[0] + height), slice(sides[1], sides[1] + width)
    return result[inner].copy(), known[inner].copy()


def push_pull(image: Float32Array, known: BoolArray) -> Float32Array:
    """Fill unknown texels smoothly from ever coarser means of the known ones, which keep their values.

    (S. Gortler, R. Grzeszczuk, R. Szeliski, M. Cohen, "The Lumigraph", 1996.)
    """
    if known.all() or not known.any():
        return image
    height, width = image.shape
    even = np.pad(np.where(known, image, 0), [(0, height % 2), (0, width % 2)])
    weight = np.pad(known, [(0, height % 2), (0, width % 2)]).astype(np.float32)
    blocks = (even.shape[0] // 2, 2, even.shape[1] // 2, 2)
    total = weight.reshape(blocks).sum(axis=(1, 3))
    coarse = np.divide(even.reshape(blocks).sum(axis=(1, 3)), total, out=np.zeros_like(total), where=total > 0)
    coarse = push_pull(coarse, total > 0)
    finer = ndimage.zoom(coarse, 2, order=1, mode="nearest", grid_mode=True)[:height, :width]
    return np.where(known, image, finer.astype(np.float32))
