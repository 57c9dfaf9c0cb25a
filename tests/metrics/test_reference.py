"""The reference holds against closed forms."""

import sys

import numpy as np
import pytest

from aoprecalc.errors import RendererError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import SurfacePoints, sample_surface, shading_normals
from aoprecalc.metrics.reference import reference_ao, stratified_ray_count
from aoprecalc.options import VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.visibility.integrand import Integrand
from shapes import ball, disc, join, scene, torus


def values(made, points, normals="smooth", **options):
    given = VerifyOptions(**{"rays": 2304, **options})
    value = given.value_options()
    shading = shading_normals(made, normals)
    return reference_ao(
        assign_roles(made, value), shading, points, given, Progress(), Integrand.from_options(value, made)
    )


def spread(made, count=200):
    return sample_surface(made, np.ones(len(made.faces), bool), count, 0)


def floor_points(distances, reach):
    """Points at (d, 0, 0) of the face (0, -reach, 0), (reach, 0, 0), (0, reach, 0)."""
    share = np.asarray(distances) / reach
    weights = np.column_stack([(1 - share) / 2, share, (1 - share) / 2])
    return SurfacePoints(np.zeros(len(weights), int), weights)


@pytest.mark.parametrize("normals", ["smooth", "flat"])
@pytest.mark.parametrize("estimator", ["ratio", "mean"])
def test_a_ball_is_one_everywhere(normals, estimator):
    made = scene(*ball(3))
    found = values(made, spread(made), normals, estimator=estimator)
    if estimator == "ratio" or normals == "flat":
        assert (found == 1).all()
    else:  # what the horizon takes from the cosine-weighted sum is (1 + n.g) / 2 of it
        assert found.min() > 0.98


def test_a_floor_beside_a_long_wall():
    height, reach = 1.0, 40.0
    floor = [[0, -reach, 0], [reach, 0, 0], [0, reach, 0]], [[0, 1, 2]]
    wall = [[0, -reach, 0], [0, reach, 0], [0, reach, height], [0, -reach, height]], [[0, 1, 2], [0, 2, 3]]
    distances = np.array([0.2, 0.5, 1, 2, 4])
    found = values(scene(*join(floor, wall)), floor_points(distances, reach), "flat", rays=10_000)
    assert found == pytest.approx((1 + distances / np.hypot(distances, height)) / 2, abs=0.006)


@pytest.mark.parametrize(("radius", "height"), [(1.0, 0.7), (0.3, 0.1)])
def test_a_floor_under_a_coaxial_disc(radius, height):
    floor = [[0, -3, 0], [3, 0, 0], [0, 3, 0], [-3, 0, 0]], [[0, 1, 2], [0, 2, 3]]
    made = scene(*join(floor, disc(radius, height)))
    found = values(made, floor_points([0.0], 3), "flat")
    assert found == pytest.approx(1 - radius**2 / (radius**2 + height**2), abs=0.005)


def test_inside_and_two_sided():
    positions, faces = ball(2)
    inside = scene(positions, faces[:, ::-1])
    assert (values(inside, spread(inside), "flat") == 0).all()
    assert (values(inside, spread(inside), "flat", two_sided=True) == 1).all()


def test_noise_is_below_a_hundredth_and_the_seed_decides():
    made = scene(*torus())
    points = spread(made, 400)
    first, same, other = (values(made, points, seed=seed) for seed in (0, 0, 1))
    assert (first == same).all()
    assert 0 < np.sqrt(np.mean((first - other) ** 2) / 2) < 0.01
    assert first.min() < 0.7
    assert first.max() == 1


def test_the_number_of_threads_does_not_change_the_values():
    made = scene(*torus())
    one, two = (values(made, spread(made), threads=threads) for threads in (1, 2))
    assert (one == two).all()


def test_size_and_place_do_not_matter():
    positions, faces = torus()
    near, far = (scene(at, faces) for at in (positions, positions * 1e-6 + (4, 5, 6)))
    assert np.abs(values(near, spread(near)) - values(far, spread(near))).max() < 0.01


def test_a_normal_that_opposes_its_face_gives_way_to_it():
    corners = [[-1, -1, 0], [1, -1, 0], [0, 2, 0]]
    normals = [[[0, 0, 1], [0.1, 0, -0.995], [0, 0.1, -0.995]]]  # one agrees, so the face is not turned
    made = scene(corners, [[0, 1, 2]], normals=normals)
    weights = np.array([[0.1, 0.45, 0.45], [1 / 3, 1 / 3, 1 / 3]])
    found = values(made, SurfacePoints(np.zeros(2, int), weights), "file", estimator="mean")
    assert (found == 1).all()


def test_rays_stand_in_a_square_grid():
    assert [stratified_ray_count(rays) for rays in (64, 65, 81, 2304, 2305, 10**6)] == [64, 81, 81, 2304, 2401, 10**6]


def test_points_done_are_counted():
    class Counter(Progress):
        done = 0

        def advance(self, count=1):
            self.done += count

    counter, made = Counter(), scene(*ball(1))
    options = VerifyOptions(rays=10_000, two_sided=True)
    reference_ao(
        assign_roles(made, options.value_options()), shading_normals(made), spread(made, 321), options, counter
    )
    assert counter.done == 321


def test_without_embree_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    made = scene(*ball(1))
    with pytest.raises(RendererError, match="embreex"):
        values(made, spread(made))
