"""The greedy choice takes what covers most, and nothing twice."""

import numpy as np
import pytest

import shapes
from aoprecalc.spheres.shadow import greedy_selection
from aoprecalc.spheres.silhouettes import fibonacci_views, mesh_silhouettes, spheres_per_pixel


def worth_of(positions, faces, views):
    return np.where(mesh_silhouettes(positions, faces, views), 1, -1).astype(np.float32)


@pytest.mark.parametrize("seed", range(4))
def test_the_balls_themselves_are_found_among_others(seed):
    """Three apart balls; of the candidates only three are they, others are smaller, larger or beside them."""
    random = np.random.default_rng(seed)
    places, sizes = np.array([[-1, 0, 0], [1, 0.5, 0], [0, -1, 0.8]]), np.array([0.5, 0.4, 0.3])
    shape = shapes.join(
        *((shapes.ball(3)[0] * size + place, shapes.ball(3)[1]) for place, size in zip(places, sizes, strict=True))
    )
    views = fibonacci_views(12, 2.0, 96, turn=0.1)
    beside = places[random.integers(3, size=200)] + random.choice([-1, 1], (200, 3)) * random.uniform(
        0.1, 0.5, (200, 3)
    )
    centers = np.concatenate([beside, places, places, places])
    radii = np.concatenate([random.uniform(0.05, 0.6, 200), sizes, 0.6 * sizes, 1.5 * sizes])
    order = random.permutation(len(radii))
    chosen = greedy_selection(centers[order], radii[order], worth_of(*shape, views), views, 3)
    assert sorted(order[chosen].tolist()) == [200, 201, 202]


def test_the_first_is_worth_most_and_others_add_to_it():
    """By exact discs, where the choice goes by squares: so to within a twentieth, and not once little is left."""
    positions, faces = shapes.torus()
    views = fibonacci_views(8, 1.6, 64, turn=0.1)
    worth = worth_of(positions, faces, views)
    random = np.random.default_rng(0)
    angle = random.uniform(0, 2 * np.pi, 300)
    centers = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(300)])
    radii = random.uniform(0.1, 0.5, 300)
    chosen = greedy_selection(centers, radii, worth, views, 10)
    sums = [
        ((spheres_per_pixel(centers[chosen[:k]], radii[chosen[:k]], views) > 0) * worth).sum() for k in range(1, 11)
    ]
    alone = [((spheres_per_pixel(centers[k : k + 1], radii[k : k + 1], views) > 0) * worth).sum() for k in range(300)]
    assert sums[0] >= 0.95 * max(alone)
    assert (np.diff(sums)[:7] > 0).all()
    assert sums[7] > 0.85 * (worth > 0).sum()


def test_no_more_are_taken_than_gain_anything():
    positions, faces = shapes.ball(3)
    views = fibonacci_views(8, 1.3, 64, turn=0.1)
    apart = np.array([[9.0, 9, 9]]), np.array([0.3])
    assert len(greedy_selection(*apart, worth_of(positions, faces, views), views, 5)) == 0
    assert len(greedy_selection(np.zeros((0, 3)), np.zeros(0), worth_of(positions, faces, views), views, 0)) == 0


def test_what_is_given_stays_as_it_is():
    positions, faces = shapes.ball(2)
    views = fibonacci_views(4, 1.3, 32, turn=0.1)
    worth = worth_of(positions, faces, views)
    before = worth.copy()
    greedy_selection(np.zeros((1, 3)), np.ones(1), worth, views, 1)
    np.testing.assert_array_equal(worth, before)


@pytest.mark.parametrize("radius", [0.9, 0.3])
def test_a_candidate_is_taken_once(radius):
    """Where its square reaches beyond its disc, pixels stay that it seems to gain again."""
    positions, faces = shapes.ball(3)
    views = fibonacci_views(8, 1.3, 64, turn=0.1)
    chosen = greedy_selection(np.zeros((1, 3)), np.array([radius]), worth_of(positions, faces, views), views, 5)
    assert chosen.tolist() == [0]
