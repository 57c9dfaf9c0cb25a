"""Normals of faces and corners, and how a surface hangs together."""

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.mesh.surface import geometric_normals, shading_normals
from aoprecalc.mesh.topology import Topology, topology
from shapes import ball, box, hull, join, quad, scene


def roof(angle):
    """Two unit squares that share an edge along y and bend there by `angle` degrees."""
    left = quad((-1, 0, 0), (1, 0, 0), (0, 1, 0))
    bend = np.radians(angle)
    positions = np.array([*left[0], (np.cos(bend), 0, -np.sin(bend)), (np.cos(bend), 1, -np.sin(bend))])
    shared = {tuple(p): i for i, p in enumerate(np.round(positions, 9))}
    a, b = shared[(0, 0, 0)], shared[(0, 1, 0)]
    return scene(positions, np.concatenate([left[1], [[a, 4, 5], [a, 5, b]]]))


@pytest.mark.parametrize(
    ("angle", "crease", "smooth"), [(30, 40, True), (50, 40, False), (50, 60, True), (89, 180, True)]
)
def test_edges_are_hard_beyond_the_crease_angle(angle, crease, smooth):
    made = roof(angle)
    normals = shading_normals(made, "smooth", crease)
    on_ridge = np.isclose(made.corners[..., 0], 0)
    own = geometric_normals(made, normals)[:, None]
    kept = np.isclose(np.einsum("fcx,fcx->fc", normals, np.broadcast_to(own, normals.shape)), 1, atol=1e-6)
    assert kept[~on_ridge].all()
    assert kept[on_ridge].any() != smooth
    for end in (0, 1):
        there = normals[on_ridge & np.isclose(made.corners[..., 1], end)]
        assert np.allclose(there, there[0]) == smooth


def test_a_box_with_creases_has_the_normals_of_its_sides():
    made = scene(*box())
    assert shading_normals(made, "smooth", 40) == pytest.approx(shading_normals(made, "flat"), abs=1e-6)


def test_smooth_normals_of_a_ball_point_outwards():
    made = scene(*ball(3))
    assert shading_normals(made) == pytest.approx(made.corners, abs=0.02)


def test_stl_is_creased_by_default():
    made = scene(*box())
    soup = type(made)(made.path, "stl", made.positions, made.faces, None, None, made.parts)
    assert shading_normals(soup) == pytest.approx(shading_normals(made, "flat"), abs=1e-6)


def test_the_files_normals_are_used_or_missed():
    normals = np.broadcast_to(np.array([0, 0.6, 0.8]), (2, 3, 3))
    plane = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    assert (shading_normals(scene(*plane, normals=normals)) == normals.astype(np.float32)).all()
    with pytest.raises(InputError, match="has no normals"):
        shading_normals(scene(*plane), "file")


def test_opposite_faces_at_one_place_keep_their_own_normals():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    made = scene(positions, np.concatenate([faces, faces[:, ::-1]]))
    assert shading_normals(made) == pytest.approx(shading_normals(made, "flat"))


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_normals_are_unit_at_any_scale(scale):
    positions, faces = ball(1)
    assert np.linalg.norm(shading_normals(scene(positions * scale, faces)), axis=2) == pytest.approx(1)


def test_a_face_is_turned_only_if_all_its_corners_oppose_it():
    plane = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    down = np.broadcast_to(np.array([0.0, 0, -1]), (2, 3, 3))
    assert geometric_normals(scene(*plane), down) == pytest.approx(down[:, 0])
    mixed = down.copy()
    mixed[:, 0] = (0, 0, 1)
    assert geometric_normals(scene(*plane), mixed) == pytest.approx(-down[:, 0])


def test_topology_counts_pieces_and_finds_holes():
    two = join(ball(1), (box()[0] + 5, box()[1]))
    assert topology(two[1]) == Topology(components=2, watertight=True)
    _, faces = hull(np.random.default_rng(0).normal(size=(30, 3)))
    assert topology(faces).watertight
    assert not topology(faces[1:]).watertight
    assert topology(np.array([[0, 0, 1]])).components == 0
