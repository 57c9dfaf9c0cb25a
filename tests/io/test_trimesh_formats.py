"""3MF is read through trimesh: the geometry of every instance, in the world."""

import io
import zipfile

import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.mesh.surface import face_normals

MOVED_AND_MIRRORED = np.array([[-1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def box():
    return trimesh.creation.box((1, 2, 3))


@pytest.fixture
def boxes_3mf(save):
    """A box and a moved, mirrored instance of it."""
    scene = trimesh.Scene()
    scene.add_geometry(box(), node_name="box", geom_name="shape")
    scene.add_geometry(box(), node_name="copy", geom_name="shape", transform=MOVED_AND_MIRRORED)
    return save("boxes.3mf", scene.export(file_type="3mf"))


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


def test_a_missing_package_is_named(boxes_3mf, monkeypatch):
    monkeypatch.setattr(trimesh, "available_formats", lambda: {"obj"})
    with pytest.raises(
        InputError, match=r"3MF needs the package networkx and lxml; `pip install 'aoprecalc\[formats\]'`"
    ):
        load_scene(boxes_3mf)


def test_a_damaged_file_is_an_input_error(save):
    with pytest.raises(InputError, match="cannot be read as 3MF"):
        load_scene(save("bad.3mf", b"PK\3\4 3D/3dmodel.model"))


def test_a_file_under_a_wrong_extension_is_recognised(save, boxes_3mf, cube_obj):
    for name, path, expected in (("a.obj", boxes_3mf, "3MF"), ("b.glb", cube_obj, "OBJ"), ("c.3mf", cube_obj, "OBJ")):
        with pytest.raises(InputError, match=f"its content is {expected}"):
            load_scene(save(name, path.read_bytes()))


def with_model(path, old, new):
    """The bytes of a 3MF in whose model a text is replaced."""
    made = io.BytesIO()
    with zipfile.ZipFile(path) as before, zipfile.ZipFile(made, "w") as after:
        for name in before.namelist():
            content = before.read(name)
            after.writestr(name, content.replace(old, new) if name.lower().endswith(".model") else content)
    return made.getvalue()


@pytest.mark.parametrize(
    ("element", "words"),
    [
        (b'<basematerials id="9"><base name="a" displaycolor="#FF0000"/></basematerials>', "materials and colours"),
        (b'<m:colorgroup id="9"><m:color color="#FF0000"/></m:colorgroup>', "materials and colours"),
        (b'<m:texture2d id="9" path="/3D/a.png" contenttype="image/png"/>', "textures"),
    ],
)
def test_what_a_3mf_has_and_is_not_read_is_named(save, boxes_3mf, element, words):
    assert load_scene(boxes_3mf).warnings == ()
    data = with_model(boxes_3mf, b"<resources>", b"<resources>" + element)
    (warning,) = load_scene(save("b.3mf", data)).warnings
    assert f"3MF is read without {words}, which it has" in warning


def test_the_unit_is_told(boxes_3mf):
    (note,) = load_scene(boxes_3mf).notes
    assert "its unit is the millimeter, and Z points up" in note
    assert np.ptp(load_scene(boxes_3mf).positions, axis=0).tolist() == [6, 2, 3]
