"""Metric A finds the spheres that samples lie on, and never raises its sum of f^2 on the way."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest

from aoprecalc.progress import Progress
from aoprecalc.spheres.algebraic import fit_algebraic
from aoprecalc.spheres.sampling import round_to_grid

LARGEST = 3**0.5  # no sphere is larger than the one around the box


def directions(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def made(shape, count, seed):
    random = np.random.default_rng(seed)
    unit = directions(count, seed)
    if shape == "ellipsoid":
        points = unit * [1, 0.5, 0.3]
    elif shape == "torus":
        around, across = random.uniform(0, 2 * np.pi, (2, count))
        ring = 0.7 + 0.3 * np.cos(across)
        points = np.column_stack([ring * np.cos(around), ring * np.sin(around), 0.3 * np.sin(across)])
    elif shape == "box":
        points = unit / np.abs(unit).max(axis=1, keepdims=True) * [1, 0.6, 0.4]
    elif shape == "plate":
        points = random.uniform(-1, 1, (count, 3)) @ np.linalg.qr(random.normal(size=(3, 3)))[0] * 0.5
        points -= np.outer(points @ unit[0], unit[0])  # tilted, and flat but for rounding
    elif shape == "rough plate":
        points = random.uniform(-1, 1, (count, 3)) * [1, 1, 1e-3]
    elif shape == "rod":
        points = np.outer(random.uniform(-1, 1, count), [1, 0.5, 0.25])
    elif shape == "lattice":
        points = random.integers(-2, 3, (count, 3)) / 2
    else:
        points = random.uniform(-1, 1, (count, 3))
    return round_to_grid(points)


SHAPES = ["ellipsoid", "torus", "box", "plate", "rough plate", "rod", "lattice", "cloud"]


def source_solution(points):
    """The source's A X = B: centre and radius."""
    rows = np.column_stack([-2 * points, np.ones(len(points))])
    x, y, z, rest = np.linalg.lstsq(rows, -(points**2).sum(axis=1), rcond=None)[0]
    return np.array([x, y, z]), np.sqrt(x * x + y * y + z * z - rest)


def metric(points, centers, radii):
    """(s, n): |f| of each sample and sphere, from the definition."""
    return np.abs(((points[:, None] - centers[None]) ** 2).sum(axis=2) - radii**2)


def cost_around_mean(points):
    squared = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    return ((squared - squared.mean()) ** 2).sum()


def assert_never_rises(costs):
    for before, after in pairwise(costs):
        assert after <= before * (1 + 1e-12) + 1e-22


def assert_fixed_point(points, fit):
    """Labels are the least |f|, and every sphere the best for its samples, by definition and by LAPACK."""
    assert fit.converged
    values = metric(points, fit.centers, fit.radii)
    own = values[np.arange(len(points)), fit.labels]
    np.testing.assert_allclose(own, values.min(axis=1), rtol=0, atol=2e-13)
    untied = (values < values.min(axis=1, keepdims=True) + 2e-13).sum(axis=1) == 1
    np.testing.assert_array_equal(fit.labels[untied], values.argmin(axis=1)[untied])
    assert (own**2).sum() == pytest.approx(fit.costs[-1], rel=1e-9, abs=1e-22)
    for label, (center, radius) in enumerate(zip(fit.centers, fit.radii, strict=True)):
        members = points[fit.labels == label]
        assert len(members) > 0
        thickness, *_, width = np.linalg.eigvalsh(np.cov(members.T, bias=True)) if len(members) > 1 else (0, 0)
        best, best_radius = source_solution(members)
        if thickness > 2e-9 * width and best_radius < LARGEST:
            np.testing.assert_allclose(center, best, rtol=0, atol=1e-6)
            assert radius == pytest.approx(best_radius, abs=1e-6)
            assert radius == pytest.approx(np.sqrt(((members - center) ** 2).sum(axis=1).mean()), rel=1e-12)
        else:
            assert (own[fit.labels == label] ** 2).sum() <= cost_around_mean(members) * (1 + 1e-9) + 1e-22


CENTER, RADIUS = np.array([0.1, -0.2, 0.3]), 0.6


