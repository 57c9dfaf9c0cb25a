"""Spheres for shadows: solids that are spheres, or nearly, are found; others are matched better than by lloyd."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import shapes
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set

# Silhouettes are measured (`quality`) from directions that no fit uses.
FLAT = shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 4)

slow = pytest.mark.slow


def fitted(scene, count, method="shadow", seed=0):
    return fit_sphere_set(scene, SphereOptions(spheres=count, samples=4000, method=method, seed=seed), Progress())


@cache
def likeness(name, count, method="shadow"):
    shape = {"torus": shapes.torus(), "clutter": shapes.clutter(3, boxes=3)}[name]
    return fitted(shapes.scene(*shape), count, method)[1]["silhouette_iou"]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=slow)])
def test_one_sphere_on_a_ball_is_the_ball(seed):
    positions, faces = shapes.ball(4)
    found, quality = fitted(shapes.scene(2 * positions + [5, 0, -3], faces), 1, seed=seed)
    assert np.linalg.norm(found.centers[0] - [5, 0, -3]) < 0.01 * 2
    assert found.radii[0] == pytest.approx(2, rel=0.01)
    assert quality["silhouette_iou"] > 0.99


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=slow)])
def test_two_balls_get_a_sphere_each(seed):
    small, large = shapes.ball(3), shapes.ball(3, radius=1.5)
    places = np.array([[-3.0, 0, 0], [1, 0.5, 2]])
    scene = shapes.scene(*shapes.join((small[0] + places[0], small[1]), (large[0] + places[1], large[1])))
    found, quality = fitted(scene, 2, seed=seed)
    order = np.argsort(found.radii)
    assert np.linalg.norm(found.centers[order] - places, axis=1).max() < 0.02
    assert found.radii[order] == pytest.approx([1, 1.5], rel=0.01)
    assert quality["silhouette_iou"] > 0.98


def test_a_capsule(capsule):
    ours, lloyds = fitted(capsule, 8)[1]["silhouette_iou"], fitted(capsule, 8, "lloyd")[1]["silhouette_iou"]
    assert ours > 0.985
    assert ours > lloyds + 0.2


@pytest.mark.slow
def test_a_torus():
    assert likeness("torus", 24) > 0.975
    assert likeness("torus", 24) > likeness("torus", 24, "lloyd") + 0.2


@pytest.mark.parametrize(
    "count", [1, pytest.param(2, marks=slow), 3, pytest.param(7, marks=slow), pytest.param(60, marks=slow)]
)
def test_always_as_many_spheres_as_asked_for(count):
    found, quality = fitted(shapes.scene(*shapes.box((0, 0, 0), (1e-5, 2e-5, 1e-5))), count)
    assert len(found) == count
    assert found.centers.shape == (count, 3)
    assert (found.radii > 0).all()
    assert np.isfinite(found.centers).all()
    assert (found.method, found.radius_rule, found.converged) == ("shadow", "own", True)
    assert quality["silhouette_iou"] > 0.5


@pytest.mark.slow
def test_more_spheres_than_a_ball_can_use():
    found, quality = fitted(shapes.scene(*shapes.ball(3)), 30)
    assert len(found) == 30
    assert (found.radii > 0).all()
    assert quality["silhouette_iou"] > 0.98


@pytest.mark.slow
def test_same_seed_same_bytes_other_seed_other_spheres():
    scene = shapes.scene(*shapes.torus(around=12, across=6))
    first, again, other = fitted(scene, 5)[0], fitted(scene, 5)[0], fitted(scene, 5, seed=1)[0]
    assert first.centers.tobytes() == again.centers.tobytes()
    assert first.radii.tobytes() == again.radii.tobytes()
    assert first.radii.tobytes() != other.radii.tobytes()


@pytest.mark.slow
def test_place_and_size_do_not_matter():
    scene = shapes.scene(*shapes.torus(around=24, across=12))
    plain = fitted(scene, 4)[1]["silhouette_iou"]
    for scale, offset in ((1e-3, (0, 0, 0)), (1e3, (7e3, 0, -2e3)), (1.0, (100.3, -20, 0))):
        found, quality = fitted(replace(scene, positions=scene.positions * scale + offset), 4)
        assert quality["silhouette_iou"] == pytest.approx(plain, abs=0.01)
        assert (np.abs(found.centers - offset).max(axis=1) < 1.5 * scale).all()
        assert (found.radii < scale).all()


@pytest.mark.parametrize(
    ("shape", "least"),
    [
        pytest.param(shapes.cap(), 0.88, marks=slow),
        (FLAT, 0.65),
        pytest.param((FLAT[0], np.concatenate([FLAT[1], FLAT[1][:, ::-1]])), 0.65, marks=slow),
        pytest.param((FLAT[0], FLAT[1][:, ::-1]), 0.65, marks=slow),
    ],
    ids=["shell", "plate", "two-sided plate", "plate turned over"],
)
def test_surfaces_without_an_inside(shape, least):
    scene = shapes.scene(*shape)
    found, quality = fitted(scene, 12)
    assert np.isfinite(found.centers).all()
    assert (found.radii > 0).all()
    assert (found.radii < 1.5).all()
    assert quality["silhouette_iou"] > least
    assert quality["silhouette_iou"] > fitted(scene, 12, "lloyd")[1]["silhouette_iou"] + 0.1


@pytest.mark.slow
@pytest.mark.parametrize("shape", [shapes.box((-1, -1e-5, -1e-5), (1, 1e-5, 1e-5)), (np.eye(3), [[0, 1, 2]])],
                         ids=["needle", "triangle"])  # fmt: skip
def test_needles_and_single_triangles_give_finite_spheres(shape):
    for count in (1, 5):
        found, quality = fitted(shapes.scene(*shape), count)
        assert np.isfinite(found.centers).all()
        assert (found.radii > 0).all()
        assert np.isfinite(list(quality.values())).all()


@pytest.mark.slow
def test_inside_out_is_as_good():
    positions, faces = shapes.torus()
    turned = fitted(shapes.scene(positions, faces[:, ::-1]), 12)[1]["silhouette_iou"]
    assert turned == pytest.approx(likeness("torus", 12), abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["torus", "clutter"])
def test_more_spheres_are_never_much_worse(name):
    found = [likeness(name, count) for count in (2, 6, 12, 24)]
    assert (np.diff(found) > -0.005).all()
    assert found[-1] > found[0] + 0.1


def test_steps_are_counted_as_progress(listener):
    found, _ = fit_sphere_set(
        shapes.scene(*shapes.ball(2)), SphereOptions(spheres=2, samples=500, method="shadow"), listener
    )
    assert listener.steps == found.iterations > 0
    assert listener.warnings == []
