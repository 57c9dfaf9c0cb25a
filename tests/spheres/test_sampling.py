"""Samples are uniform on the surface."""

import numpy as np
import pytest
from scipy.stats import chi2

from aoprecalc.errors import InputError
from aoprecalc.spheres.sampling import NormalizedFrame, round_to_grid, sample_points


def samples(scene, count, distinct=1, seed=0):
    """Samples in the mesh's own coordinates."""
    frame = NormalizedFrame.from_positions(scene.positions)
    return frame.from_normalized(sample_points(scene, frame, count, distinct, np.random.default_rng(seed)))


def barycentric(points, triangle):
    edges = (triangle[1:] - triangle[0]).T
    along, residual, *_ = np.linalg.lstsq(edges, (points - triangle[0]).T, rcond=None)
    assert (residual < 1e-18).all(), "a point lies off the triangle's plane"
    return np.vstack([1 - along.sum(axis=0), along]).T


def assert_in_proportion(counts, shares):
    expected = counts.sum() * np.asarray(shares) / np.sum(shares)
    assert ((counts - expected) ** 2 / expected).sum() < chi2.ppf(0.999, len(counts) - 1)


@pytest.fixture(scope="module")
def stairs(scene_of):
    """Five triangles, one above the other at z = 0 to 4, of areas 1 : 4 : 25 : 400 : 10,000, and one of none."""
    sides = [0.05, 0.1, 0.25, 1, 5]
    triangles = [[[0, 0, z], [side, 0, z], [side, side, z]] for z, side in enumerate(sides)] + [[[0, 0, 5]] * 3]
    return scene_of(np.reshape(triangles, (-1, 3)), np.arange(18).reshape(-1, 3))


def test_faces_are_chosen_by_area(stairs):
    level = np.rint(samples(stairs, 100_000)[:, 2]).astype(int)
    assert level.max() <= 4, "a face without area was chosen"
    assert_in_proportion(np.bincount(level), [1, 4, 25, 400, 10_000])


def test_points_are_uniform_in_their_face(scene_of):
    corners = np.array([[0.0, 0, 0], [3, 1, 2], [-1, 5, 1]])
    weights = barycentric(samples(scene_of(corners, [[0, 1, 2]]), 40_000), corners)
    quarter = np.where(weights.max(axis=1) > 0.5, weights.argmax(axis=1), 3)  # three corners and the middle
    assert_in_proportion(np.bincount(quarter), [1, 1, 1, 1])


def test_points_lie_in_their_face(stairs):
    points = samples(stairs, 20_000)
    level = np.rint(points[:, 2]).astype(int)
    for face in range(5):
        assert barycentric(points[level == face], stairs.corners[face]).min() > -1e-8


def test_seed_decides_and_a_longer_run_starts_with_the_shorter_one(ball):
    short = samples(ball, 1000)
    assert (samples(ball, 1000) == short).all()
    assert np.abs(samples(ball, 200_000)[:1000] - short).max() < 1e-10
    assert not np.isclose(samples(ball, 1000, seed=1), short).all(axis=1).any()


def test_any_sum_of_points_on_the_grid_is_exact():
    points = round_to_grid(np.random.default_rng(0).uniform(0.5, 1, (100_000, 3)))
    assert (points[::-1].cumsum(axis=0)[-1] == points.cumsum(axis=0)[-1]).all()
    assert (np.ones((5, 3)) == round_to_grid(np.ones((5, 3)))).all()
    assert not np.signbit(round_to_grid(np.full((2, 3), -1e-300))).any()


@pytest.mark.parametrize(
    "positions",
    [
        [[1, 2, 3], [1, 2, 3], [1, 2, 3]],
        [[0, 0, 0], [1, 2, 4], [3, 6, 12]],
        [[0.1, 0.1, 0.3], [0.2, 0.3, 0.7], [0.7, 1.3, 2.7]],
        [[1e6 + 0.1, 0.2, 0.3], [1e6 + 0.3, 0.4, 0.5], [1e6 + 0.7, 0.8, 0.9]],
    ],
    ids=["a point", "a line", "a line but for rounding", "a line far out"],
)
def test_a_surface_without_area_is_refused(scene_of, positions):
    with pytest.raises(InputError, match=r"made\.obj: the surface has no area"):
        samples(scene_of(positions, [[0, 1, 2]]), 10)


def test_too_few_distinct_points_are_refused(scene_of):
    # A speck with area beside a long face without: all samples round to one point of the grid.
    speck = [[0, 0, 0], [1e-13, 0, 0], [0, 1e-13, 0], [1, 0, 0]]
    scene = scene_of(speck, [[0, 1, 2], [0, 3, 3]])
    assert len(samples(scene, 10_000, distinct=1)) == 10_000
    with pytest.raises(InputError, match="10000 samples on 1 distinct point, fewer than the 2 spheres"):
        samples(scene, 10_000, distinct=2)
