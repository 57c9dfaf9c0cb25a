"""What a texture does beyond its edges."""

import numpy as np

from aoprecalc.types import Float32Array, Float64Array, Int32Array, Int64Array, Wrap


def wrapped(index: Int64Array, size: int | Int64Array, wrap: Wrap) -> Int64Array:
    """Return which of `size` texels stands at any index along an axis."""
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "repeat":
        return index % size
    turned = index % (2 * size)
    mirrored: Int64Array = np.minimum(turned, 2 * size - 1 - turned)
    return mirrored


# What a renderer finds in a picture: bilinear filtering, and the levels of a mip chain.


def bilinear(picture: Float32Array, uvs: Float64Array, *, repeats: bool) -> Float64Array:
    """Look (h, w) values up at (k, 2) UVs; returns (k,) float64.

    v points upwards: row 0 of the picture is at v = 1. Texel centres are at (i + 1/2) / w. Beyond them the picture
    begins again where it `repeats`, and else keeps the value of its border.
    """
    height, width = picture.shape
    left, right, across = _neighbours(uvs[:, 0] * width, width, repeats)
    above, below, down = _neighbours((1 - uvs[:, 1]) * height, height, repeats)
    upper = picture[above, left] * (1 - across) + picture[above, right] * across
    lower = picture[below, left] * (1 - across) + picture[below, right] * across
    found: Float64Array = upper * (1 - down) + lower * down
    return found


def mip_chain(picture: Float32Array, levels: int) -> list[Float32Array]:
    """Return a picture, (h, w), and ever coarser ones: at most `levels` in all, the last possible one is 1 x 1.

    Sides are halved and rounded down, as OpenGL does. A coarse texel is the mean of what it covers of the finer ones:
    two a side, or where their number is odd, parts of three.
    """
    chain = [picture]
    while len(chain) < levels and max(chain[-1].shape) > 1:
        chain.append(_halve(_halve(chain[-1]).T).T)
    return chain


def _neighbours(place: Float64Array, size: int, repeats: bool) -> tuple[Int32Array, Int32Array, Float64Array]:
    """Return the texels whose centres lie before and after places, in texels, and how far between them these are."""
    before = np.floor(place - 0.5)
    share = place - 0.5 - before
    both = np.stack([before, before + 1])
    first, second = (np.mod(both, size) if repeats else np.clip(both, 0, size - 1)).astype(np.int32)
    return first, second, share


def _halve(picture: Float32Array) -> Float32Array:
    """Halve the number of rows."""
    count = len(picture)
    half = count // 2
    if half == 0:
        return picture
    pairs = picture[: 2 * half].astype(np.float64).reshape(half, 2, -1)
    if count % 2 == 0:
        return np.asarray(pairs.mean(axis=1), np.float32)
    # Row i covers (2 + 1/half) rows, from i * (2 + 1/half) on: less and less of the first, more and more of the third.
    row = np.arange(half)[:, None]
    sums = (half - row) * pairs[:, 0] + half * pairs[:, 1] + (row + 1) * picture[2::2]
    return np.asarray(sums / count, np.float32)
