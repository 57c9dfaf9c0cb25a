"""Padding and filling, against slow references."""

import numpy as np
import pytest

from aoprecalc.raster import padding
from aoprecalc.raster.padding import find_padding, finish, pad, pad_and_fill, push_pull
from aoprecalc.raster.resolve import LeastSquaresImage, ResolvedTexture, lighter_of_sides, resolve_texels
from aoprecalc.types import Texels


def islands(seed, height=40, width=56):
    rng = np.random.default_rng(seed)
    valid = rng.random((height, width)) > 0.97
    return np.where(valid, rng.random((height, width)), 0).astype(np.float32), valid


def slow_pad(picture, valid, reach, repeats):
    """For every texel, look at every valid one."""
    height, width = valid.shape
    rows, columns = np.nonzero(valid)
    result, known, tied = np.zeros_like(picture), np.zeros_like(valid), np.zeros_like(valid)
    for row in range(height):
        for column in range(width):
            down, across = np.abs(rows - row), np.abs(columns - column)
            if repeats:
                down, across = np.minimum(down, height - down), np.minimum(across, width - across)
            away = down**2 + across**2
            if away.min() <= reach * reach:
                known[row, column] = True
                tied[row, column] = (away == away.min()).sum() > 1
                result[row, column] = picture[rows[away.argmin()], columns[away.argmin()]]
    return result, known, tied


@pytest.mark.parametrize("repeats", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_padding_copies_the_nearest_valid_texel(seed, repeats, monkeypatch):
    monkeypatch.setattr(padding, "_BAND_ROWS", 7)
    picture, valid = islands(seed)
    got, found = pad(picture, valid, 4, repeats=repeats), find_padding(valid, 4, repeats=repeats)
    known = valid.copy()
    known.ravel()[found.texels] = True
    assert np.unique(found.texels).size == known.sum() - valid.sum()
    expected, expected_known, tied = slow_pad(picture, valid, 4, repeats)
    assert (known == expected_known).all()
    assert (got == expected)[~tied].all()
    assert np.isin(got[known], picture[valid]).all()


def test_padding_leaves_valid_texels_and_does_nothing_at_reach_0():
    picture, valid = islands(1)
    assert (pad(picture, valid, 6)[valid] == picture[valid]).all()
    assert not len(find_padding(valid, 0).texels)
    assert (pad(picture, valid, 0) == picture).all()


@pytest.mark.parametrize("fill", ["mean", "pushpull", "none"])
def test_channels_are_padded_and_filled_one_as_the_other(fill):
    pictures, valid = [islands(4)[0], 2 * islands(4)[0] - islands(4)[1]], islands(4)[1]
    found = find_padding(valid, 3)
    together = finish(np.stack(pictures, axis=-1), valid, valid, found, fill)
    for channel, picture in enumerate(pictures):
        assert (together[..., channel] == finish(picture, valid, valid, found, fill)).all()


def test_push_pull_keeps_what_is_known_and_stays_between():
    picture, valid = islands(2)
    filled = push_pull(picture, valid)
    assert (filled[valid] == picture[valid]).all()
    assert filled.min() >= picture[valid].min() - 1e-6
    assert filled.max() <= picture[valid].max() + 1e-6
    constant = push_pull(np.where(valid, np.float32(0.375), 0), valid)
    assert constant == pytest.approx(0.375)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (33, 2), (17, 31)])
def test_push_pull_fills_any_shape(shape):
    known = np.zeros(shape, bool)
    known[-1, -1] = True
    assert push_pull(np.where(known, np.float32(0.5), 0), known) == pytest.approx(0.5)


def painted(picture, valid, measured=True):
    """Paint the texels in `valid`, of which only those in `measured` count, each by a sample at its centre."""
    height, width = valid.shape
    texels = Texels(width, height, np.flatnonzero(valid).astype(np.int32))
    values, measured = picture[valid], np.broadcast_to(measured, valid.shape)[valid]
    fit = LeastSquaresImage(width, height, repeats=False)
    centres = (np.argwhere(valid)[:, ::-1] + 0.5).astype(np.float32)
    fit.add_samples(centres, 1.0 - values.astype(float), measured.astype(float))
    return resolve_texels(texels, values, measured, fit)


def test_the_fill_is_the_mean_of_the_measured_texels_so_that_coarse_mips_keep_it():
    picture, valid = islands(3)
    texture = pad_and_fill(painted(picture, valid), 0, "mean")
    assert texture.values[~valid] == pytest.approx(picture[valid].mean())
    assert texture.values.mean() == pytest.approx(picture[valid].mean(), abs=1e-6)


def test_texels_that_were_not_measured_are_not_valid_and_take_a_neighbours_value():
    valid = np.zeros((4, 6), bool)
    valid[1, 1:4] = True
    picture = np.where(valid, np.array([0, 0.2, 0.9, 0.4, 0, 0], np.float32), 0)
    texture = pad_and_fill(painted(picture, valid, measured=picture < 0.5), 1, "none")
    assert texture.valid.sum() == 2
    assert texture.values[1, 2] in (texture.values[1, 1], texture.values[1, 3])
    assert texture.values[1, [1, 3]] == pytest.approx([0.2, 0.4])
    assert texture.values[3, 5] == 0


def test_nothing_measured_gives_an_empty_picture():
    texture = pad_and_fill(painted(np.zeros((2, 2), np.float32), np.ones((2, 2), bool), measured=False), 2, "mean")
    assert not texture.valid.any()
    assert (texture.values == 0).all()


def test_the_lighter_of_two_paintings_counts_a_texel_that_either_knows():
    first, second = (
        ResolvedTexture(np.array([values], np.float32), np.array([known]), np.array([valid]))
        for values, known, valid in (
            ([0.2, 0.7, 0.0, 0.4], [True, True, False, True], [True, True, False, False]),
            ([0.3, 0.0, 0.0, 0.1], [True, False, False, True], [True, False, False, True]),
        )
    )
    both = lighter_of_sides(first, second)
    assert both.values.tolist() == [np.array([0.3, 0.7, 0.0, 0.4], np.float32).tolist()]
    assert both.known.tolist() == [[True, True, False, True]]
    assert both.valid.tolist() == [[True, True, False, True]]
