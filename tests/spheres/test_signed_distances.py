"""Distances to spheres, looked up or not, are those to the nearest of all."""

import numpy as np
import pytest

from aoprecalc.spheres.sampling import signed_distances


def brute(points, centers, radii):
    return np.array([(np.linalg.norm(point - centers, axis=1) - radii).min() for point in points])


def assert_same(points, centers, radii):
    expected = brute(points, centers, radii)
    np.testing.assert_allclose(signed_distances(points, centers, radii), expected, rtol=0, atol=1e-14)
    return expected


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("spread", [0.0, 1.0, 4.0], ids=["equal radii", "unequal", "very unequal"])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 23, 24, 25, 26, 300])
def test_as_by_brute_force(count, spread, seed):
    random = np.random.default_rng(seed)
    points, centers = random.uniform(-1, 1, (400, 3)), random.uniform(-1, 1, (count, 3))
    assert_same(points, centers, 0.02 * np.exp(spread * random.normal(size=count)))


@pytest.mark.parametrize("seed", range(3))
def test_a_large_sphere_with_a_far_centre_behind_a_crowd(seed):
    """So many small ones are nearer by their centres that the large one, which holds all points, is not listed."""
    random = np.random.default_rng(seed)
    points, crowd = random.uniform(-1, 1, (300, 3)), random.uniform(-1, 1, (200, 3))
    centers, radii = np.concatenate([crowd, [[50, 0, 0]]]), np.append(np.full(200, 1e-3), 60)
    assert (assert_same(points, centers, radii) < -8).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("copies", [2, 30])
def test_several_spheres_in_one_place(copies, seed):
    random = np.random.default_rng(seed)
    centers = np.repeat(random.normal(size=(5, 3)), copies, axis=0)
    assert_same(random.normal(size=(300, 3)), centers, random.uniform(0, 1, len(centers)))


def test_more_points_than_are_measured_at_a_time():
    random = np.random.default_rng(0)
    points, centers = random.normal(size=(40_000, 3)), random.normal(size=(60, 3))
    for count in (2, 60):
        found = signed_distances(points, centers[:count], np.full(count, 0.1))
        some = np.array([0, 16_383, 16_384, 32_768, 39_999])
        np.testing.assert_allclose(found[some], brute(points[some], centers[:count], 0.1), atol=1e-14)
        np.testing.assert_array_equal(
            found[20_000:], signed_distances(points[20_000:], centers[:count], np.full(count, 0.1))
        )


def test_near_a_surface_no_digits_are_lost():
    """A point 2^-40 beyond a sphere of radius 1 whose centre is far from the origin."""
    center, beyond = np.array([[1024.0, 0, 0]]), np.array([[1025 + 2.0**-40, 0, 0]])
    for count in (1, 10, 100):
        centers = np.concatenate([center, np.full((count - 1, 3), -5000.0)])
        assert signed_distances(beyond, centers, np.ones(count)).tolist() == [2.0**-40]


def test_no_points():
    for count in (1, 50):
        assert signed_distances(np.zeros((0, 3)), np.zeros((count, 3)), np.ones(count)).shape == (0,)
