"""What lies around the charts of a texture: padding, a fill, and values of texels that could not be measured."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoprecalc.options import Fill
from aoprecalc.raster.resolve import ResolvedTexture
from aoprecalc.types import BoolArray, Float32Array, Padding, Texels, Texture

_BAND_ROWS = 512  # rows at a time, where padding is looked for

_Texel = TypeVar("_Texel", bound=np.generic)


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


def pad_and_fill(resolved: ResolvedTexture, padding: int, fill: Fill, *, repeats: bool = False) -> Texture:
    """Return the finished texture (Précalcul, section 1.1.3), its vectors as they are; see `finish`.

    padding   texels in the gutter take the value of the nearest known texel at most this far away
    repeats   the texture repeats, so that padding continues across its edges
    """
    known, valid = resolved.known, resolved.valid
    found = find_padding(known, padding, repeats=repeats)
    return Texture(finish(resolved.values, known, valid, found, fill), valid, known, resolved.vectors, found)


def finish(image: Float32Array, known: BoolArray, valid: BoolArray, padding: Padding, fill: Fill) -> Float32Array:
    """Return an image, of any number of channels, padded and filled.

    known   (height, width) bool: texels that have a value; it is 0 in the others
    valid   those of which the mean is taken
    fill    the remaining texels: mean (of the valid ones, as in Précalcul), pushpull or none (0)
    """
    if not valid.any():
        return image
    padded = _padded(image, padding)
    filled = known.copy()
    filled.reshape(-1)[padding.texels] = True
    if fill == "mean":
        padded[~filled] = image[valid].mean(axis=0, dtype=np.float64)
    elif fill == "pushpull":
        channels = [push_pull(channel, filled) for channel in np.moveaxis(np.atleast_3d(padded), -1, 0)]
        padded = np.stack(channels, axis=-1).reshape(padded.shape)
    return padded


def pad(image: NDArray[_Texel], valid: BoolArray, distance: int, *, repeats: bool = False) -> NDArray[_Texel]:
    """Return an image, (height, width) or (height, width, channels), padded; see `find_padding`."""
    return _padded(image, find_padding(valid, distance, repeats=repeats))


def _padded(image: NDArray[_Texel], padding: Padding) -> NDArray[_Texel]:
    padded = image.copy()
    flat = padded.reshape(-1, *image.shape[2:])
    flat[padding.texels] = flat[padding.sources]
    return padded


def find_padding(valid: BoolArray, distance: int, *, repeats: bool = False) -> Padding:
    """Find the texels that dilation of the valid ones, (height, width) bool, by `distance` texels adds.

    Each takes its value from the nearest valid one, so charts never mix.
    """
    (height, width), texels, sources = valid.shape, [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    above, left = (min(distance, height), min(distance, width)) if repeats else (0, 0)
    empty = ~np.pad(valid, ((above, above), (left, left)), mode="wrap")
    for start in range(0, height if distance else 0, _BAND_ROWS):
        stop = min(start + _BAND_ROWS, height)
        low, high = max(0, above + start - distance), min(above + stop + distance, len(empty))
        if empty[low:high].all() or valid[start:stop].all():
            continue
        nearest = ndimage.distance_transform_edt(empty[low:high], return_distances=False, return_indices=True)
        row, column = np.nonzero(~valid[start:stop])
        source_row, source_column = nearest[:, row + (above + start - low), column + left]
        source_row, source_column = source_row + (low - above), source_column - left
        row += start
        near = (source_row - row) ** 2 + (source_column - column) ** 2 <= distance**2
        texels.append((row * width + column)[near].astype(np.int32))
        sources.append((source_row % height * width + source_column % width)[near].astype(np.int32))
    return Padding(np.concatenate(texels), np.concatenate(sources))


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
