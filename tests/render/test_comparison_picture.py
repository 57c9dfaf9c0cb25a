"""The picture of a comparison shows each tile's values in its colours, with the scale of these colours below."""

import numpy as np
import pytest

from aoprecalc.metrics.difference import PicturePair
from aoprecalc.render.comparison import TILE_MAX_SIZE, TILE_MIN_SIZE, comparison_picture, diverging_colors


def flat(value, shape=(256, 256)):
    return np.full(shape, value, np.float32)


def tiles(picture, width, height, count=4):
    """The tiles of a picture, each of a given size, all in the upper row and as far apart as from the edges."""
    gap = (picture.shape[1] - count * width) // (count + 1)
    lefts = [gap + number * (width + gap) for number in range(count)]
    return [picture[gap : gap + height, left : left + width] for left in lefts]


def test_tiles_have_the_colours_of_their_values():
    picture = comparison_picture(PicturePair(flat(0.75), flat(0.6875), flat(0.5)))
    # greys as stored; 0.625 of full blue at a difference of -0.0625; red full and green half at a FLIP of 0.5
    for tile, color in zip(tiles(picture, 256, 256), [191, 175, (96, 96, 255), (255, 128, 0)], strict=True):
        assert tile.shape == (256, 256, 3)
        assert (tile == color).all()


@pytest.mark.parametrize(("difference", "color"), [(0.1, (255, 0, 0)), (0.5, (255, 0, 0)), (-0.1, (0, 0, 255))])
def test_a_tenth_has_full_colour(difference, color):
    picture = comparison_picture(PicturePair(flat(0.5), flat(0.5 + difference), flat(0)))
    assert (tiles(picture, 256, 256)[2] == color).all()
    assert (tiles(picture, 256, 256)[3] == 0).all()


@pytest.mark.parametrize("value", [0.0, 0.1, 0.3, 0.4, 0.6, 0.7, 0.9])
def test_flip_grows_brighter(value):
    found = [
        tiles(comparison_picture(PicturePair(flat(0), flat(0), flat(flip))), 256, 256)[3][0, 0].sum()
        for flip in (value, value + 0.1)
    ]
    assert found[0] < found[1]


def test_the_scale_of_differences_has_the_colours_of_the_tile():
    """The colour at a place along the scale is that of a tile with the difference which the scale says is there."""
    picture = comparison_picture(PicturePair(flat(0.5), flat(0.5), flat(0)))
    gap = (picture.shape[1] - 4 * 256) // 5
    below = picture[gap + 256 :, gap + 2 * (256 + gap) :][:, :256]
    expected = diverging_colors(np.linspace(-0.1, 0.1, 256))
    assert sum(np.array_equal(row[1:127], expected[1:127]) for row in below) > 5


def test_the_names_are_below():
    pair = PicturePair(flat(0.5), flat(0.5), None)
    one, other = (comparison_picture(pair, names) for names in (("A: x.png", "B"), ("A: y.png", "B")))
    assert one.shape == other.shape
    differing = np.argwhere((one != other).any(axis=2))
    assert len(differing)
    assert differing[:, 0].min() > 256
    assert differing[:, 1].max() < one.shape[1] // 2  # those of A


def test_small_pictures_are_shown_in_larger_pixels():
    values = np.random.default_rng(0).random((5, 10)).astype(np.float32)
    times = -(-TILE_MIN_SIZE // 10)
    first = tiles(comparison_picture(PicturePair(values, values, values)), 10 * times, 5 * times)[0]
    assert first.shape == (5 * times, 10 * times, 3)
    np.testing.assert_array_equal(first[::times, ::times, 0], np.floor(values * 255.0 + 0.5))


@pytest.mark.parametrize("size", [(2048, 1500), (1025, 3000)])
def test_large_pictures_are_shrunk_by_the_mean(size):
    values = np.random.default_rng(0).random(size).astype(np.float32)
    side = -(-max(size) // TILE_MAX_SIZE)
    rows, columns = (-(-length // side) for length in size)
    first = tiles(comparison_picture(PicturePair(values, values, values)), columns, rows)[0]
    assert first.shape == (rows, columns, 3)
    for row, column in ((0, 0), (7, 11), (rows - 1, columns - 1)):
        block = values[row * side : (row + 1) * side, column * side : (column + 1) * side]
        assert abs(int(first[row, column, 0]) - 255 * block.mean()) <= 0.51


def test_pictures_of_different_sizes_are_shown_alone():
    picture = comparison_picture(PicturePair(flat(1, (256, 300)), flat(0, (400, 256)), None))
    first, second = tiles(picture, 300, 400, 2)
    for tile, value, rows, columns in ((first, 255, 256, 300), (second, 0, 400, 256)):
        there = (tile == value).all(axis=2)
        assert there.any(axis=1).sum() >= rows
        assert there.any(axis=0).sum() >= columns
        assert rows * columns <= there.sum() < 1.05 * rows * columns  # its scale has the value, too
