"""Contact sheets hold every picture unchanged at its place, all words of its caption, and equal bytes each time."""

import numpy as np
import pytest
from PIL import ImageFont

from aoprecalc.render.comparison import INK, MAT, PAGE, SOFT, contact_sheet, fit_picture, type_size, with_scale


def noise(height, width, seed=0):
    """A picture whose colours are none of the sheet's: they are below 20."""
    return np.random.default_rng(seed).integers(0, 20, (height, width, 3), np.uint8)


def places(sheet, picture):
    """The upper left corners at which a picture stands in a sheet, as (row, column)."""
    height, width = picture.shape[:2]
    found = np.argwhere((sheet == picture[0, 0]).all(axis=2))
    return [tuple(at) for at in found if np.array_equal(sheet[at[0] :, at[1] :][:height, :width], picture)]


def test_each_picture_is_there_once_in_reading_order_and_centred():
    pictures = [noise(60, 80, 1), noise(100, 40, 2), noise(30, 80, 3), noise(100, 80, 4), noise(20, 20, 5)]
    sheet = contact_sheet([(picture, f"number {index}") for index, picture in enumerate(pictures)], 2)
    corners = [places(sheet, picture) for picture in pictures]
    assert [len(found) for found in corners] == [1] * 5
    middles = np.array([found[0] for found in corners]) + [np.array(picture.shape[:2]) / 2 for picture in pictures]
    assert middles[0, 0] == middles[1, 0] < middles[2, 0] == middles[3, 0] < middles[4, 0]
    assert middles[0, 1] == middles[2, 1] == middles[4, 1] < middles[1, 1] == middles[3, 1]


def test_what_is_no_picture_is_page_mat_or_type():
    sheet = contact_sheet([(noise(50, 100), "A caption\nand its explanation"), (noise(50, 50), "")], 2, "A title")
    others = (sheet.reshape(-1, 3) >= 20).all(axis=1)
    grey = sheet.reshape(-1, 3)[others].astype(int)
    assert (np.abs(np.diff(grey, axis=1)) <= 12).all()  # neutral
    known = {tuple(color) for color in np.unique(grey, axis=0)}
    assert {PAGE, MAT, INK, SOFT} <= known


def test_type_is_readable_on_the_page():
    """The contrast ratio of WCAG 2.2 is at least 4.5, its level AA."""

    def luminance(color):
        share = np.array(color) / 255
        linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        return linear @ (0.2126, 0.7152, 0.0722)

    for color in (INK, SOFT):
        assert (luminance(PAGE) + 0.05) / (luminance(color) + 0.05) >= 4.5
    assert type_size(64) >= 13


@pytest.mark.parametrize("caption", ["word " * 30, "folder/" * 40 + "file.png", "x" * 200])
def test_long_captions_are_wrapped_and_lose_nothing(caption):
    picture = noise(40, 200)
    sheet, short = contact_sheet([(picture, caption)], 1), contact_sheet([(picture, "x")], 1)
    assert sheet.shape[1] == short.shape[1]
    size = type_size(200)
    lines = round((len(sheet) - len(short)) / round(1.32 * size)) + 1
    assert lines >= ImageFont.load_default(size).getlength(caption.strip()) / 200
    below = sheet[places(sheet, picture)[0][0] + 40 :]
    gap = round(1.5 * size)
    assert (below[:, -gap:] == PAGE).all()  # nothing beyond the right margin
    assert (below[:, : gap - 1] == PAGE).all()  # a letter may begin a pixel before its place


def test_names_that_are_no_text_do_not_stop_it():
    picture = noise(20, 120)
    for caption in ("\udcff.obj", "a\0b", "\u4e2d\u6587.obj", "\n\n", " "):
        assert len(places(contact_sheet([(picture, caption)], 3), picture)) == 1


def test_equal_input_gives_equal_bytes():
    cells = [(noise(80, 90, index), f"caption {index}\nmore") for index in range(3)]
    assert contact_sheet(cells, 2, "title").tobytes() == contact_sheet(cells, 2, "title").tobytes()


def test_pictures_are_fitted_to_cells():
    small = noise(10, 20)
    np.testing.assert_array_equal(fit_picture(small, 60, 35), small.repeat(3, axis=0).repeat(3, axis=1))
    assert fit_picture(noise(80, 40), 100, 100).shape == (100, 50, 3)
    assert fit_picture(noise(400, 200), 100, 100).shape == (100, 50, 3)
    sheet = contact_sheet([(small, ""), (noise(400, 200), "")], 2, cell_size=(100, 100))
    assert len(places(sheet, small.repeat(5, axis=0).repeat(5, axis=1))) == 1


def test_a_scale_shows_its_colours_in_order():
    picture = noise(30, 256)
    colors = np.column_stack([np.arange(256), np.zeros(256), 255 - np.arange(256)]).astype(np.uint8)
    scaled = with_scale(picture, colors, [(0.0, "0"), (0.5, "half"), (1.0, "1")])
    np.testing.assert_array_equal(scaled[:30], picture)
    bars = [row for row in scaled[30:] if np.array_equal(row[1:127], colors[1:127])]
    assert len(bars) > 5


def test_ticks_stand_where_their_values_are():
    scaled = with_scale(noise(8, 201), np.full((2, 3), 128, np.uint8), [(0.0, "0"), (0.25, "1"), (1.0, "4")])
    marked = [column for column in range(201) if ((scaled[8:, column] == INK).all(axis=1)).sum() > 8]
    assert marked == [0, 50, 200]
