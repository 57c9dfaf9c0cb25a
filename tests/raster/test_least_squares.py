"""The least-squares image, compared with dense algebra and with images whose look-ups are known."""

import tracemalloc

import numpy as np
import pytest

from aoprecalc.raster import layout, resolve
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout, texel_positions
from aoprecalc.raster.padding import pad_and_fill
from aoprecalc.raster.resolve import LeastSquaresImage, resolve_texels
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Atlas
from aoprecalc.visibility.directions import texel_offset
from shapes import scene

SHAPES = [(4, 5), (1, 1), (1, 6), (7, 1), (2, 3)]  # rows, columns


def measurements(seed, shape, count):
    rng = np.random.default_rng(seed)
    at = (rng.random((count, 2)) * shape[::-1]).astype(np.float32)
    return at, rng.random(count), rng.random(count) + 0.1


def looked_up(picture, at, repeats):
    height, width = picture.shape
    return bilinear(picture, at / (width, -height) + (0, 1), repeats=repeats)


def fitted(shape, *parts, repeats=False, start=None):
    fit = LeastSquaresImage(shape[1], shape[0], repeats=repeats)
    for part in parts:
        fit.add_samples(*part)
    return fit.solve(np.zeros(shape, np.float32) if start is None else start)


def test_a_mean_of_nine_samples_counts_as_nine_seed_3(monkeypatch):
    monkeypatch.setattr(resolve, "_PRECISION", 1e-6)
    at, values, weights = measurements(3, (9, 7), 60)
    start = np.random.default_rng(4).random((9, 7)).astype(np.float32)
    each, means = (LeastSquaresImage(7, 9, repeats=False) for _ in range(2))
    each.add_samples(np.repeat(at, 9, axis=0), np.repeat(values, 9), np.repeat(weights, 9))
    means.add_samples(at, values, 9 * weights, means_of=9)
    assert means.solve(start) == pytest.approx(each.solve(start), abs=1e-5)


