"""Radii follow their rules."""

import numpy as np
import pytest

from aoprecalc.spheres.lloyd import Clusters, cluster_radii

# Cluster 0 stands at the origin with samples at distances 1 and 3, cluster 1 at x = 4 with samples at 1, 2 and 6.
CLUSTERS = Clusters(
    centers=np.array([[0, 0, 0], [4, 0, 0]], np.float64),
    labels=np.array([0, 0, 1, 1, 1]),
    distances=np.array([1, 3, 1, 2, 6], np.float64),
    iterations=1,
    converged=True,
)


@pytest.mark.parametrize(("rule", "expected"), [("mean", [2, 3]), ("uniform", [2.6, 2.6]), ("cover", [3, 6])])
def test_rules(rule, expected):
    assert cluster_radii(CLUSTERS, rule) == pytest.approx(expected, rel=1e-15)
