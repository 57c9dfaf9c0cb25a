"""Padding and filling, against slow references."""

import numpy as np
import pytest

from aoprecalc.model import Texels
from aoprecalc.texspace import finish as finish_module
from aoprecalc.texspace.finish import finish, pad, push_pull


def islands(seed, height=40, width=56):
    rng = np.random.default_rng(seed)
    valid = rng.random((height, width)) > 0.97
    return np.where(valid, rng.random((height, width)), 0).astype(np.float32), valid


def slow_pad(picture, valid, reach, wraps):
    """For every texel, look at every valid one."""
    height, width = valid.shape
    rows, columns = np.nonzero(valid)
    result, known, tied = np.zeros_like(picture), np.zeros_like(valid), np.zeros_like(valid)
    for row in range(height):
        for column in range(width):
            down, across = np.abs(rows - row), np.abs(columns - column)
            if wraps:
                down, across = np.minimum(down, height - down), np.minimum(across, width - across)
            away = down**2 + across**2
            if away.min() <= reach * reach:
                known[row, column] = True
                tied[row, column] = (away == away.min()).sum() > 1
                result[row, column] = picture[rows[away.argmin()], columns[away.argmin()]]
    return result, known, tied


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_padding_copies_the_nearest_valid_texel(seed, wraps, monkeypatch):
    monkeypatch.setattr(finish_module, "_BAND_ROWS", 7)
    picture, valid = islands(seed)
    got, known = pad(picture, valid, 4, wraps=wraps)
    expected, expected_known, tied = slow_pad(picture, valid, 4, wraps)
    assert (known == expected_known).all()
    assert (got == expected)[~tied].all()
    assert np.isin(got[known], picture[valid]).all()


def test_padding_leaves_valid_texels_and_does_nothing_at_reach_0():
    picture, valid = islands(1)
    assert (pad(picture, valid, 6)[0][valid] == picture[valid]).all()
    got, known = pad(picture, valid, 0)
    assert (known == valid).all()
    assert (got == picture).all()


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


def texels_of(valid):
    return Texels(valid.shape[1], valid.shape[0], np.flatnonzero(valid).astype(np.int32))


def test_the_fill_is_the_mean_of_the_measured_texels_so_that_coarse_mips_keep_it():
    picture, valid = islands(3)
    texture = finish(texels_of(valid), picture[valid], np.ones(valid.sum(), bool), 0, "mean")
    assert texture.values[~valid] == pytest.approx(picture[valid].mean())
    assert texture.values.mean() == pytest.approx(picture[valid].mean(), abs=1e-6)


def test_texels_that_were_not_measured_are_not_valid_and_take_a_neighbours_value():
    valid = np.zeros((4, 6), bool)
    valid[1, 1:4] = True
    texture = finish(texels_of(valid), np.array([0.2, 0.9, 0.4], np.float32), np.array([True, False, True]), 1, "none")
    assert texture.valid.sum() == 2
    assert texture.values[1, 2] in (np.float32(0.2), np.float32(0.4))
    assert texture.values[3, 5] == 0


def test_nothing_measured_gives_an_empty_picture():
    valid = np.ones((2, 2), bool)
    texture = finish(texels_of(valid), np.zeros(4, np.float32), np.zeros(4, bool), 2, "mean")
    assert not texture.valid.any()
    assert (texture.values == 0).all()
