"""From measured texels to a whole texture: the least-squares image, padding around the charts, and a fill."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from aoprecalc.options import Fill
from aoprecalc.raster.least_squares import LeastSquaresImage
from aoprecalc.types import BoolArray, Float32Array, Texels, Texture

_BAND_ROWS = 512


@dataclass(frozen=True, eq=False)
class ResolvedTexture:
    """The values of the texels that look-ups on the surface read, before padding.

    values   (height, width) float32 in [0, 1], 0 where not known
    known    (height, width) bool: texels that the surface covers or that a look-up on it reads
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    """

    values: Float32Array
    known: BoolArray
    valid: BoolArray


def resolve_texels(
    texels: Texels, values: Float32Array, measured: BoolArray, reconstruction: LeastSquaresImage
) -> ResolvedTexture:
    """Fit the texture to the samples, starting from the mean values of k texels.

    values           (k,) float32 in [0, 1], which count where `measured`, (k,) bool
    reconstruction   holds the samples, as occlusion (1 - AO value)
    """
    means: Float32Array = np.zeros((texels.height, texels.width), np.float32)
    valid: BoolArray = np.zeros(means.shape, bool)
    index = texels.index[measured]
    means.ravel()[index], valid.ravel()[index] = values[measured], True
    known = valid | reconstruction.sampled_texels()
    # As occlusion, which is exactly 0 on an open surface.
    initial = np.where(valid, 1 - means, reconstruction.mean_image())
    fitted = np.clip(1 - reconstruction.solve(initial), 0, 1)
    return ResolvedTexture(np.where(known, fitted, np.float32(0)), known, valid)


def lighter_of_sides(front: ResolvedTexture, back: ResolvedTexture) -> ResolvedTexture:
    """Return the greater value of two sides at every texel."""
    return ResolvedTexture(np.maximum(front.values, back.values), front.known | back.known, front.valid | back.valid)


def pad_and_fill(resolved: ResolvedTexture, padding: int, fill: Fill, *, repeats: bool = False) -> Texture:
    """Return the finished texture (Précalcul, section 1.1.3).

    padding   texels in the gutter take the value of the nearest known texel at most this far away
    fill      the remaining texels: mean (of the valid ones, as in Précalcul), pushpull or none (0)
    repeats   the texture repeats, so that padding continues across its edges
    """
    valid = resolved.valid
    if not valid.any():
        return Texture(resolved.values, valid)
    padded, known = pad(resolved.values, resolved.known, padding, repeats=repeats)
    if fill == "mean":
        padded[~known] = resolved.values[valid].mean(dtype=np.float64)
    elif fill == "pushpull":
        padded = push_pull(padded, known)
    return Texture(padded, valid)


def pad(
    image: Float32Array, valid: BoolArray, distance: int, *, repeats: bool = False
) -> tuple[Float32Array, BoolArray]:
    """Dilate valid texels by `distance` texels; returns the image and the mask of all texels that now have a value.

    Each new texel copies the nearest valid one, so charts never mix. Texels farther away are 0.
    """
    if not distance:
        return image.copy(), valid.copy()
    height, width = valid.shape
    sides = (min(distance, height), min(distance, width)) if repeats else (0, 0)
    margin = [(side, side) for side in sides]
    source: Float32Array = np.pad(image, margin, mode="wrap")
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
        result[start:stop] = np.where(near, source[low:high][rows, columns], 0)
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
