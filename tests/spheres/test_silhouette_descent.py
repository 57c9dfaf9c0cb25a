"""The descent moves spheres to where silhouettes differ less."""

import numpy as np
import pytest

import shapes
from aoprecalc.spheres.silhouettes import SilhouetteDescent, fibonacci_views, mesh_silhouettes, spheres_per_pixel

VIEWS = fibonacci_views(20, 1.6, 96, turn=0.25)
PIXEL = 1 / VIEWS.pixels_per_unit


def silhouettes(shape, views=VIEWS):
    return mesh_silhouettes(*shape, views)


def differing(wanted, centers, radii):
    """Pixels in which the silhouettes differ, in the mean over views."""
    return ((spheres_per_pixel(centers, radii, VIEWS) > 0) != wanted).sum(axis=(1, 2)).mean()


def descent_of(wanted, centers, radii):
    return SilhouetteDescent(np.array(centers, float), np.array(radii, float), wanted, VIEWS, len(VIEWS))


@pytest.mark.parametrize("seed", range(6))
def test_steps_lower_the_area_that_differs(seed):
    random = np.random.default_rng(seed)
    wanted = silhouettes([shapes.torus(), shapes.clutter(seed, boxes=3), shapes.bowl()][seed % 3])
    descent = descent_of(wanted, random.uniform(-0.8, 0.8, (15, 3)), random.uniform(0.05, 0.5, 15))
    costs = [differing(wanted, descent.centers, descent.radii)]
    for _ in range(4):
        for _ in range(10):
            descent.step(0.7)
        costs.append(differing(wanted, descent.centers, descent.radii))
    assert (np.diff(costs) < 0).sum() >= 3  # on average, not in each ten steps
    assert costs[-1] < 0.6 * costs[0]


@pytest.mark.parametrize("seed", range(4))
def test_the_first_step_goes_against_the_area_s_differences(seed):
    """The derivative's signs, by differences of the exact area over 4 pixels, wherever these are clear."""
    random = np.random.default_rng(seed)
    wanted = silhouettes(shapes.ball(3, radius=0.9))
    centers, radii = random.uniform(-0.7, 0.7, (4, 3)), random.uniform(0.2, 0.5, 4)
    descent = descent_of(wanted, centers, radii)
    descent.step(1.0)
    moved = np.column_stack([descent.centers - centers, descent.radii - radii]) / PIXEL
    clear = 0
    for sphere in range(4):
        for what in range(4):
            nudge = np.zeros((4, 4))
            nudge[sphere, what] = 2 * PIXEL
            ahead, behind = (
                differing(wanted, centers + side * nudge[:, :3], radii + side * nudge[:, 3]) for side in (1, -1)
            )
            if abs(ahead - behind) > 12:  # of some 40 pixels around a sphere
                clear += 1
                assert moved[sphere, what] == pytest.approx(-np.sign(ahead - behind), abs=1e-6)
    assert clear >= 6


def test_each_step_sees_the_next_views():
    """Half of the views want everything covered, the other half nothing."""
    wanted = np.zeros((len(VIEWS), 96, 96), bool)
    wanted[:10] = True
    descent = SilhouetteDescent(np.zeros((1, 3)), np.full(1, 0.5), wanted, VIEWS, 10)
    descent.step(1.0)
    assert descent.radii[0] == pytest.approx(0.5 + PIXEL, rel=1e-9)
    descent.step(1.0)
    assert 0.5 < descent.radii[0] < 0.5 + PIXEL


def test_a_sphere_inside_grows_one_outside_shrinks():
    wanted = silhouettes(shapes.ball(3))
    for radius, side in ((0.5, 1), (1.4, -1)):
        descent = descent_of(wanted, [[0, 0, 0]], [radius])
        descent.step(0.5)
        assert descent.radii[0] == pytest.approx(radius + side * 0.5 * PIXEL, rel=1e-9)
        assert np.abs(descent.centers).max() <= 0.5 * PIXEL * (1 + 1e-9)


def test_a_sphere_comes_to_rest_on_a_ball():
    descent = descent_of(silhouettes(shapes.ball(4)), [[0.3, -0.2, 0.1]], [0.7])
    for pace in np.linspace(1, 0.02, 150):
        descent.step(pace)
    assert np.linalg.norm(descent.centers[0]) < 0.005
    assert descent.radii[0] == pytest.approx(1, abs=0.005)


def test_a_hidden_sphere_stays():
    """The outline of a small sphere inside a large one is nobody's: its derivative is 0."""
    descent = descent_of(silhouettes(shapes.ball(3)), [[0, 0, 0], [0.1, 0, 0.1]], [0.8, 0.2])
    descent.step(1.0)
    assert (descent.centers[1].tolist(), descent.radii[1]) == ([0.1, 0, 0.1], 0.2)
    assert descent.radii[0] > 0.8


def test_a_sphere_that_leaves_the_picture_is_called_back_or_shrinks():
    descent = descent_of(silhouettes(shapes.ball(3)), [[1.5, 0, 0]], [0.4])
    before = differing(silhouettes(shapes.ball(3)), descent.centers, descent.radii)
    for _ in range(60):
        descent.step(1.0)
    assert differing(silhouettes(shapes.ball(3)), descent.centers, descent.radii) < before


def test_radii_stay_positive_where_nothing_is_wanted():
    descent = descent_of(np.zeros((len(VIEWS), 96, 96), bool), np.random.default_rng(0).normal(size=(5, 3)), [0.1] * 5)
    for _ in range(40):
        descent.step(1.0)
    np.testing.assert_allclose(descent.radii, PIXEL / 4)
    assert np.isfinite(descent.centers).all()


def test_a_pull_moves_what_silhouettes_do_not():
    """With the mesh's silhouettes matched all around, a pull down x moves the hidden sphere alone up x."""
    wanted = silhouettes(shapes.ball(3))
    still, pulled = (descent_of(wanted, [[0, 0, 0], [0.1, 0, 0.1]], [0.8, 0.2]) for _ in range(2))
    pull = np.zeros((2, 4))
    pull[1, 0] = -3
    still.step(0.5, np.zeros((2, 4)))
    pulled.step(0.5, pull)
    np.testing.assert_array_equal(pulled.centers[0], still.centers[0])
    np.testing.assert_allclose(pulled.centers[1] - still.centers[1], [0.5 * PIXEL, 0, 0], rtol=1e-9, atol=1e-15)


def test_what_is_given_stays_as_it_is():
    centers, radii = np.zeros((1, 3)), np.full(1, 0.5)
    SilhouetteDescent(centers, radii, silhouettes(shapes.ball(2)), VIEWS, 5).step(1.0)
    assert (centers == 0).all()
    assert radii.tolist() == [0.5]
