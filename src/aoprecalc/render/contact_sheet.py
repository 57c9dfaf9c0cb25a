"""Contact sheets: pictures in a grid, each with a caption; and scales that say what colours stand for.

The font is the one inside Pillow, Aileron, which has ASCII alone; it needs no files and looks the same everywhere.
"""

import re
from collections.abc import Sequence
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from aoprecalc.types import Picture

Ticks = Sequence[tuple[float, str]]  # where along a scale, in [0, 1], and the words there

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
