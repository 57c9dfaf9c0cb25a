"""Every sample is paired with its nearest centre, however the centres move."""

import numpy as np
import pytest

from aoprecalc.spheres.lloyd import NearestCenters


def brute(points, centers):
    """The nearest centre of each point, the first of equally near ones."""
    return (((points[:, None] - centers[None]) ** 2) @ np.ones(3)).argmin(axis=1)


def line(*x):
    return np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [1, 2, 12, 13, 60])
def test_wandering_centres(count, seed):
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (2000, 3)) * [1, 1, seed % 2]  # a plate or a block
    centers = points[:count].copy()
    nearest = NearestCenters(points, centers)
    for step in range(40):
        centers = centers + random.normal(0, [0.02, 0.001][step % 2], centers.shape) * [1, 1, seed % 2]
        if step % 10 == 9:
            centers[step % count] = points[-step]  # a jump across
        nearest.update(centers)
        expected = brute(points, centers)
        empty = np.flatnonzero(np.bincount(expected, minlength=count) == 0)
        given = nearest.labels != expected
        assert sorted(nearest.labels[given]) == empty.tolist()
        assert (nearest.sizes == np.bincount(nearest.labels, minlength=count)).all()


def test_of_equally_near_centres_the_first_wins():
    grid = np.stack(np.meshgrid(*[np.arange(4) / 4] * 3), axis=-1).reshape(-1, 3)  # 64 centres
    points = np.concatenate([grid, grid + 1 / 8])  # on each centre, and in the middle of each cell
    nearest = NearestCenters(points, grid)
    assert (nearest.labels == brute(points, grid)).all()

    shifted = grid[::-1].copy()
    nearest.update(shifted)
    assert (nearest.labels == brute(points, shifted)).all()


def test_a_tie_that_moving_centres_bring_about():
    points = np.array([[-0.5, 0, 0], [0, 0, 0], [0.75, 0, 0]])
    nearest = NearestCenters(points, np.array([[-0.5, 0, 0], [0.25, 0, 0]]))
    assert nearest.labels.tolist() == [0, 1, 1]
    nearest.update(np.array([[-0.5, 0, 0], [0.5, 0, 0]]))
    assert nearest.labels.tolist() == [0, 0, 1]


CROWD = np.arange(12) * -0.02  # so many centres close together that a centre at 1 is no neighbour of the one at 0
ELSEWHERE = [0.5, 1, 0]


@pytest.mark.parametrize(
    ("samples", "places"),
    [
        ([*CROWD, 1], [[*line(*CROWD, 1), [0.49, 0, 0]], [*line(*CROWD, 1), ELSEWHERE]]),
        ([*CROWD, *CROWD + 0.45, 1], [[*line(*CROWD + 0.45, 1), ELSEWHERE], [*line(*CROWD, 1), ELSEWHERE]]),
        ([*CROWD, -0.01, 1], [[*line(0, *CROWD[2:], 0, 1), ELSEWHERE], [*line(-0.01, *CROWD[2:], 0, 1), ELSEWHERE]]),
    ],
    ids=["it joined", "its centre moved off", "it was given to an empty cluster"],
)
def test_a_centre_from_beyond_the_neighbourhood_takes_a_far_sample(samples, places):
    """The sample at 0.49 ends up with the centre at 0, next to many; then the centre at 1 comes to 0.9."""
    points = np.concatenate([line(0.49, *samples), [ELSEWHERE]])
    before, after = np.array(places)
    nearest = NearestCenters(points, before)
    nearest.update(after)
    assert after[nearest.labels[0]].tolist() == [0, 0, 0]
    assert (nearest.labels == brute(points, after)).all()
    last = np.where(after == [1, 0, 0], [0.9, 0, 0], after)
    nearest.update(last)
    assert (nearest.labels == brute(points, last)).all()


AWAY = [0, 1, 0]  # where the centre of an empty cluster stands


@pytest.mark.parametrize(
    ("points", "centers", "labels"),
    [
        (line(-1, -0.9, 0.5, 1), [[-1, 0, 0], [1, 0, 0], AWAY], [0, 0, 2, 1]),
        (line(-1, -0.75, 0.75, 1), [[-1, 0, 0], [1, 0, 0], AWAY], [0, 2, 1, 1]),
        (line(-1, 0.75, 1), [[-0.5, 0, 0], [1, 0, 0], AWAY], [0, 2, 1]),
        (line(-1, 1, 0.5, 0.5, 0.75), [[-1, 0, 0], [1, 0, 0], AWAY, AWAY], [0, 1, 2, 1, 3]),
        (line(0, 0.5, 1), [[0, 0, 0], [0, 0, 0], [0, 0, 0]], [0, 2, 1]),
    ],
    ids=["the farthest", "of equals the first", "never a last one", "no place twice", "centres in one place"],
)
def test_an_empty_cluster_is_given(points, centers, labels):
    nearest = NearestCenters(points, np.array(centers, np.float64))
    assert nearest.labels.tolist() == labels
    assert nearest.sizes.tolist() == np.bincount(labels).tolist()


def test_a_cluster_that_empties_while_centres_move_is_filled_and_followed():
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    start = points[:20]
    nearest = NearestCenters(points, start)
    row = np.arange(20)[:, None]
    nearest.update(np.where(row == 7, 9.0, start))
    given = np.flatnonzero(nearest.labels == 7)
    assert len(given) == 1
    back = np.where(row == 7, points[given], start)
    nearest.update(back)
    assert (nearest.labels == brute(points, back)).all()
