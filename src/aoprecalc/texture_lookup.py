"""Texture look-ups as renderers do them: wrap modes, bilinear filtering, mip levels, bounds of alpha, sRGB."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from aoprecalc.types import Float32Array, Float64Array, Int64Array, UInt8Array, Wrap

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of linear colours (ITU-R BT.709)

_Float = TypeVar("_Float", np.float32, np.float64)
_Texel = TypeVar("_Texel", np.float32, np.bool_)
_MAX_CELLS = 2048  # along the sides of the finest bounds of alpha
_MAX_BORDER = 0.5  # of the size of a texture, by which a clamped one is extended; farther away its look-ups differ


def wrap_texels(index: NDArray[Any], size: int | Int64Array, wrap: Wrap) -> Int64Array:
    """Return which of `size` texels along an axis stands at each index, whole numbers of any sign and type, int64."""
    if wrap == "clamp":
        wrapped = np.clip(index, 0, size - 1)
    elif wrap == "repeat":
        wrapped = index % size
    else:
        period = index % (2 * size)
        wrapped = np.minimum(period, 2 * size - 1 - period)
    return np.asarray(wrapped, np.int64)


def bilinear_taps(
    coordinates: NDArray[_Float], size: int, wrap: Wrap
) -> tuple[Int64Array, Int64Array, NDArray[_Float]]:
    """Return the texels whose centres are before and after coordinates along an axis, and the weight of the second.

    coordinates   in texels from the edge, of any shape: the centre of texel i is at i + 1/2
    Bilinear filtering along the axis is texel[first] * (1 - weight) + texel[second] * weight.
    """
    shifted = coordinates - 0.5
    first = np.floor(shifted)
    return wrap_texels(first, size, wrap), wrap_texels(first + 1, size, wrap), shifted - first


def bilinear(image: Float32Array, uvs: Float64Array, *, repeats: bool) -> Float64Array:
    """Look (h, w) values up at (k, 2) UVs; returns (k,) float64.

    v points upwards: row 0 of the image is at v = 1. Beyond its edges it repeats if `repeats`, else it is clamped.
    """
    height, width = image.shape
    wrap: Wrap = "repeat" if repeats else "clamp"
    left, right, across = bilinear_taps(uvs[:, 0] * width, width, wrap)
    above, below, down = bilinear_taps((1 - uvs[:, 1]) * height, height, wrap)
    upper = image[above, left] * (1 - across) + image[above, right] * across
    lower = image[below, left] * (1 - across) + image[below, right] * across
    values: Float64Array = upper * (1 - down) + lower * down
    return values


_MAX_JOINED, _MAX_ROWS = 1 << 25, 1 << 13  # texels, and rows of them
_MARGIN = 16  # rows between textures that are joined: none is mixed with the next up to mip level 4
_MAX_REPEATS = 4  # along an axis, of a texture that is joined


@dataclass(frozen=True, eq=False)
class TextureStack:
    """Textures below each other in one, with rows between them, so that one set of UVs serves them all.

    shapes    (height, width) of each
    repeats   how often each is there along v and u, for faces that span several of its repeats
    """

    shapes: tuple[tuple[int, int], ...]
    repeats: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, shapes: Sequence[tuple[int, int]], owners: Int64Array, uvs: Float64Array) -> Self:
        """Return the stack for faces with (f,) indices of their textures, -1 for none, and (f, 3, 2) UVs."""
        spans = _from_first_repeat(uvs).max(axis=1)
        needed = (np.ceil(spans[owners == index].max(axis=0, initial=1) - 1e-6) for index in range(len(shapes)))
        return cls(tuple(shapes), tuple((int(v), int(u)) for u, v in (np.minimum(n, _MAX_REPEATS) for n in needed)))

    def join(self, textures: Sequence[NDArray[_Texel]]) -> NDArray[_Texel]:
        """Return one texture of several, each (height, width) or (height, width, channels), float32 or bool.

        The rows between them have the values beside them, or False.
        """
        width = max(columns * u for (_, columns), (_, u) in zip(self.shapes, self.repeats, strict=True))
        pages = list[NDArray[_Texel]]()
        for texture, (v, u) in zip(textures, self.repeats, strict=True):
            tiled: NDArray[_Texel] = np.tile(texture, (v, u, 1)[: texture.ndim])
            border = ((_MARGIN, _MARGIN), (0, width - tiled.shape[1]), (0, 0))[: texture.ndim]
            pages.append(np.pad(tiled, border, mode="constant" if tiled.dtype == np.bool_ else "edge"))
        return np.concatenate(pages)

    def move(self, owners: Int64Array, uvs: Float64Array) -> Float64Array:
        """Return the UVs of faces in the one texture, (f, 3, 2), see `of`; (0, 0) where they have none."""
        within, moved = _from_first_repeat(uvs), np.zeros_like(uvs)
        width = max(columns * u for (_, columns), (_, u) in zip(self.shapes, self.repeats, strict=True))
        heights = [height * v + 2 * _MARGIN for (height, _), (v, _) in zip(self.shapes, self.repeats, strict=True)]
        for index, ((height, columns), (v, u)) in enumerate(zip(self.shapes, self.repeats, strict=True)):
            own, top = owners == index, sum(heights[:index]) + _MARGIN
            moved[own, :, 0] = within[own, :, 0].clip(0, u) * columns / width
            moved[own, :, 1] = 1 - (top + (v - within[own, :, 1].clip(0, v)) * height) / sum(heights)
        return moved


def _from_first_repeat(uvs: Float64Array) -> Float64Array:
    """Return (f, 3, 2) UVs moved by whole numbers, so that the least of each face lies in [0, 1)."""
    moved: Float64Array = uvs - np.floor(uvs.min(axis=1, keepdims=True))
    return moved


def join_textures(
    textures: Sequence[Float32Array], owners: Int64Array, uvs: Float64Array, *, whole: bool = False
) -> tuple[Float32Array, Float64Array]:
    """Lay textures below each other in one, and move the UVs of their faces there.

    textures   each (h, w); unless `whole` all are halved until they have at most 2^25 texels and 2^13 rows together
    owners     (f,) index of the texture of each face, -1 for none
    uvs        (f, 3, 2) float64, v upwards
    """
    while not whole and (sum(map(np.size, textures)) > _MAX_JOINED or sum(map(len, textures)) > _MAX_ROWS):
        textures = [mip_chain(texture, 2)[-1] for texture in textures]
    stack = TextureStack.of([(len(texture), texture.shape[1]) for texture in textures], owners, uvs)
    return stack.join(textures), stack.move(owners, uvs)


def mip_chain(image: Float32Array, levels: int) -> list[Float32Array]:
    """Return an image, (h, w), and ever coarser ones, at most `levels` in all; the last possible one is 1 x 1.

    Sides are halved and rounded down, as OpenGL does. A coarse texel is the mean of what it covers of the finer ones:
    two a side, or where their number is odd, parts of three.
    """
    chain = [image]
    while len(chain) < levels and max(chain[-1].shape) > 1:
        chain.append(_halve(_halve(chain[-1]).T).T)
    return chain


def _halve(image: Float32Array) -> Float32Array:
    """Halve the number of rows."""
    count = len(image)
    half = count // 2
    if half == 0:
        return image
    pairs = image[: 2 * half].astype(np.float64).reshape(half, 2, -1)
    if count % 2 == 0:
        return np.asarray(pairs.mean(axis=1), np.float32)
    # Row i covers (2 + 1/half) rows, from i * (2 + 1/half) on: less and less of the first, more and more of the third.
    row = np.arange(half)[:, None]
    sums = (half - row) * pairs[:, 0] + half * pairs[:, 1] + (row + 1) * image[2::2]
    return np.asarray(sums / count, np.float32)


def repeating_texture(
    texture: UInt8Array, uvs: Float64Array, wraps: tuple[Wrap, Wrap]
) -> tuple[UInt8Array, Float64Array]:
    """Return a texture that repeats, and UVs in it, whose look-ups equal those of a texture with other wrap modes.

    texture   (h, w, channels), row 0 at v = 1
    uvs       (..., 2), v upwards
    wraps     the wrap modes along u and v; a mirrored axis gets twice the texels, a clamped one a border
    """
    for axis, wrap in enumerate(wraps):
        if wrap != "repeat" and uvs.size:
            texture, coordinates = _repeating(texture, uvs[..., axis], 1 - axis, wrap)
            uvs = np.stack([coordinates, uvs[..., 1]] if axis == 0 else [uvs[..., 0], coordinates], axis=-1)
    return texture, uvs


def _repeating(
    texture: UInt8Array, coordinates: Float64Array, axis: int, wrap: Wrap
) -> tuple[UInt8Array, Float64Array]:
    """Do so along one axis of the texture: 1 with u, 0 with v, whose rows run downwards."""
    size = texture.shape[axis]
    low, high = float(coordinates.min()), float(coordinates.max())
    if low >= 0.5 / size and high <= 1 - 0.5 / size:
        return texture, coordinates
    if wrap == "mirror":
        other = np.flip(texture, axis)
        return np.concatenate([other, texture] if axis == 0 else [texture, other], axis), coordinates / 2
    low, high = max(low, -_MAX_BORDER), min(high, 1 + _MAX_BORDER)
    before, after = (int(np.ceil(max(out, 0) * size)) + 1 for out in (-low, high - 1))
    widths = [(0, 0)] * 3
    widths[axis] = (after, before) if axis == 0 else (before, after)
    moved = (coordinates.clip(low, high) * size + before) / (before + size + after)
    return np.pad(texture, widths, mode="edge"), moved


@dataclass(frozen=True, eq=False)
class AlphaTexture:
    """An alpha image with bounds of its bilinear look-ups. Locations are (u, 1 - v), in the order of its rows.

    alpha    (h, w) float32
    wraps    the wrap modes along u and v
    bounds   (c, 2) float32: min and max alpha in cells of UV space, grid after grid, row after row
    grids    (l, 3): where each grid begins in bounds, its columns and its rows; each has half as many as the one before
    """

    alpha: Float32Array
    wraps: tuple[Wrap, Wrap]
    bounds: Float32Array
    grids: Int64Array

    @classmethod
    def from_image(cls, alpha: Float32Array, wraps: tuple[Wrap, Wrap]) -> Self:
        """Compute the bounds of an image."""
        pyramids = [list(_pyramid(alpha, wraps, extreme)) for extreme in (np.minimum, np.maximum)]
        sizes = np.array([cells.shape for cells in pyramids[0]])
        starts = np.cumsum(sizes.prod(axis=1)) - sizes.prod(axis=1)
        bounds = np.stack([np.concatenate([cells.ravel() for cells in pyramid]) for pyramid in pyramids], axis=1)
        return cls(alpha, wraps, bounds, np.column_stack([starts, sizes[:, ::-1]]))

    @property
    def varying_size(self) -> tuple[int, int]:
        """Columns and rows, 0 where there is only one: along that axis the alpha is constant."""
        height, width = self.alpha.shape
        return width if width > 1 else 0, height if height > 1 else 0

    def lookup(self, locations: Float64Array) -> Float64Array:
        """Return the bilinear alpha, (m,), at (m, 2) locations."""
        height, width = self.alpha.shape
        left, right, x = bilinear_taps(locations[:, 0] * width, width, self.wraps[0])
        upper, lower, y = bilinear_taps(locations[:, 1] * height, height, self.wraps[1])
        above = _mix(self.alpha[upper, left], self.alpha[upper, right], x)
        return _mix(above, _mix(self.alpha[lower, left], self.alpha[lower, right], x), y)

    def bounds_in(self, low: Float64Array, high: Float64Array) -> Float32Array:
        """Return bounds of the alpha, (m, 2) min and max, in the rectangles from (m, 2) to (m, 2) locations."""
        first, last = (np.floor(end * self.grids[0, 1:]).astype(np.int64) for end in (low, high))
        # The grid in which two columns and two rows contain the rectangle.
        level = np.frexp(np.maximum((last - first).max(axis=1) - 1, 0))[1].clip(max=len(self.grids) - 1)
        start, *sizes = self.grids[level].T
        columns, rows = (
            [wrap_texels(end[:, axis] >> level, sizes[axis], self.wraps[axis]) for end in (first, last)]
            for axis in (0, 1)
        )
        cells = [self.bounds[start + row * sizes[0] + column] for row in rows for column in columns]
        low_alpha, high_alpha = (extreme.reduce(cells)[:, k] for k, extreme in enumerate((np.minimum, np.maximum)))
        return np.stack([low_alpha, high_alpha], axis=1)


def _mix(first: NDArray[np.floating], second: NDArray[np.floating], weight: Float64Array) -> Float64Array:
    # In this form the mix of equal values is exactly that value.
    return first + weight * (second - first)


def _pyramid(alpha: Float32Array, wraps: tuple[Wrap, Wrap], extreme: np.ufunc) -> Iterator[Float32Array]:
    """Yield grids of the extremes of the bilinear alpha, from the finest to a single cell."""
    cells = alpha
    for axis, wrap in enumerate(reversed(wraps)):
        cells = _cell_extremes(cells, axis, wrap, extreme)
    yield cells
    while cells.size > 1:
        for axis in (0, 1):
            cells = extreme.reduceat(cells, np.arange(0, cells.shape[axis], 2), axis)
        yield cells


def _cell_extremes(alpha: Float32Array, axis: int, wrap: Wrap, extreme: np.ufunc) -> Float32Array:
    """Return the extremes of the texels that look-ups in each cell read, for a power of two of cells along an axis."""
    size = alpha.shape[axis]
    count = min(1 << (size - 1).bit_length(), _MAX_CELLS)
    ends = np.arange(count + 1) * (size / count) - 0.5
    # One texel more on either side, and one that reduceat needs.
    texels = alpha.take(wrap_texels(np.arange(-1, size + 2), size, wrap), axis)
    runs = np.column_stack([np.floor(ends[:-1]) + 1, np.ceil(ends[1:]) + 2]).astype(np.int64)
    cells: Float32Array = extreme.reduceat(texels, runs.ravel(), axis).take(np.arange(0, 2 * count, 2), axis)
    return cells


def linear_from_srgb(values: NDArray[np.floating]) -> Float32Array:
    """Return linear values, float32 in [0, 1], from sRGB in [0, 1] (IEC 61966-2-1)."""
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)


def srgb_from_linear(values: NDArray[np.floating]) -> Float32Array:
    """Return sRGB values, float32 in [0, 1], from linear ones, which are clipped to [0, 1] (IEC 61966-2-1)."""
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055).astype(np.float32)
