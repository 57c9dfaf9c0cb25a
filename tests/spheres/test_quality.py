"""Quality: figures by hand, by formula and by brute force."""

from dataclasses import replace

import numpy as np
import pytest

import shapes
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.fit import measure_quality
from aoprecalc.spheres.sampling import NormalizedFrame, sphere_quality

BALL = shapes.scene(*shapes.ball(4))
SILHOUETTES = ("silhouette_iou", "silhouette_iou_min", "leak", "spill", "area_bias")
VOLUMES = ("inside_volume", "outside_volume")


def measured(scene, centers, radii):
    return measure_quality(
        scene, np.array(centers, float), np.array(radii, float), SphereOptions(samples=4000), Progress()
    )


def test_figures_of_points_by_hand():
    """Spheres of radius 2 and 3, 4 apart. From the nearer surface: -1, -2, -2, -1 and 3; nearest centres 1 1 1 2 6."""
    points = np.array([[0, 1, 0], [3, 0, 0], [5, 0, 0], [4, 0, 2], [4, -6, 0]], float)
    frame = NormalizedFrame(center=np.array([7.0, 7, 7]), scale=10, diagonal=2)
    found = sphere_quality(BALL, frame, points, np.array([[0, 0, 0], [4, 0, 0]], float), np.array([2.0, 3.0]))
    expected = {
        "radius_min": 20,
        "radius_mean": 25,
        "radius_max": 30,
        "radius_deviation": 5,
        "inertia": (1 + 1 + 1 + 4 + 36) / 2**2,
        "surface_error_mean": (1 + 2 + 2 + 1 + 3) / 5 / 2,
        "surface_error_p95": 2.8 / 2,
        "surface_error_max": 3 / 2,
        "coverage": 4 / 5,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert set(found) == {*expected, *SILHOUETTES, *VOLUMES, "overlap"}


@pytest.mark.parametrize("seed", range(4))
def test_coverage_and_errors_by_brute_force(seed):
    random = np.random.default_rng(seed)
    points, centers, sizes = random.normal(size=(500, 3)), random.normal(size=(30, 3)), random.uniform(0, 0.7, 30)
    away = np.linalg.norm(points[:, None] - centers[None], axis=2)
    beyond = (away - sizes).min(axis=1)
    found = sphere_quality(BALL, NormalizedFrame(np.zeros(3), 1.0, 3.0), points, centers, sizes)
    assert 0 < (beyond <= 0).mean() < 1
    assert found["coverage"] == (beyond <= 0).mean()
    assert found["surface_error_mean"] == pytest.approx(np.abs(beyond).mean() / 3, rel=1e-12)
    assert found["surface_error_p95"] == pytest.approx(np.quantile(np.abs(beyond), 0.95) / 3, rel=1e-12)
    assert found["surface_error_max"] == pytest.approx(np.abs(beyond).max() / 3, rel=1e-12)
    assert found["inertia"] == pytest.approx((away.min(axis=1) ** 2).sum() / 9, rel=1e-12)


def test_the_sphere_that_a_ball_is():
    found = measured(BALL, [[0, 0, 0]], [1])
    assert found["silhouette_iou"] > 0.994
    assert found["silhouette_iou_min"] > 0.993
    assert found["leak"] < 1e-3
    assert found["spill"] < 0.006  # facets lie inside the sphere
    assert 0 <= found["area_bias"] < 0.006
    assert 0 < found["surface_error_mean"] <= found["surface_error_p95"] <= found["surface_error_max"] < 2e-3
    assert found["coverage"] == 1
    assert found["overlap"] == 1
    assert found["inside_volume"] == pytest.approx(1, abs=1e-3)
    assert found["outside_volume"] == pytest.approx(0, abs=0.007)


def test_several_spheres_in_one_place_overlap_and_look_like_one():
    once, twice = measured(BALL, [[0, 0, 0]], [1]), measured(BALL, [[0, 0, 0]] * 2, [1, 1])
    assert twice["overlap"] == 2
    assert measured(BALL, [[0, 0, 0]] * 3, [1, 1, 1])["overlap"] == 3
    assert {name: twice[name] for name in once if name != "overlap"} == {
        name: once[name] for name in once if name != "overlap"
    }


def test_apart_spheres_do_not_overlap():
    assert measured(BALL, [[-0.5, 0, 0], [0.5, 0, 0]], [0.45, 0.45])["overlap"] == 1


def test_two_spheres_one_radius_apart_overlap_by_formula():
    """Unit balls: each has 4/3 pi, their union 9/4 pi."""
    found = measured(BALL, [[-0.5, 0, 0], [0.5, 0, 0]], [1, 1])
    assert found["overlap"] == pytest.approx(8 / 3 / (9 / 4), rel=0.01)


def test_twice_the_radius():
    found = measured(BALL, [[0, 0, 0]], [2])
    assert found["area_bias"] == pytest.approx(3, rel=0.01)
    assert found["spill"] == pytest.approx(3, rel=0.01)
    assert found["silhouette_iou"] == pytest.approx(0.25, rel=0.01)
    assert found["leak"] == 0
    assert found["coverage"] == found["inside_volume"] == 1
    assert found["outside_volume"] == pytest.approx(7, rel=0.02)
    assert found["surface_error_mean"] * NormalizedFrame.from_positions(BALL.positions).diagonal == pytest.approx(
        1, rel=0.002
    )


def test_half_the_radius():
    found = measured(BALL, [[0, 0, 0]], [0.5])
    assert found["leak"] == pytest.approx(0.75, rel=0.01)
    assert found["area_bias"] == pytest.approx(-0.75, rel=0.01)
    assert found["silhouette_iou"] == pytest.approx(0.25, rel=0.02)
    assert found["spill"] == found["outside_volume"] == found["coverage"] == 0
    assert found["inside_volume"] == pytest.approx(1 / 8, rel=0.02)


@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1e3, (5.0, -3, 8)), (1.0, (1e4, 0, 0))])
def test_place_and_size_do_not_matter(scale, offset):
    random = np.random.default_rng(0)
    centers, radii = random.uniform(-0.5, 0.5, (6, 3)), random.uniform(0.2, 0.6, 6)
    plain = measured(BALL, centers, radii)
    scene = replace(BALL, positions=BALL.positions * scale + offset)
    found = measured(scene, centers * scale + offset, radii * scale)
    for name in plain:
        size = scale if name.startswith("radius") else 1
        assert found[name] == pytest.approx(plain[name] * size, rel=1e-3), name


