"""The picture of silhouettes was as wide as the spheres' boxes, not as far as they reach when it is turned."""

import numpy as np
import pytest

from aoprecalc.spheres.sampling import silhouette_quality
from shapes import ball, scene


def test_a_sphere_off_the_corner_of_the_box_is_all_seen():
    made = scene(*ball())
    centers = np.array([[0, 0, 0], [0.9, 0.9, 0.9], [-0.9, -0.9, 0.9]])
    found = silhouette_quality(made, made.positions, centers, np.array([0.9, 0.1, 0.1]))
    # From most directions both lie beside the ball, of whose silhouette each is a hundredth.
    distance = np.sqrt(3) * 0.9
    hidden = 1 - np.sqrt(1 - (1 / distance) ** 2)  # share of the directions from which a centre lies before the ball
    assert found["spill"] == pytest.approx(0.02 * (1 - hidden), abs=0.003)
