"""Pictures in texture space: the heat map of errors, two compared textures side by side, the layout of charts.

Contact sheets show them, and others: pictures in a grid, each with a caption, and scales that tell colours apart.
Their font is the one inside Pillow, Aileron, which has ASCII alone; it needs no files and looks the same everywhere.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from aoprecalc.mesh.topology import face_components
from aoprecalc.metrics.difference import PicturePair
from aoprecalc.raster.cpu_rasterizer import edge_texels, expand_counts, snap_to_grid, triangle_spans
from aoprecalc.raster.layout import CENTER, Layout, atlas_from_uvs, build_layout, corner_ids
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int64Array, Picture, Texels, TexturedMesh

Ticks = Sequence[tuple[float, str]]  # where along a scale, in [0, 1], and the words there

SATURATION_ERROR = 0.1  # the error at which colours saturate
BACKGROUND = (48, 48, 48)
HEAT_MAP_PADDING = 6  # texels by which a picture of it continues its colours
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
    greys, ends = grey_picture(steps)[0], [(0.0, "0"), (1.0, "1")]
    tiles: list[tuple[Picture, Picture, Ticks, str]] = [
        (grey_picture(first), greys, ends, names[0]),
        (grey_picture(second), greys, ends, names[1]),
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


def _heat_colors(values: Float64Array) -> Picture:
    """Map values in [0, 1] to colours: red rises first, then green, then blue."""
    return _to_bytes(3 * values[:, :, None] - (0, 1, 2))


def _to_bytes(colors: NDArray[np.floating]) -> Picture:
    picture: Picture = np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)
    return picture


# The charts of a texture, and its values.

CHART_SAMPLES = 2  # per axis, of a pixel of the chart layout
_WIREFRAME = 4000  # faces up to which the layout shows their edges
_PAPER = np.array([247, 247, 245], np.float64)
_OUTLINE, _EDGE = 0.45, 0.82  # brightness of a chart's outline, and of an edge inside it, over the chart's own
_TONES = (0.0, 0.618034, 0.236068, 0.854102, 0.472136, 0.090170, 0.708204, 0.326238)  # hues, far apart in turn


def grey_picture(values: NDArray[np.floating]) -> Picture:
    """Draw values in [0, 1], (h, w), as greys: 0 is black, 1 is white; returns (h, w, 3) uint8."""
    return _to_bytes(values.astype(np.float64)[:, :, None].repeat(3, axis=2))


@dataclass(frozen=True, eq=False)
class ChartLayout:
    """The charts of a texture.

    picture   (h, w, 3) uint8 sRGB, row 0 at v = 1: a colour for each chart, its outline, and edges where there are few
    charts    their number
    covered   (h', w') bool: points of a finer grid over the texture that lie in a triangle
    """

    picture: Picture
    charts: int
    covered: BoolArray


def chart_layout(mesh: TexturedMesh, size: tuple[int, int]) -> ChartLayout | None:
    """Draw the charts of a mesh's texture, `size` pixels wide and high; None where no face has UVs in it."""
    if mesh.uvs is None or not mesh.textured.any():
        return None
    width, height = (CHART_SAMPLES * side for side in size)
    atlas = atlas_from_uvs(mesh.scene, mesh.uvs, mesh.textured)
    layout = build_layout(mesh.scene, atlas, width, height)
    mapped = np.flatnonzero(mesh.textured)
    chart_of = np.full(len(mesh.textured), -1)
    chart_of[mapped] = face_components(corner_ids(mesh.scene.faces[mapped], mesh.uvs[mapped]))
    owner = _face_at(layout)
    colors = np.vstack([chart_colors(atlas.charts), _PAPER])  # the last is that of no chart
    chart = np.where(owner < 0, atlas.charts, chart_of[owner])
    pixels = colors[chart]
    if len(mapped) <= _WIREFRAME:
        ends = layout.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 2)
        _darken(pixels, colors[chart_of[layout.faces]].repeat(3, axis=0), ends, width, height, _EDGE)
    _darken(pixels, colors[chart_of[layout.border_faces]], layout.borders[:, :2], width, height, _OUTLINE)
    fine = pixels.reshape(size[1], CHART_SAMPLES, size[0], CHART_SAMPLES, 3)
    picture = np.floor(fine.mean(axis=(1, 3)) + 0.5).astype(np.uint8)
    return ChartLayout(picture, atlas.charts, (owner >= 0).reshape(height, width))


