"""Points find their nearest spheres, balls around them are nearly the smallest, and pieces left out are found."""

import numpy as np
import pytest

from aoprecalc.spheres.containment import (
    containing_radii,
    enclosing_balls,
    nearest_spheres,
    pieces_outside,
    thinned,
)


@pytest.mark.parametrize("count", [2, 7, 300])
def test_the_two_nearest_spheres(count):
    """A k-d tree, for many, knows but the nearest centres: the spheres are as large as each other there."""
    random = np.random.default_rng(count)
    points, centers = random.uniform(-1, 1, (500, 3)), random.uniform(-1, 1, (count, 3))
    radii = random.uniform(0, 0.5, count) if count < 300 else np.full(count, 0.1)
    signed = np.linalg.norm(points[:, None] - centers, axis=2) - radii
    expected = np.argsort(signed, axis=1)[:, :2]
    nearest, distances = nearest_spheres(points, centers, radii, 2)
    np.testing.assert_array_equal(nearest, expected)
    np.testing.assert_allclose(distances, np.take_along_axis(signed, expected, axis=1), rtol=0, atol=1e-7)
    np.testing.assert_array_equal(nearest_spheres(points, centers, radii)[0], expected[:, :1])


@pytest.mark.parametrize("seed", range(4))
def test_balls_around_points_are_nearly_the_smallest(seed):
    """Of points in a ball and at the ends of one of its diameters, no ball is smaller than it."""
    random = np.random.default_rng(seed)
    middles, sizes = random.uniform(-1, 1, (5, 3)), random.uniform(0.1, 1, 5)
    directions = random.normal(size=(5, 40, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    offsets = directions * random.uniform(0, 0.9, (5, 40, 1))
    offsets[:, 0], offsets[:, 1] = directions[:, 0], -directions[:, 0]
    points = (middles[:, None] + offsets * sizes[:, None, None]).reshape(-1, 3)
    owner = np.repeat(np.arange(5), 40)
    order = random.permutation(len(points))
    start = np.concatenate([middles + 0.3 * sizes[:, None] * directions[:, 2], [[9.0, 9, 9]]])
    centers, radii = enclosing_balls(points[order], owner[order], start)
    away = np.linalg.norm(points - centers[owner], axis=1) - radii[owner]
    assert away.max() < 1e-12
    assert (radii[:5] >= sizes * (1 - 1e-12)).all()
    assert (radii[:5] <= 1.06 * sizes).all()
    assert (centers[5].tolist(), radii[5]) == ([9, 9, 9], 0)  # a ball of no points


def test_what_no_ball_contains_comes_back_in_small_pieces():
    """Two balls contain the ends of a triangle: what is between them comes back, and neither end."""
    triangle = np.array([[[-1.0, 0, 0], [1, 0, 0], [0, 0.1, 0]]])
    centers, radii = np.array([[-1.0, 0, 0], [1, 0, 0]]), np.array([0.8, 0.6])
    pieces, owner = pieces_outside(triangle, centers, radii, 0.05)
    assert -0.25 < pieces[..., 0].min() < -0.2 + 1e-12
    assert 0.4 - 1e-12 < pieces[..., 0].max() < 0.45
    assert set(owner) == {0, 1}
    grown = containing_radii(triangle, np.zeros((0, 3)), centers, radii, 0.05)
    assert len(pieces_outside(triangle, centers, grown, 0.05)[0]) == 0
    assert grown.sum() == pytest.approx(2, abs=0.06)


def test_pieces_inside_a_ball_stay_out_of_the_result():
    inside = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3, 3))
    assert len(pieces_outside(inside, np.zeros((1, 3)), np.ones(1), 0.1)[0]) == 0


def test_one_point_of_each_cube_is_left():
    points = np.random.default_rng(0).uniform(-1, 1, (5000, 3))
    left = thinned(points, 0.25)
    assert 8**3 <= len(left) <= 9**3
    assert {tuple(point) for point in left} <= {tuple(point) for point in points}
    np.testing.assert_array_equal(thinned(left, 0.25), left)
    assert thinned(points[:0], 0.25).shape == (0, 3)
