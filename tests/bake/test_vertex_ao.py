"""Values at vertices of whole bakes: which parts have them, what is shared, how near they come to the texture."""

from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.surface import SurfacePoints
from aoprecalc.mesh.vertex_values import vertex_groups
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from shapes import ball, box, clutter, quad, scene, scene_of_parts


def baked(made, **options):
    return bake_scene(
        made, BakeOptions(**{"size": 128, "directions": 256, "backend": "ray", "vertex_ao": "attribute", **options})
    )


def as_mesh(made):
    return ao.Mesh(made.positions, made.faces)


def test_both_sides_of_a_seam_have_one_value():
    result = baked(scene(*clutter(2)))
    groups, values = vertex_groups(result.scene, result.normals), result.vertex_ao
    assert np.array_equal(values, values.ravel()[np.unique(groups, return_index=True)[1]][groups])
    assert 0 <= values.min() < values.max() <= 1


def test_an_open_shape_is_open_and_a_closed_room_closed():
    assert baked(scene(*ball(2))).vertex_ao == pytest.approx(1, abs=0.01)
    positions, faces = box()
    assert baked(scene(positions, faces[:, ::-1])).vertex_ao == pytest.approx(0, abs=0.01)


def test_a_corner_is_dark_where_its_walls_meet():
    floor, wall = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 6), quad((0, 0, 0), (0, 1, 0), (0, 0, 1), 6)
    result = baked(scene_of_parts(floor, wall), normals="flat")
    assert result.scene.corners.min() == 0
    from_edge = result.scene.corners[:72, :, 0]  # of the floor
    by_row = [result.vertex_ao[:72][np.isclose(from_edge, row / 6)].mean() for row in range(7)]
    assert by_row == sorted(by_row)
    assert by_row[0] == pytest.approx(0.5, abs=0.1)  # half of the light
    assert by_row[-1] > 0.85


def test_parts_that_are_not_baked_have_one():
    made = scene_of_parts(ball(1), quad((-2, -2, -1.05), (4, 0, 0), (0, 4, 0)))
    result = baked(made, only=("part 0",))
    assert (result.vertex_ao[result.scene.parts[1].faces] == 1).all()
    assert result.vertex_ao[result.scene.parts[0].faces].min() < 0.6


def test_shared_texels_give_shared_values():
    made = scene_of_parts(ball(1), (ball(1)[0] + [3, 0, 0], ball(1)[1]))
    parts = made.parts[0], replace(made.parts[1], instance_of=0)
    result = baked(replace(made, parts=parts), instances="share")
    first, second = (result.vertex_ao[part.faces] for part in result.scene.parts)
    assert np.array_equal(first, second)
    assert first.min() < 0.99


@pytest.mark.parametrize("verify", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_report_tells_how_near_they_come(verify):
    result = ao.bake(
        as_mesh(scene(*clutter(0))),
        BakeOptions(size=128, directions=256, backend="ray", vertex_ao="color", crease_angle=60),
        verify=verify,
    )
    fit = result.report.vertex_ao
    assert result.vertex_ao.shape == (len(result.mesh.faces), 3)
    assert result.vertex_ao.dtype == np.float32
    assert fit.vertices == 128 + 5 * 24
    assert 0.01 < fit.rmse < 0.2
    assert fit.traced_rmse == (pytest.approx(fit.rmse, abs=0.05) if verify else None)


def test_nothing_is_computed_unless_asked_for():
    result = ao.bake(as_mesh(scene(*ball(1))), BakeOptions(size=64, directions=16))
    assert result.vertex_ao is None
    assert result.report.vertex_ao is None


def test_the_same_bake_gives_the_same_values():
    made = scene(*clutter(1))
    assert np.array_equal(*(baked(made).vertex_ao for _ in range(2)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_they_are_nearer_to_rays_than_values_sampled_at_the_vertices(seed):
    made = scene(*clutter(seed))
    result = baked(made, size=512, directions=1000, crease_angle=40)
    made, how = result.scene, VerifyOptions(rays=1024)
    corners = np.arange(made.faces.size)
    at_corners = reference_ao(
        made, result.normals, SurfacePoints(corners // 3, np.eye(3)[corners % 3]), how, Progress()
    )
    groups = vertex_groups(made, result.normals).ravel()
    sampled = (np.bincount(groups, at_corners) / np.bincount(groups))[groups].reshape(-1, 3)
    rng = np.random.default_rng(seed)
    areas = np.linalg.norm(np.cross(*(made.corners[:, k] - made.corners[:, 0] for k in (1, 2))), axis=1)
    faces = rng.choice(len(areas), 4000, p=areas / areas.sum())
    points = SurfacePoints(faces, rng.dirichlet([1, 1, 1], 4000))
    expected = reference_ao(made, result.normals, points, how, Progress())
    errors = [
        np.sqrt(np.mean((points.interpolate(values[:, :, None])[:, 0] - expected) ** 2))
        for values in (sampled, result.vertex_ao)
    ]
    assert errors[1] < errors[0]