@pytest.mark.parametrize("repeats", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_it_solves_the_normal_equations(shape, repeats, monkeypatch):
    monkeypatch.setattr(resolve, "_PRECISION", 1e-6)
    at, values, weights = measurements(3, shape, 60)
    start = np.random.default_rng(4).random(shape).astype(np.float32)
    each = np.eye(start.size).reshape(-1, *shape)
    look_ups = np.column_stack([looked_up(texel, at.astype(float), repeats) for texel in each])
    prior = np.sqrt(resolve._PRIOR * weights.mean())
    root = np.sqrt(weights)[:, None]
    left = np.concatenate([root * look_ups, prior * np.eye(start.size)])
    right = np.concatenate([root[:, 0] * values, prior * start.ravel()])
    exact = np.linalg.lstsq(left, right, rcond=None)[0].reshape(shape)
    found = fitted(shape, (at, values, weights), repeats=repeats, start=start)
    assert found == pytest.approx(exact, abs=1e-5)


@pytest.mark.parametrize("repeats", [False, True])
def test_samples_of_a_picture_give_that_picture_back(repeats):
    picture = np.random.default_rng(0).random((9, 7)).astype(np.float32)
    at, _, weights = measurements(1, picture.shape, 5000)
    samples = at, looked_up(picture, at.astype(float), repeats), weights
    assert np.abs(fitted(picture.shape, samples, repeats=repeats, start=picture) - picture).max() < 1e-6
    # From a wrong start as good as so: the start counts as much as one sample a texel, of eighty.
    wrong = np.full_like(picture, 0.5)
    found = fitted(picture.shape, samples, repeats=repeats, start=wrong)
    assert np.abs(found - picture).max() < 0.1 * np.abs(wrong - picture).max()


def test_means_are_of_the_look_ups_that_read_a_texel():
    """Half-way between the second and the third of four texels: these two have that value, the outer ones none."""
    fit = LeastSquaresImage(4, 1, repeats=False)
    fit.add_samples(np.float32([(2.0, 0.5), (2.25, 0.5)]), np.float32([0.2, 0.8]), np.array([1.0, 2.0]))
    second = (0.2 * 1.0 * 0.5 + 0.8 * 2.0 * 0.25) / (1.0 * 0.5 + 2.0 * 0.25)
    third = (0.2 * 1.0 * 0.5 + 0.8 * 2.0 * 0.75) / (1.0 * 0.5 + 2.0 * 0.75)
    assert fit.mean_images()[0, 0] == pytest.approx([0, second, third, 0], abs=1e-6)


@pytest.mark.parametrize("repeats", [False, True])
def test_samples_at_their_spot_are_as_good_as_one_by_one(repeats):
    """Most at one spot of their texel, some moved from there, some in the texels at the edges."""
    rng = np.random.default_rng(8)
    row, column = np.divmod(np.arange(9 * 11), 11)
    spot = (0.3, 0.8)
    at = (np.column_stack([column, row]) + spot).astype(np.float32)
    at[::7] += rng.uniform(-0.2, 0.19, at[::7].shape).astype(np.float32)
    values, weights = rng.random(len(at)).astype(np.float32), rng.random(len(at)) + 0.1
    one_by_one = fitted((9, 11), (at, values, weights), repeats=repeats)
    assert fitted((9, 11), (at, values, weights, spot), repeats=repeats) == pytest.approx(one_by_one, abs=1e-5)
    halves = [(at[half], values[half], weights[half], spot) for half in (slice(0, 50), slice(50, None))]
    assert fitted((9, 11), *halves, repeats=repeats) == pytest.approx(one_by_one, abs=1e-5)


def samples_at_spots(seed, shape):
    """Samples of most texels of an image at one spot, then at another one, row by row."""
    rng = np.random.default_rng(seed)
    parts = []
    for spot in ((0.3, 0.8), (0.7, 0.1)):
        texel = np.flatnonzero(rng.random(shape) < 0.8)
        at = (np.column_stack(np.divmod(texel, shape[1])[::-1]) + spot).astype(np.float32)
        values, weights = rng.random(len(at)).astype(np.float32), rng.random(len(at)) + 0.1
        parts += [
            (*rows, spot) for rows in zip(*(np.array_split(part, 3) for part in (at, values, weights)), strict=True)
        ]
    return parts


def test_bands_change_no_bit_where_samples_come_in_their_order_seed_2(monkeypatch):
    shape = 23, 17
    parts = samples_at_spots(2, shape)
    whole = fitted(shape, *parts)
    for rows in (1, 2, 5, 22):
        monkeypatch.setattr(layout, "BAND_TEXELS", rows * shape[1])
        assert (fitted(shape, *parts) == whole).all()


def test_bands_in_any_order_are_as_good_seed_2(monkeypatch):
    shape = 23, 17
    parts = samples_at_spots(2, shape)
    whole = fitted(shape, *parts)
    monkeypatch.setattr(layout, "BAND_TEXELS", 2 * shape[1])
    for order in ([2, 1, 0, 3, 5, 4], [5, 4, 3, 2, 1, 0], [0, 3, 1, 4, 2, 5]):
        assert fitted(shape, *(parts[number] for number in order)) == pytest.approx(whole, abs=1e-5)


def most_images(work, shape):
    """How many images of 32 bits a call holds at a time, beyond what was there before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / (4 * shape[0] * shape[1])
    finally:
        tracemalloc.stop()


def test_what_waits_is_a_few_bands_and_a_solve_takes_four_images(monkeypatch):
    shape = 600, 512
    parts = samples_at_spots(1, shape)
    monkeypatch.setattr(layout, "BAND_TEXELS", shape[0] * shape[1] // 50)
    fit = LeastSquaresImage(shape[1], shape[0], repeats=False)
    small_parts = [
        (*rows, spot)
        for *part, spot in parts
        for rows in zip(*(np.array_split(each, 20) for each in part), strict=True)
    ]

    def add():
        for part in small_parts:
            fit.add_samples(*part)

    assert most_images(add, shape) < 1
    assert fit.sampled_texels().sum() > 0.9 * shape[0] * shape[1]
    start = np.zeros(shape, np.float32)
    assert 3.9 < most_images(lambda: fit.solve(start), shape) < 4.3


def test_only_the_shares_of_the_weights_count_and_none_is_no_sample():
    shape = 5, 6
    at, values, weights = measurements(5, shape, 200)
    found = fitted(shape, (at, values, weights))
    assert fitted(shape, (at, values, 1000 * weights)) == pytest.approx(found, abs=1e-4)
    some = weights > 0.5
    without = fitted(shape, (at[some], values[some], weights[some]))
    assert (fitted(shape, (at, values, np.where(some, weights, 0))) == without).all()
    assert np.abs(without - found).max() > 0.01


def test_two_parts_are_as_good_as_the_whole():
    shape = 6, 5
    at, values, weights = measurements(6, shape, 300)
    parts = [(at[part], values[part], weights[part]) for part in (slice(0, 120), slice(120, None))]
    assert fitted(shape, *parts) == pytest.approx(fitted(shape, (at, values, weights)), abs=1e-5)


def test_a_picture_that_wraps_has_no_first_texel():
    shape = 6, 8
    at, values, weights = measurements(7, shape, 200)
    found = fitted(shape, (at, values, weights), repeats=True)
    shifted = fitted(shape, ((at + (3, 2)) % np.float32([8, 6]), values, weights), repeats=True)
    assert np.roll(shifted, (-2, -3), axis=(0, 1)) == pytest.approx(found, abs=2e-3)
    beyond = fitted(shape, (at + np.float32([8, -12]), values, weights), repeats=True)
    assert beyond == pytest.approx(found, abs=1e-4)


def test_touched_are_the_texels_that_a_look_up_reads():
    fit = LeastSquaresImage(6, 5, repeats=False)
    fit.add_samples(np.float32([(2.75, 1.5), (0.2, 4.9), (5, 5)]), np.ones(3), np.array([1.0, 1.0, 0.0]))
    assert np.argwhere(fit.sampled_texels()).tolist() == [[1, 2], [1, 3], [4, 0]]


def test_without_samples_a_picture_stays_as_it_is():
    picture = np.random.default_rng(8).random((3, 4)).astype(np.float32)
    none = np.zeros((0, 2), np.float32), np.zeros(0), np.zeros(0)
    assert (fitted((3, 4), none, start=picture) == picture).all()
    assert (fitted((3, 4), measurements(9, (1, 1), 40), start=picture)[2:] == picture[2:]).all()


SIZE, GROUPS = 48, 16


def charts(seed):
    """The UVs of three triangles, turned at random, one of them narrow; none touches another."""
    rng = np.random.default_rng(seed)
    corners = np.array(
        [
            [(-0.1, -0.1), (0.14, -0.05), (-0.02, 0.13)],
            [(-0.15, -0.02), (0.15, 0), (0.1, 0.02)],
            [(0, 0), (0.1, 0), (0, 0.1)],
        ]
    )
    turns = np.linalg.qr(rng.normal(size=(3, 2, 2)))[0]
    return corners @ turns + [[(0.25, 0.3)], [(0.7, 0.25)], [(0.5, 0.7)]]


def sampled(uvs, value):
    """Paint what `value` gives at the places of samples, as a bake does; returns the texels, too."""
    atlas = Atlas("keep", uvs, np.ones(len(uvs), bool), len(uvs))
    made = scene(np.random.default_rng(0).random((len(uvs) * 3, 3)), np.arange(len(uvs) * 3).reshape(-1, 3), uvs)
    sampler = CPURasterizer(build_layout(made, atlas, SIZE, SIZE))
    texels = sampler.coverage()
    fit, sums = LeastSquaresImage(SIZE, SIZE, repeats=False), np.zeros((len(texels), 2))
    for group in range(GROUPS):
        samples = sampler.samples(texels, texel_offset(group))
        at, weights = texel_positions(atlas, texels, samples), (samples.faces >= 0).astype(float)
        found = value(at.astype(float))
        fit.add_samples(at, 1 - found, weights)
        sums += np.column_stack([weights * found, weights])
    measured = sums[:, 1] > 0
    means = np.divide(sums[:, 0], sums[:, 1], out=np.zeros(len(texels)), where=measured)
    return resolve_texels(texels, means.astype(np.float32), measured, fit)


@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_is_a_ramp_up_to_the_border(seed, monkeypatch):
    steep = np.array([0.008, -0.005])  # a texel

    def value(at):
        return 0.5 + (at - SIZE / 2) @ steep

    def error():
        """RMS of what look-ups all over the charts find, in what the value changes by within a texel."""
        painting = sampled(uvs, value)
        assert (painting.known & ~painting.valid).sum() > 20
        picture = pad_and_fill(painting, 1, "none").values
        off = bilinear(picture, points, repeats=False) - value(points * (SIZE, -SIZE) + (0, SIZE))
        return np.sqrt((off**2).mean()) / np.linalg.norm(steep)

    uvs, rng = charts(seed), np.random.default_rng(seed)
    chart = rng.integers(0, len(uvs), 5000)
    points = np.einsum("kc,kcx->kx", rng.dirichlet((1, 1, 1), len(chart)), uvs[chart])
    assert error() < 0.06
    monkeypatch.setattr(LeastSquaresImage, "solve", lambda self, picture, channel: picture)
    assert error() > 0.12  # the means of texels and copies of them


def test_open_stays_open_to_the_last_bit():
    painting = sampled(charts(0), lambda at: np.ones(len(at)))
    assert (painting.values[painting.known] == 1).all()
    assert (painting.values[~painting.known] == 0).all()
