"""A bake on the UVs of a PLY replaced its TextureFile, and list properties and colours were lost, without a word."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from aoprecalc import BakeOptions
from aoprecalc.api.bake import bake_file
from aoprecalc.io import load_scene
from aoprecalc.io.formats.ply_table import read_header, read_table
from aoprecalc.io.meshes import base_colors
from aoprecalc.io.occlusion import find_occlusion
from aoprecalc.texture_lookup import linear_from_srgb
from gltf_kit.gltf_validator import ERROR, issues, needs_validator

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 1), (2, 1, 1)]
FACES = [(0, 1, 2, 3), (1, 4, 5, 2)]
UVS = [(0.1, 0.1), (0.5, 0.1), (0.5, 0.9), (0.1, 0.9), (0.9, 0.1), (0.9, 0.9)]


def ply(head="", vertex="", face="", vertex_row="", face_row="", uvs="float s\nproperty float t"):
    lines = ["ply", "format ascii 1.0", *head.splitlines(), f"element vertex {len(POINTS)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"property {uvs}"] * bool(uvs) + vertex.splitlines() + [f"element face {len(FACES)}"]
    lines += ["property list uchar int vertex_indices", *face.splitlines(), "end_header"]
    for index, (point, uv) in enumerate(zip(POINTS, UVS, strict=True)):
        lines.append(" ".join([*map(str, point), *map(str, uv if uvs else ()), vertex_row.format(index)]))
    for index, corners in enumerate(FACES):
        lines.append(" ".join([str(len(corners)), *map(str, corners), face_row.format(index)]))
    return "\n".join(lines) + "\n"


@pytest.fixture
def bake(tmp_path):
    """bake(mesh, output, options) -> the lines that the user sees."""

    def run(mesh, output, **options):
        output.parent.mkdir(exist_ok=True)
        done = bake_file(mesh, output, options=BakeOptions(size=32, directions=64, backend="ray", **options))
        return [*done.report.warnings, *done.report.notes]

    return run


def tables(path):
    header = read_header(path, path.read_bytes())
    return header, read_table(path, header.elements, header.body, header.order)


@pytest.fixture
def textured(tmp_path):
    Image.new("RGB", (4, 4), (200, 30, 60)).save(tmp_path / "colour.png")
    (tmp_path / "a.ply").write_text(ply("comment TextureFile colour.png\ncomment mine"))
    return tmp_path / "a.ply"


def test_on_kept_uvs_the_picture_stays_and_the_bake_is_the_second(textured, bake, tmp_path):
    lines = bake(textured, tmp_path / "out" / "a_ao.png")
    assert any("colour.png stays its first TextureFile" in line for line in lines)
    baked = tmp_path / "out" / "a_ao.ply"
    header, _ = tables(baked)
    assert header.textures == ("colour.png", "a_ao.png")
    assert header.comments == ("comment mine",)
    scene = load_scene(baked)
    (color,), warnings = base_colors(scene)
    assert (color.texture[0, 0].tolist(), warnings) == ([200, 30, 60], ())
    assert find_occlusion(scene).path == baked.with_suffix(".png")
    assert trimesh.load(baked, process=False).visual.uv.shape == (6, 2)


def test_a_bake_of_that_replaces_only_the_bake(textured, bake, tmp_path):
    bake(textured, tmp_path / "out" / "a_ao.png")
    bake(tmp_path / "out" / "a_ao.ply", tmp_path / "b.png")
    assert tables(tmp_path / "b.ply")[0].textures == ("out/colour.png", "b.png")


def test_on_new_uvs_a_warning_says_where_the_picture_is(textured, bake, tmp_path):
    lines = bake(textured, tmp_path / "a_ao.png", unwrap="xatlas")
    assert tables(tmp_path / "a_ao.ply")[0].textures == ("a_ao.png",)
    assert any(str(tmp_path / "colour.png") in line and "a_ao.ply" in line for line in lines)


@pytest.mark.parametrize("unwrap", ["keep", "xatlas"])
def test_a_glb_has_both(textured, bake, tmp_path, unwrap):
    bake(textured, tmp_path / "a_ao.glb", unwrap=unwrap)
    (material,) = load_scene(tmp_path / "a_ao.glb").document.json["materials"]
    assert material["occlusionTexture"]["index"] != material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    (mesh,) = trimesh.load_scene(tmp_path / "a_ao.glb").geometry.values()
    assert np.asarray(mesh.visual.material.baseColorTexture)[0, 0].tolist() == [200, 30, 60]


def test_faces_of_several_pictures(tmp_path, bake):
    for name in ("one", "two"):
        Image.new("RGB", (4, 4)).save(tmp_path / f"{name}.png")
    names = "comment TextureFile one.png\ncomment TextureFile two.png"
    (tmp_path / "a.ply").write_text(ply(names, face="property int texnumber", face_row="{}"))
    assert "2 textures: only one.png" in load_scene(tmp_path / "a.ply").warnings[0]
    bake(tmp_path / "a.ply", tmp_path / "a_ao.png")
    header, found = tables(tmp_path / "a_ao.ply")
    assert header.textures == ("one.png", "two.png", "a_ao.png")
    assert found["face"].columns["texnumber"].tolist() == [0, 1]


# Properties.


@pytest.mark.parametrize("unwrap", ["keep", "xatlas"])
def test_properties_of_all_kinds_are_kept(tmp_path, bake, unwrap):
    vertex = "property uchar alpha\nproperty list uchar short seen\nproperty double quality"
    face = "property list uchar int labels\nproperty ushort kind\nproperty list uchar float wedge"
    text = ply("", vertex, face, "7{0} 2 {0} {0}5 0.125", "1 1{0} 30{0} 4 {0}.1 {0}.2 {0}.3 {0}.4")
    (tmp_path / "a.ply").write_text(text)
    bake(tmp_path / "a.ply", tmp_path / "a_ao.png", unwrap=unwrap)
    _, found = tables(tmp_path / "a_ao.ply")
    vertices, faces = found["vertex"], found["face"]
    corners = np.column_stack([vertices.columns[axis] for axis in "xyz"])
    origin = [POINTS.index(tuple(row)) for row in corners.tolist()]
    assert vertices.columns["alpha"].tolist() == [70 + index for index in origin]
    assert vertices.columns["alpha"].dtype == np.uint8
    assert vertices.lists["seen"].values.reshape(-1, 2).tolist() == [[i, 10 * i + 5] for i in origin]
    owners = [kind - 300 for kind in faces.columns["kind"].tolist()]
    assert faces.lists["labels"].values.tolist() == [10 + owner for owner in owners]
    starts = np.cumsum(faces.lists["wedge"].counts)[:-1]
    loops = np.split(faces.lists["vertex_indices"].values, starts)
    for owner, loop, wedge in zip(owners, loops, np.split(faces.lists["wedge"].values, starts), strict=True):
        places = [FACES[owner].index(origin[vertex]) for vertex in loop]
        assert wedge == pytest.approx([owner + 0.1 * (place + 1) for place in places])


COLOURS = {
    "uchar": ("property uchar red\nproperty uchar green\nproperty uchar blue", "5{0} 128 255", (50, 128, 255), 255),
    "float": ("property float red\nproperty float green\nproperty float blue", "0.5{0} 0.25 1", (0.5, 0.25, 1), 1),
    "short": (
        "property ushort red\nproperty ushort green\nproperty ushort blue",
        "5{0} 9 65535",
        (50, 9, 65535),
        65535,
    ),
}


@pytest.mark.parametrize("kind", COLOURS)
@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("of_faces", [False, True])
def test_colours_reach_a_glb(tmp_path, bake, kind, alpha, of_faces):
    properties, row, first, scale = COLOURS[kind]
    properties += "\nproperty float alpha" * alpha
    row += " 0.5" * alpha
    text = ply("", "", properties, "", row) if of_faces else ply("", properties, "", row)
    (tmp_path / "a.ply").write_text(text)
    bake(tmp_path / "a.ply", tmp_path / "a_ao.glb")
    document = load_scene(tmp_path / "a_ao.glb").document
    primitive = document.json["meshes"][0]["primitives"][0]
    assert document.json["accessors"][primitive["attributes"]["COLOR_0"]]["type"] == f"VEC{3 + alpha}"
    (ours,), (theirs,) = (
        base_colors(load_scene(tmp_path / "a.ply"))[0],
        base_colors(load_scene(tmp_path / "a_ao.glb"))[0],
    )
    assert theirs.corners == pytest.approx(ours.corners)
    assert ours.corners[0, 0] == pytest.approx(linear_from_srgb(np.array(first) / scale))


def test_colours_that_an_obj_does_not_hold_are_named(tmp_path, bake):
    (tmp_path / "a.ply").write_text(ply("", COLOURS["uchar"][0], "", COLOURS["uchar"][1]))
    assert any("the colours of the vertices of a.ply" in line for line in bake(tmp_path / "a.ply", tmp_path / "b.obj"))


@pytest.mark.parametrize("ends", ["\r\n", "\r"])
def test_any_line_ends(tmp_path, ends):
    (tmp_path / "a.ply").write_bytes(ply().replace("\n", ends).encode())
    assert len(load_scene(tmp_path / "a.ply").faces) == 4


@needs_validator
def test_the_validator_finds_nothing(textured, bake, tmp_path):
    bake(textured, tmp_path / "a_ao.glb", unwrap="xatlas")
    (tmp_path / "b.ply").write_text(ply("", COLOURS["float"][0], "", COLOURS["float"][1]))
    bake(tmp_path / "b.ply", tmp_path / "b_ao.gltf")
    found = issues(tmp_path / "a_ao.glb", tmp_path / "b_ao.gltf")
    assert [issue for each in found for issue in each if issue["severity"] == ERROR] == []
