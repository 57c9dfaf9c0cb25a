"""False-colour pictures of errors: the heat map of a verified texture, and two compared pictures side by side."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.metrics.difference import PicturePair
from aoprecalc.render.contact_sheet import Ticks, contact_sheet, with_scale
from aoprecalc.types import Float32Array, Float64Array, Picture, Texels

SATURATION_ERROR = 0.1  # the error at which colours saturate
BACKGROUND = (48, 48, 48)
HEAT_MAP_MIN_SIZE, HEAT_MAP_MAX_SIZE = 512, 2048  # texels on the longer side
TILE_MIN_SIZE, TILE_MAX_SIZE = 256, 1024  # pixels on the longer side of a tile
SCALE_STEPS = 256  # colours of a scale


def heat_map_size(width: int, height: int) -> tuple[int, int]:
    """Return the size of the heat map of a texture: repeatedly doubled or halved if that is very small or large."""
    while max(width, height) < HEAT_MAP_MIN_SIZE:
        width, height = 2 * width, 2 * height
    while max(width, height) > HEAT_MAP_MAX_SIZE:
        width, height = max(1, width // 2), max(1, height // 2)
    return width, height


def error_heat_map(texels: Texels, uvs: Float64Array, errors: Float64Array, *, repeats: bool) -> Picture:
    """Draw errors, (k,) texture - reference at (k, 2) UVs, in texture space.

    Each covered texel shows the error of the point nearest in UV space: blue where the texture is too dark, white where
    it is right, red where it is too bright.

    Returns (height, width, 3) uint8 RGB, row 0 at v = 1.
    """
    size = np.array([texels.width, texels.height], np.float64)
    points = (uvs * (1, -1) + (0, 1)) * size
    if repeats:
        points = np.mod(points, size)
        points[points >= size] = 0  # rounding may give `size`
    row, column = np.divmod(texels.index, texels.width)
    tree = cKDTree(points, boxsize=size if repeats else None)
    nearest = tree.query(np.column_stack([column, row]) + 0.5, workers=-1)[1]
    picture: Picture = np.empty((texels.height, texels.width, 3), np.uint8)
    picture[:] = BACKGROUND
    picture.reshape(-1, 3)[texels.index] = diverging_colors(errors)[nearest]
    return picture


def diverging_colors(errors: NDArray[np.floating]) -> Picture:
    """Map errors, (...), to colours: blue below 0, white at 0, red above; returns (..., 3) uint8 RGB."""
    share = np.clip(errors / SATURATION_ERROR, -1, 1)
    red, blue = np.minimum(1 + share, 1), np.minimum(1 - share, 1)
    return _to_bytes(np.stack([red, np.minimum(red, blue), blue], axis=-1))


def comparison_picture(pair: PicturePair, names: tuple[str, str] = ("A", "B")) -> Picture:
    """Draw two pictures and their differences side by side, each with a scale and a caption.

    names   of the two pictures, A and B

    The tiles are A and B, 0 black and 1 white; B - A in the colours of `diverging_colors`; FLIP from 0 black through
    red and yellow to 1 white. Pictures of different sizes have only the first two tiles.

    Returns (height, width, 3) uint8 RGB.
    """
    first, second = _fit_to_tile(pair.first), _fit_to_tile(pair.second)
    steps = np.linspace(0, 1, SCALE_STEPS)[None]
    greys, ends = _grey(steps)[0], [(0.0, "0"), (1.0, "1")]
    tiles: list[tuple[Picture, Picture, Ticks, str]] = [
        (_grey(first), greys, ends, names[0]),
        (_grey(second), greys, ends, names[1]),
    ]
    if pair.flip is not None:
        signed = diverging_colors(SATURATION_ERROR * (2 * steps[0] - 1))
        marks = [(0.0, f"-{SATURATION_ERROR:g}"), (0.5, "0"), (1.0, f"+{SATURATION_ERROR:g}")]
        tiles += [
            (diverging_colors(second - first), signed, marks, "B - A\nBlue: B is darker. Red: B is brighter."),
            (_heat_colors(_fit_to_tile(pair.flip)), _heat_colors(steps)[0], ends, "FLIP\nThe difference an eye sees."),
        ]
    cells = [(with_scale(tile, colors, ticks), caption) for tile, colors, ticks, caption in tiles]
    return contact_sheet(cells, len(cells))


def _fit_to_tile(values: Float32Array) -> Float64Array:
    """Enlarge a small picture, (h, w), by repeating pixels, or reduce a large one to the means of blocks."""
    longer = max(values.shape)
    if longer < TILE_MIN_SIZE:
        factor = -(-TILE_MIN_SIZE // longer)
        return values.astype(np.float64).repeat(factor, axis=0).repeat(factor, axis=1)
    block = -(-longer // TILE_MAX_SIZE)
    return _block_means(_block_means(values, block, 0), block, 1)


def _block_means(values: Float32Array | Float64Array, size: int, axis: int) -> Float64Array:
    """Return the means of blocks of `size` values along an axis; the last block may be shorter."""
    starts = np.arange(0, values.shape[axis], size)
    counts = np.diff([*starts, values.shape[axis]])
    sums: Float64Array = np.add.reduceat(values, starts, axis=axis, dtype=np.float64)
    return sums / (counts[:, None] if axis == 0 else counts)


def _grey(values: Float64Array) -> Picture:
    return _to_bytes(values[:, :, None].repeat(3, axis=2))


def _heat_colors(values: Float64Array) -> Picture:
    """Map values in [0, 1] to colours: red rises first, then green, then blue."""
    return _to_bytes(3 * values[:, :, None] - (0, 1, 2))


def _to_bytes(colors: NDArray[np.floating]) -> Picture:
    picture: Picture = np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)
    return picture
