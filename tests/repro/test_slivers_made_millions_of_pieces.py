"""All three sides of a triangle were halved, so that a needle came in as many pieces as a square of its length."""

import numpy as np
import pytest

from aoprecalc.spheres.containment import subdivide


def test_a_needle_comes_in_fewer_pieces_than_a_square():
    needle = np.array([[[0, 0, 0], [2, 0, 0], [2, 1e-3, 0]]], float)
    small = subdivide(needle, 0.03)
    assert len(small) <= 3**7  # by all three sides 4^7
    areas = np.linalg.norm(np.cross(small[:, 1] - small[:, 0], small[:, 2] - small[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(1e-3)
    assert np.linalg.norm(small - np.roll(small, 1, axis=1), axis=2).max() <= 0.03