@pytest.mark.parametrize("degrees", [180, 90, 30, 8])
@pytest.mark.parametrize("seed", range(3))
def test_samples_of_a_cap_give_its_sphere(degrees, seed):
    unit = directions(200_000 if degrees < 30 else 5000, seed)
    cap = unit[unit @ directions(1, seed + 100)[0] >= np.cos(np.radians(degrees))]
    points = round_to_grid(CENTER + RADIUS * cap[:2000])
    assert len(points) > 200
    fit = fit_algebraic(points, points[:1], 100, Progress())
    np.testing.assert_allclose(fit.centers, [CENTER], rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.radii, [RADIUS], rtol=0, atol=1e-9)
    assert (fit.iterations, fit.converged, fit.guarded) == (2, True, 0)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_spheres_through_the_same_samples_rest_at_once(count):
    """They are one but for rounding, which must not send samples from one to another."""
    signs = np.array(list(product([-1, 1], repeat=3)))
    points = np.concatenate([signs * sides for sides in permutations([0.25, 0.5, 0.625])]) + [0.125, -0.25, 0.0625]
    points = np.random.default_rng(0).permutation(np.tile(points, (20, 1)))
    fit = fit_algebraic(points, points[:count], 100, Progress())
    np.testing.assert_allclose(fit.centers, np.tile([0.125, -0.25, 0.0625], (count, 1)), rtol=0, atol=1e-12)
    assert (fit.iterations, fit.converged, fit.guarded) == (2, True, 0)
    np.testing.assert_array_equal(fit.labels, metric(points, points[:count], np.zeros(count)).argmin(axis=1))


@pytest.mark.parametrize("seed", range(3))
def test_two_far_spheres(seed):
    centers, radii = np.array([[-0.7, 0, 0.1], [0.6, 0.2, 0]]), np.array([0.2, 0.3])
    which = np.arange(1000) % 2
    points = round_to_grid(centers[which] + radii[which, None] * directions(1000, seed))
    fit = fit_algebraic(points, points[:2], 100, Progress())
    np.testing.assert_allclose(fit.centers, centers, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.radii, radii, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(fit.labels, which)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sides", [(1, 1, 1), (1, 0.5, 0.1)])
def test_one_sphere_is_the_sources_least_squares_solution(sides, seed):
    points = round_to_grid(np.random.default_rng(seed).uniform(-0.5, 0.5, (400, 3)) * sides + [0.3, 0.2, -0.4])
    fit = fit_algebraic(points, points[:1], 100, Progress())
    center, radius = source_solution(points)
    assert fit.guarded == 0
    np.testing.assert_allclose(fit.centers[0], center, rtol=0, atol=1e-11)
    assert fit.radii[0] == pytest.approx(radius, rel=1e-11)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [1, 5, 40])
@pytest.mark.parametrize("shape", SHAPES)
def test_never_rises_and_ends_at_a_fixed_point(shape, count, seed):
    points = made(shape, 1500, seed)
    fit = fit_algebraic(points, points[:count], 10_000, Progress())
    assert_never_rises(fit.costs)
    assert len(fit.costs) == fit.iterations
    assert_fixed_point(points, fit)
    assert 0 <= fit.radii.min() <= fit.radii.max() <= LARGEST


@pytest.mark.parametrize("shape", ["plate", "rod"])
def test_a_guard_decides_every_sphere_of_something_flat(shape):
    points = made(shape, 1500, 0)
    fit = fit_algebraic(points, points[:20], 10_000, Progress())
    assert fit.guarded == 20 * fit.iterations


def test_guards_hold_large_spheres_back():
    points = made("rough plate", 1500, 0)
    fit = fit_algebraic(points, points[:20], 10_000, Progress())
    assert source_solution(points[fit.labels == 0])[1] > LARGEST
    assert fit.guarded > 0