def chart_colors(count: int) -> NDArray[np.float64]:
    """Return a light colour for each chart, (count, 3) sRGB in [0, 255], those of near numbers far apart."""
    index = np.arange(count)
    hue = np.asarray(_TONES)[index % len(_TONES)] + 0.031 * (index // len(_TONES))
    light = 0.80 - 0.10 * (index // 3 % 3)
    waves = 2 * np.pi * (hue[:, None] + (0, 1 / 3, 2 / 3))
    colors: NDArray[np.float64] = 255 * (light[:, None] + 0.17 * np.cos(waves))
    return np.clip(colors, 0, 255)


def ao_histogram(ao: Float32Array, covered: BoolArray | None, bins: int) -> tuple[Int64Array, Float32Array]:
    """Count the values of a texture, (h, w), that the surface shows, in bins of [0, 1].

    covered   (h', w') bool: where it is, on any grid over the texture; None: everywhere
    Returns the counts, (bins,), and the values, (n,).
    """
    values = ao.ravel()
    if covered is not None:
        row, column = np.nonzero(covered)
        rows = (2 * row + 1) * ao.shape[0] // (2 * covered.shape[0])
        columns = (2 * column + 1) * ao.shape[1] // (2 * covered.shape[1])
        values = ao[rows, columns]
    counts = np.histogram(np.clip(values, 0, 1), bins, (0.0, 1.0))[0]
    return counts.astype(np.int64), values


def _face_at(layout: Layout) -> Int64Array:
    """Return the face at the centre of each texel, (height * width,) int64; -1 for none."""
    owner = np.full(layout.width * layout.height, -1)
    corners = snap_to_grid(layout.triangles, CENTER)
    for triangle, first, length in triangle_spans(corners, layout.width, 0, layout.height):
        for span, step in expand_counts(length):
            owner[first[span] + step] = layout.faces[triangle[span]]
    return owner


def _darken(
    pixels: NDArray[np.float64],
    colors: NDArray[np.float64],
    edges: NDArray[np.floating],
    width: int,
    height: int,
    share: float,
) -> None:
    """Draw edges, (e, 2, 2) in pixels, over (height * width, 3) pixels, each in its colour times `share`."""
    for edge, row, column in edge_texels(edges.astype(np.float64), width, 0, height):
        pixels[row * width + column] = colors[edge] * share


def heat_map_picture(pixels: Float32Array) -> Picture:
    """Return a heat map, (h, w, channels) in [0, 1] as read from its file, as (h, w, 3) uint8 sRGB.

    Its colours are continued around charts, so that a viewer that interpolates reads no background.
    """
    colors = _to_bytes(pixels[:, :, :3].astype(np.float64))
    if colors.shape[2] != 3:
        colors = colors[:, :, :1].repeat(3, axis=2)
    empty = (colors == BACKGROUND).all(axis=2)
    if empty.all() or not empty.any():
        return colors
    distance, nearest = distance_transform_edt(empty, return_indices=True)
    return np.where((distance <= HEAT_MAP_PADDING)[:, :, None], colors[tuple(nearest)], colors)


# Contact sheets.

PAGE, INK, SOFT = (250, 250, 248), (32, 35, 40), (92, 97, 104)  # contrast on PAGE: 15 and 6
MAT = (238, 238, 235)  # around pictures that are smaller than their cells
_RIM = (160, 160, 158)  # around scales, whose colours may be those of the page
_SHARP = 3  # from this magnification on pixels are shown as squares
_LEADING = 1.32  # distance of lines over the size of their type
_MIN_TYPE, _MAX_TYPE, _TYPE_SHARE = 13, 34, 1 / 26  # pixels; share of a cell's width


def contact_sheet(
    cells: Sequence[tuple[Picture, str]],
    columns: int,
    title: str = "",
    *,
    cell_size: tuple[int, int] | None = None,
) -> Picture:
    """Lay out pictures in rows, from left to right, with their captions below.

    cells       pictures, (h, w, 3) uint8, of any sizes, and their captions. A caption is wrapped to its cell; what
                follows its first line break is an explanation, in a softer colour
    columns     at least 1
    title       above the first row; empty: none
    cell_size   width and height of every cell, into which pictures are fitted, see `fit_picture`. None: the largest
                width and height among the pictures, which keep their sizes

    The same input gives the same bytes. Returns (height, width, 3) uint8 sRGB.
    """
    if cell_size is None:
        width, height = (max(picture.shape[side] for picture, _ in cells) for side in (1, 0))
        pictures = [picture for picture, _ in cells]
    else:
        width, height = cell_size
        pictures = [fit_picture(picture, width, height) for picture, _ in cells]
    columns = min(columns, len(cells))
    size = type_size(width)
    gap, line = round(1.5 * size), round(_LEADING * size)
    captions = [_wrapped_caption(caption, size, width) for _, caption in cells]
    rows = [range(start, min(start + columns, len(cells))) for start in range(0, len(cells), columns)]
    caption_lines = [max(len(captions[index]) for index in row) for row in rows]
    title_size = round(1.5 * size)
    sheet_width = columns * (width + gap) + gap
    title_lines = _wrap(title, title_size, sheet_width - 2 * gap) if title else []
    title_line = round(_LEADING * title_size)
    top = gap + (len(title_lines) * title_line + gap // 2 if title_lines else 0)
    sheet_height = top + sum(height + size // 2 + count * line + gap for count in caption_lines)
    sheet = Image.new("RGB", (sheet_width, sheet_height), PAGE)
    draw = ImageDraw.Draw(sheet)
    for number, text in enumerate(title_lines):
        draw.text((gap, gap + number * title_line), text, fill=INK, font=_font(title_size))
    for row, count in zip(rows, caption_lines, strict=True):
        for column, index in enumerate(row):
            left = gap + column * (width + gap)
            picture = pictures[index]
            draw.rectangle((left, top, left + width - 1, top + height - 1), fill=MAT)
            aside, above = (width - picture.shape[1]) // 2, (height - picture.shape[0]) // 2
            sheet.paste(Image.fromarray(picture), (left + aside, top + above))
            for number, (text, color) in enumerate(captions[index]):
                draw.text((left, top + height + size // 2 + number * line), text, fill=color, font=_font(size))
        top += height + size // 2 + count * line + gap
    return np.asarray(sheet).copy()


def with_scale(picture: Picture, colors: Picture, ticks: Ticks) -> Picture:
    """Put a scale below a picture: a bar of colours with ticks and words.

    colors   (n, 3) uint8, from the left to the right
    ticks    in ascending order; words that have no room beside those before are left out, the last ones never
    """
    width = picture.shape[1]
    size = type_size(width)
    bar, mark = round(0.8 * size), max(2, size // 4)
    scale = Image.new("RGB", (width, size // 2 + bar + mark + round(_LEADING * size)), PAGE)
    draw = ImageDraw.Draw(scale)
    spread = colors[np.arange(width) * len(colors) // width]
    scale.paste(Image.fromarray(np.broadcast_to(spread, (bar, width, 3)).copy()), (0, size // 2))
    top = size // 2 + bar
    draw.rectangle((0, size // 2, width - 1, top - 1), outline=_RIM)
    places = [_place(share, words, width, size) for share, words in ticks]
    end = 0
    for (share, words), (left, right) in zip(ticks, places, strict=True):
        across = round(share * (width - 1))
        draw.line((across, size // 2, across, top + mark), fill=INK)
        last = (left, right) == places[-1]
        if left >= end and (last or right < places[-1][0] - size // 2):
            draw.text((left, top + mark), words, fill=SOFT, font=_font(size))
            end = right + size // 2
    return np.concatenate([picture, np.asarray(scale)])


def fit_picture(picture: Picture, width: int, height: int) -> Picture:
    """Scale a picture to the largest size within width x height; pixels of very small ones become sharp squares."""
    rows, columns = picture.shape[:2]
    share = min(width / columns, height / rows)
    if share == 1:
        return picture
    size = max(1, round(columns * share)), max(1, round(rows * share))
    how = Image.Resampling.NEAREST if share >= _SHARP else Image.Resampling.LANCZOS
    scaled: Picture = np.asarray(Image.fromarray(picture).resize(size, how))
    return scaled


def type_size(width: int) -> int:
    """Return the size of type, in pixels, that suits a picture of some width."""
    return int(min(_MAX_TYPE, max(_MIN_TYPE, round(width * _TYPE_SHARE))))


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)  # as a size is given
    return font


def _place(share: float, words: str, width: int, size: int) -> tuple[int, int]:
    """Return the left and right ends of a tick's words, moved inwards at the ends of the scale."""
    length = _font(size).getlength(words)
    left = min(max(share * (width - 1) - length / 2, 0), width - length)
    return round(left), round(left + length)


def _wrapped_caption(caption: str, size: int, width: int) -> list[tuple[str, tuple[int, int, int]]]:
    """Return the lines of a caption with their colours."""
    head, _, rest = caption.partition("\n")
    lines = [(line, INK) for line in _wrap(head, size, width)]
    return lines + [(line, SOFT) for paragraph in rest.splitlines() for line in _wrap(paragraph, size, width)]


def _wrap(text: str, size: int, width: int) -> list[str]:
    """Cut a text into lines no wider than `width`: between words, or inside longer ones, best at slashes."""
    font, lines = _font(size), [""]
    for word in text.encode("utf-8", "replace").decode().split():
        if lines[-1] and font.getlength(f"{lines[-1]} {word}") <= width:
            lines[-1] += f" {word}"
            continue
        if lines[-1]:
            lines.append("")
        whole = font.getlength(word) <= width
        for piece in [word] if whole else re.findall(r"[^/]+/?|/", word):
            if lines[-1] and font.getlength(lines[-1] + piece) > width:
                lines.append("")
            for letter in piece:
                if lines[-1] and font.getlength(lines[-1] + letter) > width:
                    lines.append("")
                lines[-1] += letter
    return lines if lines != [""] else []
