"""A texture on overlapping UVs was verified: an alarming error, and no word about its cause."""

import numpy as np
import pytest
import trimesh

import aoprecalc as ao

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(("scale", "shift", "share"), [(1, 0, "100.0%"), (0.5, 0, "25.0%"), (0.5, 0.5, None)])
def test_the_share_of_the_texels_is_told(scale, shift, share):
    uvs = SQUARE[:, :2]
    pair = [0.5 * uvs + 0.5, scale * uvs] if shift else [uvs, scale * uvs]
    vertices = np.concatenate([SQUARE, SQUARE + (0, 0, 1)])
    mesh = ao.Mesh(vertices, np.concatenate([FACES, FACES + 4]), uvs=np.concatenate(pair), name="squares")
    given = ao.VerifyOptions(points=500, rays=64)
    warnings = ao.verify(mesh, np.ones((64, 64), np.float32), given).warnings
    expected = f"{share} of the texels lie inside two triangles: no texture can be right for both"
    assert [line.split(";")[0] for line in warnings] == ([expected] if share else [])


def test_uvs_that_instances_share_are_a_note(tmp_path):
    square = trimesh.Trimesh(SQUARE, FACES, process=False, visual=trimesh.visual.TextureVisuals(uv=SQUARE[:, :2]))
    scene = trimesh.Scene({"square": square})
    scene.graph.update("above", geometry="square", matrix=trimesh.transformations.translation_matrix([0, 0, 1]))
    scene.export(tmp_path / "squares.glb")
    report = ao.verify(tmp_path / "squares.glb", np.ones((64, 64), np.float32), ao.VerifyOptions(points=500, rays=64))
    assert (report.input.triangles, report.warnings) == (4, ())
    assert [line for line in report.notes if "its UVs with others" in line]
