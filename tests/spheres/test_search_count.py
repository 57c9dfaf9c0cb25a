"""As few spheres as are good enough: one less, which was tried, is not."""

import numpy as np
import pytest

import shapes
from aoprecalc.errors import AoprecalcError
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.spheres.fit import MAX_SPHERES, MIN_SAMPLES_PER_SPHERE, search_count
from aoprecalc.spheres.sampling import NormalizedFrame, SphereFit, signed_distances

SCENE = shapes.scene(*shapes.torus(around=24, across=12))
FRAME = NormalizedFrame.from_positions(SCENE.positions)


def error(quality, method):
    return 1 - quality["silhouette_iou"] if method == "shadow" else quality["surface_error_mean"]


def fitted(scene, method, **chosen):
    found, quality = fit_sphere_set(scene, SphereOptions(samples=2000, method=method, **chosen), Progress())
    return found, error(quality, method)


@pytest.mark.parametrize(
    ("method", "tolerance"), [("lloyd", 0.03), ("lloyd", 0.02), ("algebraic", 0.03), ("lloyd", 1.0)]
)
def test_good_enough_and_not_with_one_less(method, tolerance):
    found, reached = fitted(SCENE, method, tolerance=tolerance)
    plain, plain_error = fitted(SCENE, method, spheres=len(found))
    assert reached == plain_error <= tolerance
    np.testing.assert_array_equal(found.centers, plain.centers)
    np.testing.assert_array_equal(found.radii, plain.radii)
    assert len(found) == 1 or fitted(SCENE, method, spheres=len(found) - 1)[1] > tolerance
    assert (len(found) == 1) == (tolerance == 1)


@pytest.mark.slow
def test_two_far_balls_need_two_spheres():
    ball, faces = shapes.ball(3)
    scene = shapes.scene(*shapes.join((ball, faces), (ball + [6, 0, 0], faces)))
    found, reached = fitted(scene, "shadow", tolerance=0.05)
    assert len(found) == 2
    assert found.radii == pytest.approx([1, 1], rel=0.02)
    plain, plain_error = fitted(scene, "shadow", spheres=2)
    assert plain.centers.tobytes() == found.centers.tobytes()
    assert reached == plain_error <= 0.05
    assert fitted(scene, "shadow", spheres=1)[1] > 0.05


def spheres(count, radius):
    return SphereFit(np.zeros((count, 3)), np.full(count, radius), 1, True)


@pytest.mark.parametrize(
    "enough",
    [
        *range(1, 20),
        255,
        256,
        *(pytest.param(count, marks=pytest.mark.slow) for count in (257, 1000, MAX_SPHERES - 1, MAX_SPHERES)),
    ],
)
def test_the_least_of_a_falling_error(enough):
    """Samples on the sphere of radius 1: spheres of that radius have no error, others have one."""
    vectors = np.random.default_rng(0).normal(size=(MIN_SAMPLES_PER_SPHERE * MAX_SPHERES, 3))
    points = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    tried = []

    def attempt(count):
        tried.append(count)
        return spheres(count, 1.0 if count >= enough else 0.5)

    made = search_count(SCENE, FRAME, points, attempt, 0.01, "lloyd")
    assert len(made.radii) == enough
    assert len(set(tried)) == len(tried) <= 26
    assert enough == 1 or enough - 1 in tried


@pytest.mark.parametrize("seed", range(5))
def test_of_an_error_that_does_not_fall_evenly_a_step_down_is_found(seed):
    good = np.random.default_rng(seed).random(200) < 0.3
    good[-1] = True
    vectors = np.random.default_rng(seed).normal(size=(MIN_SAMPLES_PER_SPHERE * 200, 3))
    points = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    tried = {}

    def attempt(count):
        tried[count] = bool(good[count - 1])
        return spheres(count, 1.0 if tried[count] else 0.5)

    found = len(search_count(SCENE, FRAME, points, attempt, 0.01, "lloyd").radii)
    assert tried[found]
    assert found == 1 or tried[found - 1] is False


def test_the_error_is_the_mean_distance_from_the_surface_in_diagonals():
    points = np.random.default_rng(0).normal(size=(50, 3))
    one = spheres(1, 0.7)
    exact = np.abs(signed_distances(points, one.centers, one.radii)).mean() / FRAME.diagonal
    assert search_count(SCENE, FRAME, points, lambda count: one, exact * (1 + 1e-12), "lloyd") is one
    with pytest.raises(AoprecalcError):
        search_count(SCENE, FRAME, points[:1], lambda count: one, 0.0, "lloyd")


@pytest.mark.parametrize(("method", "kind"), [("lloyd", "mean surface error"), ("shadow", "1 - silhouette IoU")])
def test_what_no_number_reaches_is_told(method, kind):
    """Up to a tenth as many spheres as there are distinct samples; more would be fitted to the samples alone."""
    points = np.repeat(np.random.default_rng(0).normal(size=(MIN_SAMPLES_PER_SPHERE * 37, 3)), 3, axis=0)
    tried = []

    def attempt(count):
        tried.append(count)
        return spheres(count, 9.0 if count != 8 else 5.0)

    with pytest.raises(
        AoprecalcError, match=rf"^made\.obj: .* up to 37 .*\({kind}\) of at most tolerance 0\.001; .* with 8;"
    ):
        search_count(SCENE, FRAME, points, attempt, 0.001, method)
    assert tried == [1, 2, 4, 8, 16, 32, 37]
