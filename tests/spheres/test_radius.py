"""Radii follow their rules, and quality says what they come to."""

import numpy as np
import pytest

from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.lloyd import Clusters
from aoprecalc.spheres.quality import quality
from aoprecalc.spheres.radius import radii

# Cluster 0 stands at the origin with samples at distances 1 and 3, cluster 1 at x = 4 with samples at 1, 2 and 6.
POINTS = np.array([[0, 1, 0], [3, 0, 0], [5, 0, 0], [4, 0, 2], [4, -6, 0]], np.float64)
CLUSTERS = Clusters(
    centers=np.array([[0, 0, 0], [4, 0, 0]], np.float64),
    labels=np.array([0, 0, 1, 1, 1]),
    distances=np.array([1, 3, 1, 2, 6], np.float64),
    iterations=1,
    converged=True,
)
FRAME = Frame(center=np.array([7.0, 7, 7]), scale=10, diagonal=2)


@pytest.mark.parametrize(("rule", "expected"), [("mean", [2, 3]), ("uniform", [2.6, 2.6]), ("cover", [3, 6])])
def test_rules(rule, expected):
    assert radii(CLUSTERS, rule) == pytest.approx(expected, rel=1e-15)


def test_quality_by_hand():
    # Radii 2 and 3: errors 1 1 | 2 1 3. Inside its own sphere: samples 0, 2 and 3; sample 1 lies in the other's.
    measured = quality(POINTS, CLUSTERS, np.array([2.0, 3.0]), FRAME)
    assert measured == pytest.approx(
        {
            "radius_min": 20,
            "radius_mean": 25,
            "radius_max": 30,
            "radius_deviation": 5,
            "inertia": (1 + 9 + 1 + 4 + 36) / 2**2,
            "surface_error_mean": 1.6 / 2,
            "surface_error_max": 3 / 2,
            "coverage": 4 / 5,
        }
    )


@pytest.mark.parametrize("seed", range(4))
def test_coverage_is_what_brute_force_counts(seed):
    random = np.random.default_rng(seed)
    points, centers, sizes = random.normal(size=(500, 3)), random.normal(size=(30, 3)), random.uniform(0, 0.7, 30)
    distances = np.linalg.norm(points[:, None] - centers[None], axis=2)
    labels = distances.argmin(axis=1)
    clusters = Clusters(centers, labels, distances.min(axis=1), 1, True)
    expected = (distances <= sizes).any(axis=1).mean()
    assert 0 < expected < 1
    assert quality(points, clusters, sizes, FRAME)["coverage"] == expected