@pytest.mark.parametrize(
    "shape",
    [
        shapes.cap(),
        shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)),
        (np.eye(3), [[0, 1, 2]]),
        (BALL.positions, BALL.faces[1:]),
    ],
    ids=["shell", "plate", "triangle", "ball with a hole"],
)
def test_an_open_mesh_has_no_volume_figures(shape):
    found = measured(shapes.scene(*shape), [[0, 0, 0]], [0.5])
    assert not set(VOLUMES) & set(found)
    assert found["overlap"] == 1


def test_a_sphere_far_away():
    found = measured(BALL, [[20, 0, 0]], [1])
    assert (found["silhouette_iou_min"], found["coverage"], found["inside_volume"]) == (0, 0, 0)
    assert found["silhouette_iou"] < 0.01  # the views from along x
    assert found["leak"] > 0.99
    assert found["spill"] == pytest.approx(1, abs=0.1)  # of some 500 pixels in all views
    assert found["area_bias"] == pytest.approx(0, abs=0.1)
    assert found["surface_error_mean"] * NormalizedFrame.from_positions(BALL.positions).diagonal == pytest.approx(
        19, abs=0.1
    )


def test_a_sphere_in_whose_picture_the_mesh_is_small():
    found = measured(BALL, [[0, 0, 0]], [10])
    assert (found["leak"], found["coverage"]) == (0, 1)
    assert found["area_bias"] == found["spill"] == pytest.approx(10**2 - 1, rel=0.03)
    assert found["silhouette_iou"] == pytest.approx(1 / 10**2, rel=0.03)


@pytest.mark.parametrize("radius", [1e6, 1e30])
def test_a_sphere_beside_which_the_mesh_is_a_speck(radius):
    found = measured(BALL, [[0, 0, 0]], [radius])
    assert np.isfinite(list(found.values())).all()
    assert found["silhouette_iou"] <= 1e-3


@pytest.mark.parametrize(
    "scene",
    [
        shapes.scene(*shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))),
        shapes.scene(*shapes.box((-1, -1, -1e-9), (1, 1, 1e-9))),
        shapes.scene(*shapes.box((-1, -1e-6, -1e-6), (1, 1e-6, 1e-6))),
        shapes.scene([[-1, 0, 0], [1, 0, 0], [0, 1e-7, 0]], [[0, 1, 2]]),
    ],
    ids=["plate", "flat box", "needle", "thin triangle"],
)
@pytest.mark.parametrize("radius", [0.0, 1e-5, 1.0])
def test_flat_meshes_and_needles_give_finite_figures(scene, radius):
    found = measured(scene, [[0, 0, 0], [1, 0, 0]], [radius, radius / 2])
    assert np.isfinite(list(found.values())).all()
    for name in {"silhouette_iou", "leak", "coverage"} & set(found):  # no leak where the mesh covers no pixel
        assert 0 <= found[name] <= 1


def test_inside_and_outside_of_a_box_by_formula():
    """A sphere of radius 1 in a cube of side 2 holds pi/6 of it; around one corner it holds an eighth of itself."""
    cube = shapes.scene(*shapes.box())
    found = measured(cube, [[0, 0, 0]], [1])
    assert found["inside_volume"] == pytest.approx(np.pi / 6, rel=0.005)
    assert found["outside_volume"] == 0
    found = measured(cube, [[1, 1, 1]], [1])
    assert found["inside_volume"] == pytest.approx(np.pi / 48, rel=0.03)
    assert found["outside_volume"] == pytest.approx(np.pi / 6 * 7 / 8, rel=0.02)
