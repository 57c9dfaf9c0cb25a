"""The value that is baked, from its sums and from whole bakes."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.io.images import quantize
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.texture_lookup import bilinear
from aoprecalc.visibility import integrand
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.integrand import Integrand, sampling_error
from shapes import ball, quad, scene


def test_ratio_is_the_quotient_and_needs_a_denominator():
    values, measured = Integrand().estimate(np.array([[1.0, 4.0], [0.0, 2.0], [3.0, 3.0], [0.0, 0.0]]), 100)
    assert values.tolist() == [0.25, 0.0, 1.0, 0.0]
    assert measured.tolist() == [True, True, True, False]


def test_mean_is_the_sources_sum_and_may_exceed_one():
    values, _ = Integrand("mean").estimate(np.array([[10.0, 25.0], [30.0, 31.0]]), 100)
    assert values.tolist() == pytest.approx([0.4, 1.2])


def test_random_directions_exceed_one_but_never_wrap():
    """Equation 1.1.1.1 by random directions: some open texels sum to more than 1, to be stored as 255, never as 0."""
    shape = scene(*ball(2))
    options = BakeOptions(width=64, height=64, directions=50, sampling="random", seed=3, estimator="mean")
    texture = bake_scene(shape, options).texture
    stored = quantize(texture.values, "8")[texture.valid]
    assert texture.values.max() == 1.0
    assert (stored == 255).any()
    assert stored.min() > 100


def test_random_directions_follow_the_seed():
    shape = scene(*ball(1))
    pictures = [
        bake_scene(
            shape,
            BakeOptions(width=32, height=32, directions=64, sampling="random", seed=seed, estimator="mean"),
        ).texture.values
        for seed in (1, 1, 2)
    ]
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0] != pictures[2]).any()


def test_an_odd_number_of_directions_is_rounded_up_and_said():
    baked = bake_scene(scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0))), BakeOptions(width=16, height=16, directions=99))
    assert baked.directions == 100
    assert "100 directions" in baked.notes[0]


def test_mean_darkens_where_shading_and_geometry_part_as_the_house_rule_says():
    """For an open flat face with shading normal n and geometric normal g, mean tends to (1 + n.g) / 2."""
    tilt = np.array([np.sin(0.8), 0, np.cos(0.8)])
    normals = np.broadcast_to(tilt, (2, 3, 3))
    plane = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), normals=normals)
    for estimator, expected in (("ratio", 1.0), ("mean", (1 + np.cos(0.8)) / 2)):
        options = BakeOptions(width=16, height=16, directions=4000, estimator=estimator, backend="ray")
        baked = bake_scene(plane, options)
        points = sample_surface(plane, baked.atlas.mapped, 2000, seed=0)
        found = bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs), repeats=False)
        assert found == pytest.approx(expected, abs=0.003)
        assert found.mean() == pytest.approx(expected, abs=5e-4)


def test_mean_by_random_directions_is_the_sum_over_just_these():
    normals = np.broadcast_to(np.array([np.sin(0.8), 0, np.cos(0.8)]), (2, 3, 3))
    plane = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), normals=normals)
    options = BakeOptions(size=64, directions=2000, sampling="random", seed=1, estimator="mean")
    half = light_axes(2000, "random", seed=1)
    both = np.concatenate([half, -half])
    expected = 4 / 2000 * np.maximum(0, both @ normals[0, 0])[both[:, 2] > 0].sum()
    texture = bake_scene(plane, options).texture
    assert texture.values[texture.valid].mean() == pytest.approx(expected, abs=5e-4)


def test_a_shading_normal_behind_the_surface_gives_way_to_the_geometric_one():
    """Corners whose normals point away from the face: where they prevail, n := g, and the face is as open as ever."""
    up, down = (0, 0, 1), (0, 0, -1)
    normals = np.array([[down, down, up], [down, up, up]])
    plane = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), normals=normals)
    options = BakeOptions(width=64, height=64, directions=1000, estimator="mean")
    texture = bake_scene(plane, options).texture
    assert texture.values[texture.valid].min() > 0.98


@pytest.mark.parametrize(("first", "second"), [(500, 500), (640, 128)])
def test_random_halves_of_any_size_tell_the_error_of_their_sum_seed_4(first, second, monkeypatch):
    rng, texels, share = np.random.default_rng(4), 20_000, 0.3
    visible = np.stack([rng.binomial(count, share, texels) for count in (first, second)])
    halves = np.stack([visible, np.broadcast_to([[first], [second]], visible.shape)], axis=2).astype(float)
    told = sampling_error(halves, [first, second], Integrand(), "random")
    assert told == pytest.approx(np.sqrt(share * (1 - share) / (first + second)), rel=0.03)
    monkeypatch.setattr(integrand, "_CHUNK", 999)
    assert sampling_error(halves, [first, second], Integrand(), "random") == pytest.approx(told, rel=1e-9)


@pytest.mark.parametrize("part", [0.5, 0.2, 0.05])
def test_even_halves_of_any_size_tell_the_error_of_their_sum_seed_5(part):
    """Halves whose errors fall as N^-3/4 and complete each other to an error of the whole that does so too."""
    rng, texels, whole = np.random.default_rng(5), 50_000, 0.01
    counts = np.array([part, 1 - part]) * 1000
    spread = whole * np.array([part, 1 - part]) ** -0.75
    together = (whole**2 - ((counts / 1000 * spread) ** 2).sum()) / (2 * part * (1 - part))
    errors = rng.multivariate_normal([0, 0], [[spread[0] ** 2, together], [together, spread[1] ** 2]], texels).T
    halves = np.stack([(0.6 + errors) * counts[:, None], np.broadcast_to(counts[:, None], errors.shape)], axis=2)
    told = sampling_error(halves, list(counts), Integrand(), "fibonacci")
    assert told == pytest.approx(whole, rel=0.02)
