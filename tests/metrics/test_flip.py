"""FLIP agrees with the authors' program, and with values computed by hand."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from aoprecalc.metrics.difference import flip

ROWS, COLUMNS = np.mgrid[0:90, 0:120]
WAVES = 0.5 + 0.5 * np.sin(0.2 * COLUMNS) * np.cos(0.13 * ROWS)
CORNER = (COLUMNS > ROWS).astype(float)
CHECKS = ((COLUMNS // 7 + ROWS // 5) % 2).astype(float)
PAIRS = {
    "waves, moved": (WAVES, np.roll(WAVES, 3, axis=1)),
    "an edge, moved and darkened": (CORNER, np.roll(CORNER, 2, axis=0) * 0.9),
    "checks, lost": (CHECKS * 0.4, np.full_like(CHECKS, 0.2)),
    "black and white": (np.zeros_like(WAVES), np.ones_like(WAVES)),
}

# Mean and greatest values at 67 and at 30 pixels a degree, by the PyPI package flip-evaluator 1.7 on PAIRS, taken for
# linear light (evaluate(..., "LDR", inputsRGB=False, applyMagma=False, parameters={"ppd": ...})).
EXPECTED = {
    "waves, moved": {67: (0.335174, 0.971633), 30: (0.311194, 0.975231)},
    "an edge, moved and darkened": {67: (0.174862, 0.98877), 30: (0.153435, 0.990767)},
    "checks, lost": {67: (0.48729, 0.953812), 30: (0.721304, 0.946439)},
    "black and white": {67: (0.967392, 0.967392), 30: (0.967384, 0.967384)},
}


@pytest.mark.parametrize("case", PAIRS)
def test_values_of_the_authors_program(case):
    first, second = PAIRS[case]
    for pixels, (mean, maximum) in EXPECTED[case].items():
        found = flip(np.float32(first), np.float32(second), pixels)
        assert found.mean() == pytest.approx(mean, abs=5e-5)
        assert found.max() == pytest.approx(maximum, abs=5e-4)


def reference_flip(first, second, pixels_per_degree):
    """FLIP of grey pictures by the authors' program."""
    evaluator = pytest.importorskip("flip_evaluator")  # not for Python 3.14

    pictures = [np.repeat(np.float32(picture)[:, :, None], 3, axis=2) for picture in (first, second)]
    parameters = {"ppd": float(pixels_per_degree)}
    return evaluator.evaluate(*pictures, "LDR", inputsRGB=False, applyMagma=False, parameters=parameters)[0][:, :, 0]


@pytest.mark.parametrize("case", PAIRS)
def test_beside_the_authors_program(case):
    first, second = (np.float32(picture) for picture in PAIRS[case])
    assert np.abs(flip(first, second) - reference_flip(first, second, 67)).max() < 5e-4


@pytest.mark.parametrize("pixels_per_degree", [30, 67])
@pytest.mark.parametrize("shape", [(60, 80), (5, 9), (700, 24)], ids=["usual", "tiny", "higher than a chunk"])
@pytest.mark.parametrize("blur", [0.0, 1.5])
def test_random_pictures_beside_the_authors_program(blur, shape, pixels_per_degree):
    rng = np.random.default_rng([*shape, pixels_per_degree])
    first, second = (gaussian_filter(rng.random(shape, np.float32), blur) for _ in range(2))
    expected = reference_flip(first, second, pixels_per_degree)
    assert np.abs(flip(first, second, pixels_per_degree) - expected).max() < 2e-4


def test_equal_pictures_have_no_difference():
    assert not flip(np.float32(WAVES), np.float32(WAVES)).any()


@pytest.mark.parametrize("case", PAIRS)
def test_symmetric_and_between_0_and_1(case):
    first, second = (np.float32(picture) for picture in PAIRS[case])
    found = flip(first, second)
    np.testing.assert_array_equal(found, flip(second, first))
    assert found.dtype == np.float32
    assert found.shape == first.shape
    assert found.min() >= 0
    assert 0 < found.max() <= 1


def largest():
    """The paper's c_max: the Hunt-adjusted HyAB distance of green and blue, to the power 0.7."""
    to_xyz = np.array(
        [
            [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
            [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
            [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
        ]
    )
    green, blue = ([0, 1, 0] @ to_xyz.T / to_xyz.sum(axis=1), [0, 0, 1] @ to_xyz.T / to_xyz.sum(axis=1))
    hunted = []
    for color in (green, blue):
        x, y, z = np.where(color > (6 / 29) ** 3, np.cbrt(color), color / (3 * (6 / 29) ** 2) + 4 / 29)
        lightness = 116 * y - 16
        hunted.append((lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)))
    apart = np.subtract(*hunted)
    return (abs(apart[0]) + np.hypot(*apart[1:])) ** 0.7


@pytest.mark.parametrize(("lightness", "beyond"), [(100, True), (50, False)])
def test_uniform_greys_have_the_difference_of_the_formula(lightness, beyond):
    grey = ((lightness + 16) / 116) ** 3  # linear light of that CIE lightness, against black
    power, most = lightness**0.7, largest()
    below, above = 0.95 * power / (0.4 * most), 0.95 + 0.05 * (power - 0.4 * most) / (0.6 * most)
    found = flip(np.zeros((30, 40), np.float32), np.full((30, 40), grey, np.float32))
    assert found == pytest.approx(np.full((30, 40), above if beyond else below), abs=1e-5)


def test_values_are_clamped_to_0_and_1():
    wild = np.float32(WAVES * 4 - 1)
    np.testing.assert_array_equal(flip(wild, np.float32(CORNER)), flip(wild.clip(0, 1), np.float32(CORNER)))


def test_a_tall_picture_equals_its_parts():
    rng = np.random.default_rng(0)
    first, second = rng.random((2, 1300, 24), dtype=np.float32)
    whole = flip(first, second)
    for start, stop in ((400, 700), (900, 1200)):
        part = flip(first[start:stop], second[start:stop])
        np.testing.assert_allclose(whole[start + 20 : stop - 20], part[20:-20], atol=1e-6)
    turned = flip(np.ascontiguousarray(first.T), np.ascontiguousarray(second.T))
    np.testing.assert_allclose(whole, turned.T, atol=1e-6)
