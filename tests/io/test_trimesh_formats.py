"""COLLADA and 3MF are read through trimesh: the geometry of every instance, in the world."""

import io
import re
import zipfile

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
    path, *_ = bake(scene, "box_ao.glb")
    assert len(load_scene(path).faces) == 12
    assert scene.warnings == (f"{box_dae}: COLLADA is read without materials, which it has; export it as glTF",)


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


@pytest.mark.parametrize(
    ("element", "words"),
    [
        ("<library_images><image><init_from>a.png</init_from></image></library_images>", "textures"),
        ("<library_animations><animation/></library_animations>", "animations"),
        ("<library_cameras><camera id='a'/></library_cameras>", "cameras"),
        ("<library_lights><light id='a'/></library_lights>", "lights"),
    ],
)
def test_what_a_collada_has_and_is_not_read_is_named(save, element, words):
    text = box().export(file_type="dae").decode()
    assert words not in load_scene(save("a.dae", text)).warnings[0]
    with_more = text.replace("<library_geometries>", f"{element}<library_geometries>", 1)
    assert words in load_scene(save("b.dae", with_more)).warnings[0]
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as files:
        files.writestr("b.dae", with_more)
    assert words in load_scene(save("b.zae", archive.getvalue())).warnings[0]


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


def test_units_and_axes_are_told(save, boxes_3mf, box_dae):
    (note,) = load_scene(boxes_3mf).notes
    assert "its unit is the millimeter, and Z points up" in note
    assert np.ptp(load_scene(boxes_3mf).positions, axis=0).tolist() == [6, 2, 3]
    text = box().export(file_type="dae").decode()
    assert load_scene(save("a.dae", text)).notes == ()
    inches = re.sub(r"<unit [^>]*>|<up_axis>[^<]*</up_axis>", "", text)
    asset = '<unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>'
    notes = load_scene(save("b.dae", inches.replace("</asset>", asset, 1))).notes
    assert ["its unit is 0.0254 metres" in notes[0], "its axis Z points up" in notes[1]] == [True, True]


def test_3mf_components_and_transforms_are_placed(save, boxes_3mf):
    part = b'<object id="50"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 7 8 9"/>'
    part += b"</components></object></resources>"
    data = with_model(boxes_3mf, b"</resources>", part)
    item = b'<item objectid="50" transform="1 0 0 0 1 0 0 0 1 100 0 0"/></build>'
    data = with_model(io.BytesIO(data), b"</build>", item)
    scene = load_scene(save("b.3mf", data))
    sizes = [np.ptp(scene.corners[part.faces].reshape(-1, 3), axis=0).tolist() for part in scene.parts]
    middles = [scene.corners[part.faces].reshape(-1, 3).mean(axis=0).tolist() for part in scene.parts]
    assert [2, 1, 3] in sizes
    assert pytest.approx([107, 8, 9]) in middles
    assert len(scene.parts) == 3
