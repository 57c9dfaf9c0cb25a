"""From measured texels to a whole picture: the best fit, padding around the charts, then a fill for what is left."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from aoprecalc.options import Fill
from aoprecalc.raster.least_squares import LeastSquaresImage
from aoprecalc.types import BoolArray, Float32Array, Texels, Texture

_BAND_ROWS = 512


@dataclass(frozen=True, eq=False)
class ResolvedTexture:
    """A picture of the texels that the surface needs, before its gutters.

    values   (height, width) float32 in [0, 1], 0 where not known
    known    (height, width) bool: texels that the surface covers, and those that a look-up on it reads besides
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    """

    values: Float32Array
    known: BoolArray
    valid: BoolArray


def resolve_texels(
    texels: Texels, values: Float32Array, measured: BoolArray, reconstruction: LeastSquaresImage
) -> ResolvedTexture:
    """Put the means of texels, (k,) float32 in [0, 1], into a picture; only the measured ones, (k,) bool, count.

    reconstruction   what was measured, as darkness (1 - value): the picture is improved to fit it
    """
    picture: Float32Array = np.zeros((texels.height, texels.width), np.float32)
    valid: BoolArray = np.zeros(picture.shape, bool)
    index = texels.index[measured]
    picture.ravel()[index], valid.ravel()[index] = values[measured], True
    known = valid | reconstruction.sampled_texels()
    start = np.where(valid, 1 - picture, reconstruction.mean_image())  # as darkness: open surfaces stay exactly so
    improved = np.clip(1 - reconstruction.solve(start), 0, 1)
    return ResolvedTexture(np.where(known, improved, np.float32(0)), known, valid)


def lighter_of_sides(first: ResolvedTexture, second: ResolvedTexture) -> ResolvedTexture:
    """Return the greater of two paintings at every texel."""
    return ResolvedTexture(
        np.maximum(first.values, second.values), first.known | second.known, first.valid | second.valid
    )


def pad_and_fill(painting: ResolvedTexture, padding: int, fill: Fill, *, repeats: bool = False) -> Texture:
    """Return the finished picture.

    padding   texels in the gutter take the value of the nearest known texel at most this far away
    fill      the remaining texels: mean (of the valid ones; source, 1.1.3), pushpull or none (0)
    repeats     the texture repeats, so that padding goes round its edges
    """
    valid = painting.valid
    if not valid.any():
        return Texture(painting.values, valid)
    padded, known = pad(painting.values, painting.known, padding, repeats=repeats)
    if fill == "mean":
        padded[~known] = painting.values[valid].mean(dtype=np.float64)
    elif fill == "pushpull":
        padded = push_pull(padded, known)
    return Texture(padded, valid)


def pad(
    picture: Float32Array, valid: BoolArray, reach: int, *, repeats: bool = False
) -> tuple[Float32Array, BoolArray]:
    """Extend valid texels by `reach` texels; returns the picture and the mask of all texels that now have a value.

    Each new texel copies the nearest valid one, so charts never mix. Texels farther away are 0.
    """
    if not reach:
        return picture.copy(), valid.copy()
    height, width = valid.shape
    sides = (min(reach, height), min(reach, width)) if repeats else (0, 0)
    margin = [(side, side) for side in sides]
    source: Float32Array = np.pad(picture, margin, mode="wrap")
    mask: BoolArray = np.pad(valid, margin, mode="wrap")
    result, known = np.zeros_like(source), np.zeros_like(mask)
    for start in range(0, len(source), _BAND_ROWS):
        stop = min(start + _BAND_ROWS, len(source))
        low, high = max(0, start - reach), min(stop + reach, len(source))
        if not mask[low:high].any():
            continue
        nearest = ndimage.distance_transform_edt(~mask[low:high], return_distances=False, return_indices=True)
        rows, columns = nearest[:, start - low : stop - low]
        away = (rows - np.arange(start - low, stop - low)[:, None]) ** 2 + (columns - np.arange(source.shape[1])) ** 2
        near = away <= reach * reach
        known[start:stop] = near
        result[start:stop] = np.where(near, source[low:high][rows, columns], 0)
    inner = slice(sides[0], sides[0] + height), slice(sides[1], sides[1] + width)
    return result[inner].copy(), known[inner].copy()


def push_pull(picture: Float32Array, known: BoolArray) -> Float32Array:
    """Fill unknown texels smoothly from ever coarser means of the known ones.

    (S. Gortler, R. Grzeszczuk, R. Szeliski, M. Cohen, "The Lumigraph", 1996.) Known texels keep their values.
    """
    if known.all() or not known.any():
        return picture
    height, width = picture.shape
    even = np.pad(np.where(known, picture, 0), [(0, height % 2), (0, width % 2)])
    weight = np.pad(known, [(0, height % 2), (0, width % 2)]).astype(np.float32)
    blocks = (even.shape[0] // 2, 2, even.shape[1] // 2, 2)
    whole = weight.reshape(blocks).sum(axis=(1, 3))
    coarse = np.divide(even.reshape(blocks).sum(axis=(1, 3)), whole, out=np.zeros_like(whole), where=whole > 0)
    coarse = push_pull(coarse, whole > 0)
    finer = ndimage.zoom(coarse, 2, order=1, mode="nearest", grid_mode=True)[:height, :width]
    return np.where(known, picture, finer.astype(np.float32))
