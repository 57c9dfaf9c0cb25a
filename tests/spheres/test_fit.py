"""From a scene to spheres: closed forms, and what must not matter."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set

FEW = SphereOptions(spheres=12, samples=5000)


def spheres(scene, options=FEW):
    return fit_sphere_set(scene, options, Progress())[0]


def moved(scene, scale=1.0, offset=(0.0, 0.0, 0.0)):
    return replace(scene, positions=scene.positions * scale + offset)


@pytest.mark.parametrize("rule", ["mean", "uniform", "cover"])
def test_one_sphere_on_a_ball_is_the_ball(ball, rule):
    found = spheres(ball, SphereOptions(spheres=1, samples=20_000, radius=rule))
    assert np.linalg.norm(found.centers[0]) < 0.02
    assert found.radii[0] == pytest.approx(1, abs=0.02)


def test_one_sphere_on_a_plate(plate):
    """The mean distance of the square [-1, 1]^2 from its middle is (sqrt 2 + asinh 1) / 3."""
    found = spheres(plate, SphereOptions(spheres=1, samples=100_000))
    assert found.centers[0] == pytest.approx([0, 0, 0], abs=0.01)
    assert found.centers[0, 2] == 0
    assert found.radii[0] == pytest.approx((np.sqrt(2) + np.arcsinh(1)) / 3, rel=0.005)
    assert (found.iterations, found.converged) == (2, True)


@pytest.mark.parametrize("init", ["first", "kmeans++"])
def test_far_plates_get_a_sphere_each(scene_of, plate, init):
    places = np.array([[0, 0, 0], [100, 0, 0], [0, 300, 50]])
    scene = scene_of(
        np.concatenate([plate.positions + place for place in places]),
        np.concatenate([plate.faces + 4 * k for k in range(3)]),
    )
    found = spheres(scene, SphereOptions(spheres=3, samples=30_000, init=init))
    order = np.argsort(found.centers @ [1, 2, 0])
    assert found.centers[order] == pytest.approx(places, abs=0.03)
    assert found.radii == pytest.approx(np.full(3, (np.sqrt(2) + np.arcsinh(1)) / 3), rel=0.02)


def test_says_how_it_was_made(ball):
    options = SphereOptions(spheres=9, samples=700, seed=5, radius="uniform")
    found = spheres(ball, options)
    assert (found.method, found.radius_rule, found.samples, found.seed) == ("lloyd", "uniform", 700, 5)
    assert len(found) == 9
    assert found.centers.shape == (9, 3)


def test_same_options_same_spheres_other_seed_others(ball):
    first, again, other = spheres(ball), spheres(ball), spheres(ball, replace(FEW, seed=1))
    assert (first.centers == again.centers).all()
    assert (first.radii == again.radii).all()
    assert not np.isclose(first.radii, other.radii).any()


@pytest.mark.parametrize("power", [-300, -20, 1, 30, 300])
def test_scaling_by_a_power_of_two_is_exact(ball, power):
    plain, scaled = spheres(ball), spheres(moved(ball, 2.0**power))
    assert (scaled.centers == plain.centers * 2.0**power).all()
    assert (scaled.radii == plain.radii * 2.0**power).all()
    assert scaled.iterations == plain.iterations


@pytest.mark.parametrize("offset", [(8, -32, 16), (0, 0, -1024)])
def test_moving_by_powers_of_two_is_exact(ball, offset):
    plain, found = spheres(ball), spheres(moved(ball, 1.0, offset))
    assert (found.radii == plain.radii).all()
    assert (found.centers == plain.centers + offset).all()


@pytest.mark.parametrize(("scale", "offset"), [(3.7e-6, 0), (1e6, 0.1), (0.3, 17.3)])
def test_place_and_size_do_not_matter(ball, scale, offset):
    plain, found = spheres(ball), spheres(moved(ball, scale, offset))
    assert found.iterations == plain.iterations
    np.testing.assert_allclose(found.radii, plain.radii * scale, rtol=1e-9)
    np.testing.assert_allclose(found.centers, plain.centers * scale + offset, rtol=1e-9, atol=1e-9 * scale)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_sizes_at_the_ends_of_float64(ball, scale):
    found, quality = fit_sphere_set(moved(ball, scale), FEW, Progress())
    assert np.isfinite(found.centers).all()
    assert (found.radii / scale > 0.1).all()
    assert np.isfinite(list(quality.values())).all()


def test_both_sides_of_a_face_are_one_surface(scene_of, plate):
    two_sided = scene_of(plate.positions, np.concatenate([plate.faces, plate.faces[:, ::-1]]))
    found = spheres(two_sided, SphereOptions(spheres=4, samples=20_000))
    assert found.converged
    assert (found.centers[:, 2] == 0).all()
    quarters = np.array(list(product([-0.5, 0.5], repeat=2)))
    assert sorted(np.round(found.centers[:, :2] * 2).tolist()) == sorted((quarters * 2).tolist())


def test_as_many_spheres_as_samples(ball):
    found, quality = fit_sphere_set(ball, SphereOptions(spheres=50, samples=50), Progress())
    assert (found.radii == 0).all()
    assert found.converged
    assert (quality["inertia"], quality["coverage"]) == (0, 1)


def test_quality_of_the_rules(ball):
    rules = ("mean", "uniform", "cover")
    mean, uniform, cover = (fit_sphere_set(ball, replace(FEW, radius=rule), Progress())[1] for rule in rules)
    assert cover["coverage"] == 1
    assert uniform["radius_deviation"] == pytest.approx(0, abs=1e-12)
    assert 0 < mean["surface_error_mean"] < uniform["surface_error_mean"] < cover["surface_error_mean"]
    assert mean["inertia"] == uniform["inertia"] == cover["inertia"]


def test_more_spheres_lie_closer(ball):
    errors = [fit_sphere_set(ball, replace(FEW, spheres=n), Progress())[1]["surface_error_mean"] for n in (5, 20, 80)]
    assert errors == sorted(errors, reverse=True)


def test_an_early_stop_is_told(ball, listener):
    found, _ = fit_sphere_set(ball, replace(FEW, max_iterations=3), listener)
    assert (found.iterations, found.converged) == (3, False)
    assert listener.steps == 3
    assert [warning.count("after 3 iterations") for warning in listener.warnings] == [1]
    listener.warnings.clear()
    fit_sphere_set(ball, FEW, listener)
    assert listener.warnings == []


def test_no_area(scene_of):
    with pytest.raises(InputError, match="no area"):
        spheres(scene_of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
