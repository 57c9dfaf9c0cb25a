"""Errors are told as they are, and found where they are."""

import numpy as np
import pytest

from aoprecalc.metrics.errors import error_statistics, errors_per_mip_level, worst_points
from aoprecalc.render.comparison import BACKGROUND, error_heat_map, heat_map_size
from aoprecalc.types import Texels

UVS = np.random.default_rng(0).random((4000, 2))
POSITIONS = np.column_stack([UVS, np.zeros(len(UVS))])


@pytest.mark.parametrize("error", [-0.25, 0.125])
def test_a_constant_error_is_the_bias_and_the_rmse(error):
    picture = np.full((32, 32), 0.5 + error, np.float32)
    levels = errors_per_mip_level(picture, UVS, np.full(len(UVS), 0.5), repeats=False)
    assert len(levels) == 5
    for level in levels:
        assert level.bias == error
        assert {level.rmse, level.p50, level.p95, level.p99, level.max} == {abs(error)}


def test_a_small_picture_has_fewer_levels():
    assert len(errors_per_mip_level(np.ones((4, 2), np.float32), UVS, np.ones(len(UVS)), repeats=True)) == 3


def test_percentiles_are_of_magnitudes():
    found = error_statistics(np.linspace(-1, 1, 2001))
    assert (found.p50, found.p95, found.max) == pytest.approx((0.5, 0.95, 1))
    assert found.bias == pytest.approx(0)
    assert found.rmse == pytest.approx(1 / 3**0.5, abs=1e-3)


def test_a_wrong_patch_is_found_once_at_its_place():
    values = np.ones(len(UVS))
    patch = np.linalg.norm(UVS - (0.25, 0.75), axis=1) < 0.01
    values[patch] = 0.25
    assert patch.sum() > 0
    (place,) = worst_points(POSITIONS, UVS, values, np.ones(len(UVS)), diagonal=2.0)
    assert place.uv == pytest.approx((0.25, 0.75), abs=0.01)
    assert place.position[:2] == place.uv
    assert (place.value, place.reference, place.error) == (0.25, 1, -0.75)


def test_worst_places_are_sorted_and_apart():
    values = np.random.default_rng(1).random(len(UVS))
    places = worst_points(POSITIONS, UVS, values, np.zeros(len(UVS)), diagonal=2**0.5)
    errors = [place.error for place in places]
    assert len(places) == 10
    assert errors[0] == values.max()
    assert errors == sorted(errors, reverse=True)
    at = np.array([place.position for place in places])
    apart = np.linalg.norm(at[:, None] - at, axis=2)[~np.eye(10, dtype=bool)]
    assert apart.min() > 0.01 * 2**0.5


def test_where_all_is_right_there_is_no_worst_place():
    assert worst_points(POSITIONS, UVS, np.ones(len(UVS)), np.ones(len(UVS)), diagonal=1.0) == ()


def texels(width, height, mask):
    return Texels(width, height, np.flatnonzero(mask).astype(np.int32))


def test_the_heat_map_is_white_where_right_red_where_too_bright_and_blue_where_too_dark():
    errors = np.where(UVS[:, 0] < 0.4, 0.5, np.where(UVS[:, 1] < 0.5, -0.05, 0.0))
    covered = np.ones((64, 64), bool)
    covered[:, :8] = False
    picture = error_heat_map(texels(64, 64, covered), UVS, errors, repeats=False)
    assert picture.shape == (64, 64, 3)
    assert picture[10, 4].tolist() == list(BACKGROUND)
    assert picture[10, 12].tolist() == [255, 0, 0]
    assert picture[60, 60].tolist() == [128, 128, 255]  # v upwards: a low v is far down
    assert picture[4, 60].tolist() == [255, 255, 255]


def test_the_nearest_point_may_be_across_the_edge_of_a_repeating_picture():
    uvs, errors = np.array([[1.98, 0.5], [0.3, 0.5]]), np.array([1.0, 0.0])
    whole = texels(100, 10, np.ones((10, 100), bool))
    assert error_heat_map(whole, uvs, errors, repeats=True)[5, 0].tolist() == [255, 0, 0]
    assert error_heat_map(whole, uvs % 1, errors, repeats=False)[5, 0].tolist() == [255, 255, 255]


@pytest.mark.parametrize(
    ("texture", "expected"),
    [((1024, 512), (1024, 512)), ((64, 64), (512, 512)), ((8192, 4096), (2048, 1024)), ((300, 200), (600, 400))],
)
def test_heat_maps_are_neither_tiny_nor_huge(texture, expected):
    assert heat_map_size(*texture) == expected
