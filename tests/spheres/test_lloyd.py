"""The iteration ends where Lloyd's algorithm must."""

import numpy as np
import pytest
from sklearn.cluster import KMeans
from threadpoolctl import threadpool_limits

from aoprecalc.progress import Progress
from aoprecalc.spheres.lloyd import initial_centers, lloyd
from aoprecalc.spheres.sampling import round_to_grid


def made(shape, count, seed):
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 3))
    if shape == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    elif shape == "plate":
        points *= [1, 1, 0]
    return round_to_grid(points / np.abs(points).max())


def scikit_learn(points, count):
    """The same iteration from the same start; on one thread, as several wait for each other on a busy machine."""
    with threadpool_limits(1):
        return KMeans(count, init=points[:count], n_init=1, tol=0, max_iter=10_000, algorithm="lloyd").fit(points)


def inertia(clusters):
    return (clusters.distances**2).sum()


def assert_fixed_point(points, clusters):
    """Every centre is the mean of its samples, and of every sample the nearest, by brute force."""
    assert clusters.converged
    for label, center in enumerate(clusters.centers):
        members = points[clusters.labels == label]
        assert len(members) > 0
        np.testing.assert_allclose(center, members.mean(axis=0), rtol=0, atol=1e-14)
    distances = np.linalg.norm(points[:, None] - clusters.centers[None], axis=2)
    np.testing.assert_allclose(clusters.distances, distances.min(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(clusters.labels, distances.argmin(axis=1))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("shape", ["sphere", "plate", "cloud"])
@pytest.mark.parametrize("count", [2, 10, 50])
def test_same_clusters_as_scikit_learn(count, shape, seed):
    points = made(shape, 1500, seed)
    ours = lloyd(points, points[:count], 10_000, Progress())
    assert_fixed_point(points, ours)
    theirs = scikit_learn(points, count)
    np.testing.assert_array_equal(ours.labels, theirs.labels_)
    assert ours.iterations == theirs.n_iter_
    assert inertia(ours) == pytest.approx(theirs.inertia_, rel=1e-9)


def test_same_inertia_as_scikit_learn_on_many_samples():
    points = made("sphere", 30_000, 0)
    ours = lloyd(points, points[:100], 10_000, Progress())
    assert_fixed_point(points, ours)
    theirs = scikit_learn(points, 100)
    assert inertia(ours) == pytest.approx(theirs.inertia_, rel=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_few_places_many_samples(seed):
    """Samples on a coarse lattice: ties, duplicates and empty clusters all the time."""
    random = np.random.default_rng(seed)
    points = round_to_grid(random.integers(-2, 3, (800, 3)) / 2)
    places = len(np.unique(points, axis=0))
    few = lloyd(points, points[: places // 2], 10_000, Progress())
    assert_fixed_point(points, few)
    all_of_them = lloyd(points, points[:places], 10_000, Progress())
    assert_fixed_point(points, all_of_them)
    assert inertia(all_of_them) == 0


def test_all_starts_in_one_place():
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    points = np.repeat(corners, 50, axis=0).astype(np.float64)
    clusters = lloyd(points, points[:8], 100, Progress())
    assert_fixed_point(points, clusters)
    assert sorted(map(tuple, clusters.centers)) == sorted(map(tuple, corners))


def test_stops_at_the_greatest_number_of_iterations(listener):
    points = made("sphere", 2000, 0)
    whole = lloyd(points, points[:30], 1000, Progress())
    assert 5 < whole.iterations < 1000
    for allowed in (1, 5):
        clusters = lloyd(points, points[:30], allowed, listener)
        assert (clusters.iterations, clusters.converged) == (allowed, False)
        assert inertia(clusters) > inertia(whole)
    assert listener.steps == 1 + 5
    assert not lloyd(points, points[:30], whole.iterations - 1, Progress()).converged
    assert lloyd(points, points[:30], whole.iterations, Progress()).converged


def test_as_many_clusters_as_samples():
    points = made("cloud", 300, 0)
    clusters = lloyd(points, points, 100, Progress())
    assert (clusters.iterations, clusters.converged) == (2, True)
    assert (clusters.centers == points).all()


@pytest.mark.parametrize("seed", range(5))
def test_careful_starts_are_distinct_samples(seed):
    places = made("cloud", 6, seed)
    points = np.repeat(places, [500, 1, 1, 1, 1, 2], axis=0)
    chosen = initial_centers(points, 6, "kmeans++", np.random.default_rng(seed))
    assert sorted(map(tuple, chosen)) == sorted(map(tuple, places))


def test_careful_starts_find_far_groups():
    """Squared distances between the groups are 10^8 times those within: one start in each, but for luck."""
    points = np.concatenate([made("cloud", 200, k) * 1e-4 + center for k, center in enumerate(np.eye(3))])
    chosen = initial_centers(points, 3, "kmeans++", np.random.default_rng(0))
    assert sorted(np.rint(chosen).tolist()) == sorted(np.eye(3).tolist())


def test_first_starts_are_the_first_samples():
    points = made("cloud", 20, 0)
    assert (initial_centers(points, 7, "first", np.random.default_rng(0)) == points[:7]).all()
