"""A Scene from arrays is the one that the same mesh in a file gives."""

import numpy as np
import pytest

from aoprecalc.errors import ArgumentError, InputError
from aoprecalc.io import load_scene, scene_from_arrays


def test_an_unwelded_copy_has_the_positions_of_the_welded_mesh(cube):
    points, _, _, triangles = cube
    welded = scene_from_arrays(points, triangles)
    soup = scene_from_arrays(points[triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert len(soup.positions) == len(welded.positions) == 8
    assert np.array_equal(soup.corners, welded.corners)
    assert welded.normals is None
    assert welded.uv_sets == ()


def test_arrays_give_what_the_file_gives(cube_obj):
    scene = load_scene(cube_obj)
    again = scene_from_arrays(scene.positions, scene.faces, normals=scene.normals, uvs=scene.uvs)
    assert np.array_equal(again.corners, scene.corners)
    np.testing.assert_allclose(again.normals, scene.normals, atol=1e-7)
    assert np.array_equal(again.uvs, scene.uvs)


def test_values_at_vertices_come_to_the_corners(cube):
    points, _, _, triangles = cube
    scene = scene_from_arrays(points, triangles, normals=2 * points, uvs=points[:, :2])
    np.testing.assert_allclose(scene.normals, (points / 3**0.5)[triangles], atol=1e-7)
    assert np.array_equal(scene.uvs, points[triangles][:, :, :2])


@pytest.mark.parametrize(
    ("argument", "changed"),
    [
        ("vertices", {"vertices": np.zeros((8, 2))}),
        ("vertices", {"vertices": np.full((8, 3), "x")}),
        ("vertices", {"vertices": np.full((8, 3), np.nan)}),
        ("faces", {"faces": np.zeros((1, 4), int)}),
        ("faces", {"faces": [[0, 1, 8]]}),
        ("faces", {"faces": [[0, 1, -1]]}),
        ("faces", {"faces": [[0.0, 1.0, 2.0]]}),
        ("faces", {"faces": np.zeros((0, 3), int)}),
        ("faces", {"faces": [[0, 0, 1]]}),
        ("normals", {"normals": np.zeros((7, 3))}),
        ("uvs", {"uvs": np.zeros((12, 3, 3))}),
    ],
)
def test_errors_name_the_argument(cube, argument, changed):
    arrays = {"vertices": cube[0], "faces": cube[3]} | changed
    with pytest.raises((ArgumentError, InputError), match=rf"^(vertices, )?{argument}\b"):
        scene_from_arrays(**arrays)
