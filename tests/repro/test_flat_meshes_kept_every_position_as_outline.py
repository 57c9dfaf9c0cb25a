"""A flat mesh has no hull of volume; all its positions were projected along every axis, which took minutes."""

import numpy as np

from aoprecalc.visibility.directions import convex_hull_points
from shapes import quad


def test_a_flat_outline_is_small_and_right():
    tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    positions = quad((0, 0, 0), (3, 0, 0), (0, 2, 0), cells=40)[0] @ tilt
    corners = convex_hull_points(positions)
    assert len(corners) == 4
    assert np.allclose(np.ptp(corners, axis=0), np.ptp(positions, axis=0))


def test_the_outline_of_a_line_is_its_ends():
    positions = np.outer(np.linspace(-1, 2, 50), (1.0, 2.0, -1.0))
    assert sorted(convex_hull_points(positions).tolist()) == sorted(positions[[0, -1]].tolist())


def test_one_position_is_its_own_outline():
    assert (convex_hull_points(np.ones((1, 3))) == 1).all()
