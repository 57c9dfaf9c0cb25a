"""COLLADA and 3MF are read through trimesh: the geometry of every instance, in the world."""

import re

import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene, output_mesh_extension
from aoprecalc.mesh.surface import face_normals

MOVED_AND_MIRRORED = np.array([[-1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def box():
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2] + 0.5)
    return mesh


@pytest.fixture
def boxes_3mf(save):
    """A box and a moved, mirrored instance of it."""
    scene = trimesh.Scene()
    scene.add_geometry(box(), node_name="box", geom_name="shape")
    scene.add_geometry(box(), node_name="copy", geom_name="shape", transform=MOVED_AND_MIRRORED)
    return save("boxes.3mf", scene.export(file_type="3mf"))


@pytest.fixture
def box_dae(save):
    """A moved and mirrored box with normals and UVs."""
    matrix = " ".join(map(str, MOVED_AND_MIRRORED.ravel()))
    text = box().export(file_type="dae").decode()
    return save("box.dae", re.sub(r"(<node [^>]*>)", rf"\1<matrix>{matrix}</matrix>", text, count=1))


def faces_outwards(scene, part):
    corners = scene.corners[part.faces]
    outwards = corners.mean(axis=1) - corners.reshape(-1, 3).mean(axis=0)
    return (np.einsum("ij,ij->i", face_normals(corners)[0], outwards) > 0).all()


def test_3mf_instances_are_parts(boxes_3mf):
    scene = load_scene(boxes_3mf)
    assert (scene.format, [part.name for part in scene.parts]) == ("3mf", ["box", "copy"])
    assert (len(scene.faces), len(scene.positions)) == (24, 16)
    assert np.ptp(scene.positions, axis=0).tolist() == [6, 2, 3]
    assert all(faces_outwards(scene, part) for part in scene.parts)
    assert scene.normals is None


def test_collada_has_normals_and_uvs(box_dae):
    scene = load_scene(box_dae)
    assert len(scene.faces) == 12
    assert scene.positions.max(axis=0) == pytest.approx([5.5, 1, 1.5])
    assert faces_outwards(scene, scene.parts[0])
    outwards = scene.corners - scene.positions.mean(axis=0)
    assert (np.einsum("fcx,fcx->fc", scene.normals, outwards) > 0).all()
    assert scene.uvs == pytest.approx((scene.corners * (-1, 1, 1) + (5, 0, 0))[:, :, :2] + 0.5)


def test_the_bake_becomes_a_glb_and_says_what_is_missing(box_dae, bake):
    scene = load_scene(box_dae)
    suffix, reason = output_mesh_extension(scene)
    assert (suffix, "COLLADA" in reason) == (".glb", True)
    path, _, _, warnings = bake(scene, "box_ao.glb")
    assert len(load_scene(path).faces) == 12
    assert any("COLLADA was read without its materials" in line for line in warnings)


def test_a_missing_package_is_named(boxes_3mf, monkeypatch):
    monkeypatch.setattr(trimesh, "available_formats", lambda: {"obj"})
    with pytest.raises(
        InputError, match=r"3MF needs the package networkx and lxml; `pip install 'aoprecalc\[formats\]'`"
    ):
        load_scene(boxes_3mf)


def test_a_damaged_file_is_an_input_error(save, box_dae):
    with pytest.raises(InputError, match="cannot be read as 3MF"):
        load_scene(save("bad.3mf", b"PK\3\4 3D/3dmodel.model"))
    with pytest.raises(InputError):
        load_scene(save("bad.dae", box_dae.read_bytes()[:900]))


def test_a_file_under_a_wrong_extension_is_recognised(save, box_dae, cube_obj):
    for name, path, expected in (("a.obj", box_dae, "COLLADA"), ("b.glb", cube_obj, "OBJ"), ("c.3mf", cube_obj, "OBJ")):
        with pytest.raises(InputError, match=f"its content is {expected}"):
            load_scene(save(name, path.read_bytes()))