@pytest.mark.parametrize("seed", range(8))
def test_a_tilted_circle_gives_the_sphere_around_it(seed):
    """Every sphere through a circle has f = 0 there, so rounding would choose among them."""
    turn = np.random.default_rng(seed).permutation(40) * np.pi / 20
    axes = np.linalg.qr(directions(3, seed))[0]
    points = round_to_grid(CENTER + 0.5 * (np.cos(turn)[:, None] * axes[0] + np.sin(turn)[:, None] * axes[1]))
    fit = fit_algebraic(points, points[:1], 100, Progress())
    assert (fit.iterations, fit.guarded) == (2, 2)
    np.testing.assert_allclose(fit.centers, [CENTER], rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.radii, [0.5], rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [2.0**-1, 2.0**-4])
def test_scales_with_the_samples(scale, seed):
    points = made("torus", 1500, seed)
    whole = fit_algebraic(points, points[:20], 1000, Progress())
    part = fit_algebraic(points * scale, points[:20] * scale, 1000, Progress())
    np.testing.assert_array_equal(part.labels, whole.labels)
    np.testing.assert_allclose(part.centers, whole.centers * scale, rtol=0, atol=1e-12)
    np.testing.assert_allclose(part.radii, whole.radii * scale, rtol=1e-12)
    np.testing.assert_allclose(part.costs, np.array(whole.costs) * scale**4, rtol=1e-9)


def test_an_empty_sphere_starts_again_from_the_farthest_sample():
    points = np.array([[0, 0, 0], [0.25, 0, 0], [0, -0.75, 0], [0, 0, 0.5]])
    fit = fit_algebraic(points, np.zeros((2, 3)), 1, Progress())
    assert fit.labels.tolist() == [0, 0, 1, 0]
    assert fit.costs == (0.25**4 + 0.5**4,)
    assert fit.centers[1].tolist() == [0, -0.75, 0]
    assert fit.radii[1] == 0


def test_no_sphere_gives_its_last_sample_away():
    points = np.array([[1, 0, 0], [0, 0, 0], [0.125, 0, 0], [0, 0.25, 0]])  # the first is farthest from its sphere
    fit = fit_algebraic(points, np.array([[0, 0, 0], [0.5625, 0, 0], [0, 0, 0]]), 1, Progress())
    assert fit.labels.tolist() == [1, 0, 0, 2]


def test_all_starts_in_one_place():
    """All but the first start again, each from a place of its own."""
    corners = np.stack(np.meshgrid([-1, 1], [-1, 0.5], [-1, 0.25]), axis=-1).reshape(-1, 3)
    points = np.repeat(np.concatenate([corners, corners / 2]), 50, axis=0)
    fit = fit_algebraic(points, points[:8], 100, Progress())
    assert_never_rises(fit.costs)
    assert_fixed_point(points, fit)
    assert len(np.unique(fit.centers, axis=0)) == 8


def test_as_many_spheres_as_samples():
    points = made("cloud", 300, 0)
    fit = fit_algebraic(points, points, 100, Progress())
    assert (fit.iterations, fit.converged) == (2, True)
    assert max(fit.costs) < 1e-26
    assert (fit.centers == points).all()
    assert (fit.radii == 0).all()


def test_as_many_spheres_as_places():
    points = np.repeat(made("cloud", 60, 0), 10, axis=0)
    fit = fit_algebraic(points, points[:60], 100, Progress())
    assert_fixed_point(points, fit)
    assert fit.costs[-1] < 1e-22


def test_stops_at_the_greatest_number_of_iterations(listener):
    points = made("torus", 2000, 0)
    whole = fit_algebraic(points, points[:30], 1000, Progress())
    assert 5 < whole.iterations < 1000
    for allowed in (1, 5):
        fit = fit_algebraic(points, points[:30], allowed, listener)
        assert (fit.iterations, fit.converged) == (allowed, False)
        assert fit.costs == whole.costs[:allowed]
    assert listener.steps == 1 + 5
    assert not fit_algebraic(points, points[:30], whole.iterations - 1, Progress()).converged
    assert fit_algebraic(points, points[:30], whole.iterations, Progress()).converged


def test_same_input_same_output():
    points = made("box", 20_000, 0)
    given = points.copy()
    first, second = (fit_algebraic(points, points[:50], 30, Progress()) for _ in range(2))
    assert (points == given).all()
    for name in ("centers", "radii", "labels"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert (first.costs, first.guarded) == (second.costs, second.guarded)
