"""FBX scenes: what ufbx reads is what is baked, and damage is one line."""

import random
import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.io.formats import fbx
from aoprecalc.io.meshes import base_colors, output_mesh_extension, source_files
from aoprecalc.io.occlusion import find_occlusion
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import face_normals
from aoprecalc.options import BakeOptions
from fbx_text import FbxText
from gltf_kit.gltf_validator import issues, needs_validator

pytest.importorskip("ufbx")

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
QUAD = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
UVS = [(0, 0), (1, 0), (1, 1), (0, 1)]


def png(array):
    data = BytesIO()
    Image.fromarray(array).save(data, "PNG")
    return data.getvalue()


HALF = np.full((4, 4, 4), 255, np.uint8)
HALF[:, 2:, 3] = 0  # of it is a hole


@pytest.fixture
def load(save):
    """load(scene, name) -> the Scene that is read of it."""
    return lambda scene, name="a.fbx": load_scene(save(name, str(scene)))


def box(scene, **properties):
    return scene.node("box", scene.mesh(CORNERS, SIDES), **properties)


def faces_outwards(scene, part):
    corners = scene.corners[part.faces]
    outwards = corners.mean(axis=1) - corners.reshape(-1, 3).mean(axis=0)
    return (np.einsum("ij,ij->i", face_normals(corners)[0], outwards) > 0).all()


@pytest.mark.parametrize("scale", [(2, 1, 1), (-2, 1, 1)], ids=["as it is", "mirrored"])
def test_a_mesh_is_placed_in_the_world_and_faces_outwards(load, scale):
    scene = FbxText()
    group = scene.node("group", kind="Null", Lcl_Translation=(500000, 0.125, 0))
    box(scene, parent=group, Lcl_Scaling=scale)
    read = load(scene)
    assert read.positions.min(axis=0).tolist() == [5e5 - 2, -0.875, -1]
    assert read.positions.max(axis=0).tolist() == [5e5 + 2, 1.125, 1]
    assert [(part.name, part.names) for part in read.parts] == [("box", frozenset({"group"}))]
    assert faces_outwards(read, read.parts[0])


def test_pivots_and_geometric_transforms_count(load):
    """T Roff Rp R Rp^-1 S, then the geometric transform, of the mesh alone: the rule of the FBX SDK."""
    scene = FbxText()
    node = box(
        scene,
        Lcl_Translation=(10, 0, 0),
        Lcl_Rotation=(0, 0, 90),
        RotationPivot=(3, 0, 0),
        GeometricTranslation=(0, 5, 0),
        GeometricScaling=(1, 2, 1),
    )
    scene.node("child", scene.mesh(QUAD, [[0, 1, 2, 3]]), parent=node)
    read = load(scene)
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])

    def expected(points):
        return (np.array(points, float) - (3, 0, 0)) @ turn.T + (13, 0, 0)

    of_box, of_child = ({tuple(p) for p in read.corners[part.faces].reshape(-1, 3).round(9)} for part in read.parts)
    assert of_box == {tuple(p) for p in expected(np.array(CORNERS) * (1, 2, 1) + (0, 5, 0)).round(9)}
    assert of_child == {tuple(p) for p in expected(QUAD).round(9)}


def test_polygons_normals_and_uvs_reach_their_corners(load):
    """Of a concave polygon of 5 corners, in a node that mirrors it."""
    points = [(0, 0, 0), (4, 0, 0), (4, 4, 0), (2, 1, 0), (0, 4, 0)]
    normals = [(0.1 * n, 0, 1) for n in range(5)]
    first, second = ([(a * n / 10, n / 20) for n in range(5)] for a in (1, -1))
    scene = FbxText()
    mesh = scene.mesh(points, [[0, 1, 2, 3, 4]], normals, [("map1", first), ("light", second)])
    scene.node("shape", mesh, Lcl_Scaling=(-1, 1, 1))
    read = load(scene)
    assert len(read.faces) == 3
    assert np.abs(face_normals(read.corners)[0] - (0, 0, 1)).max() == 0
    assert np.linalg.norm(np.cross(*np.diff(read.corners, axis=1).transpose(1, 0, 2)), axis=1).sum() == 2 * 10
    for (face, corner), _ in np.ndenumerate(np.empty((3, 3))):
        x, y, _ = read.corners[face, corner]
        number = points.index((-x, y, 0))
        assert [uvs[face, corner].tolist() for uvs in read.uv_sets] == [list(first[number]), list(second[number])]
        assert np.cross(read.normals[face, corner], (-0.1 * number, 0, 1)) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("axis", "up"), [("Y", "y"), ("Z", "z"), ("X", None)])
def test_numbers_are_kept_and_the_frame_is_told(load, axis, up):
    scene = FbxText(axis, unit=2.54)
    box(scene)
    read = load(scene)
    assert np.ptp(read.positions, axis=0).tolist() == [2, 2, 2]
    assert (read.up, read.unit) == (up, pytest.approx(0.0254))
    assert read.notes[0].startswith("its unit is 0.0254 metres")
    assert (f"its axis {axis} points up" in "".join(read.notes)) == (axis != "Y")


def test_each_material_is_a_part_with_the_uvs_of_its_picture(load):
    scene = FbxText()
    plain = scene.material("plain", DiffuseColor=(0.25, 0.5, 1), DiffuseFactor=0.5)
    wood = scene.material("wood", DiffuseColor=(1, 1, 1))
    scene.texture("wood.png", wood, uv_set="light", data=png(HALF[:, :, :3]), scale=(2, 4), offset=(0.5, 0.25))
    mesh = scene.mesh(
        [*QUAD, (4, 0, 0), (4, 2, 0)],
        [[0, 1, 2, 3], [1, 4, 5, 2]],
        uv_sets=[("map1", UVS + UVS), ("light", [(u / 2, v / 2) for u, v in UVS + UVS])],
        materials=[1, 0],
    )
    scene.node("sheet", mesh, materials=[plain, wood])
    read = load(scene)
    assert [(part.name, part.source.material) for part in read.parts] == [("sheet", "plain"), ("sheet", "wood")]
    assert [part.names for part in read.parts] == [{"plain"}, {"wood"}]
    assert read.corners[read.parts[1].faces][:, :, 0].max() == 2
    colors, warnings = base_colors(read)
    assert (colors[0].factor, warnings) == (pytest.approx((0.125, 0.25, 0.5)), ())
    assert read.uvs[read.parts[1].faces].max() == 0.5
    used = read.document.materials["wood"]
    assert used.texture.content() == png(HALF[:, :, :3])
    placed = used.placement.transform(np.array([0.25, 0.5]))
    assert placed == pytest.approx([(0.25 - 0.5) / 2, (0.5 - 0.25) / 4])


@pytest.mark.parametrize(
    ("properties", "opacity"),
    [
        ({"Opacity": 0.25, "TransparencyFactor": 1.0, "TransparentColor": (1, 1, 1)}, 0.25),
        ({"TransparencyFactor": 0.75, "TransparentColor": (1, 1, 1)}, 0.25),
        ({"TransparencyFactor": 1.0, "TransparentColor": (0, 0, 0)}, 1),
        ({"TransparencyFactor": 0.0, "TransparentColor": (1, 1, 1)}, 1),
        ({"TransparencyFactor": 1.0}, 1),
        ({}, 1),
    ],
    ids=["opacity", "complement", "of Maya", "of 3ds Max", "a factor alone", "nothing"],
)
def test_opacity(load, properties, opacity):
    scene = FbxText()
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]]), materials=[scene.material("a", **properties)])
    read = load(scene)
    assert read.document.materials["a"].opacity == pytest.approx(opacity)
    assert read.parts[0].material.transparent == (opacity < 1)


def test_what_is_quite_transparent_is_taken_as_opaque(load):
    scene = FbxText()
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]]), materials=[scene.material("a", Opacity=0.0)])
    read = load(scene)
    assert not read.parts[0].material.transparent
    assert read.warnings == ("the material 'a' has an opacity of 0, which would hide it: it is taken as opaque",)


LUMINANCE = np.where(HALF[:, :, 3:] > 0, 255, 0).astype(np.uint8).repeat(3, axis=2)


@pytest.mark.parametrize("slot", ["TransparentColor", "TransparencyFactor"])
@pytest.mark.parametrize(
    ("pixels", "mode"), [(HALF, "MASK"), (LUMINANCE, "MASK"), (np.full((4, 4, 4), 127, np.uint8), "BLEND")]
)
def test_a_picture_of_the_transparency_is_an_opacity(load, slot, pixels, mode):
    scene = FbxText()
    leaf = scene.material("leaf", DiffuseColor=(1, 1, 1))
    scene.texture("leaf.png", leaf, slot, data=png(pixels))
    mesh = scene.mesh(QUAD, [[0, 1, 2, 3]], uv_sets=[("map1", UVS)])
    scene.node("sheet", mesh, materials=[leaf])
    read = load(scene)
    assert read.warnings == ()
    material = read.parts[0].material
    assert read.document.materials["leaf"].alpha_mode == mode
    assert (material.alpha_mask is not None, material.transparent) == (mode == "MASK", mode == "BLEND")
    if mode == "MASK":
        assert np.array_equal(material.alpha_mask.alpha, HALF[:, :, 3] / 255)


@pytest.mark.parametrize("place", ["leaf.png", "textures/LEAF.png", "../textures/leaf.png", "a.fbm/leaf.png"])
def test_pictures_are_found_where_packs_have_them(save, place):
    scene = FbxText()
    leaf = scene.material("leaf")
    scene.texture("D:\\art\\leaf.png", leaf)
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]], uv_sets=[("map1", UVS)]), materials=[leaf])
    path = save("source/a.fbx", str(scene))
    picture = save(f"source/{place}", png(HALF))
    read = load_scene(path)
    assert read.notes[0] == f"the material 'leaf': the alpha of {picture.name} cuts holes into it"
    assert base_colors(read)[1] == ()
    assert picture.resolve() in [file.resolve() for file in source_files(read)]


def test_what_is_lost_is_named(load):
    scene = FbxText()
    wall = scene.material("wall")
    scene.texture("missing.png", wall)
    scene.texture("bumps.png", wall, "Bump", data=png(HALF))
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]], uv_sets=[("map1", UVS)]), materials=[wall])
    scene.node("lamp", scene._add("NodeAttribute", "NodeAttribute", "", "Light", ""), kind="Light")
    scene.node("eye", scene._add("NodeAttribute", "NodeAttribute", "", "Camera", ""), kind="Camera")
    read = load(scene)
    assert "FBX is read without cameras, lights, which it has; export it as glTF" in read.warnings[-1]
    assert read.document.materials["wall"].left_out == ("Bump bumps.png",)
    _, (warning,) = base_colors(read)
    assert "missing.png" in warning


def test_hidden_meshes_are_left_out(load):
    scene = FbxText()
    group = scene.node("group", kind="Null", Visibility=0)
    box(scene, parent=group)
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]]))
    read = load(scene)
    assert [part.name for part in read.parts] == ["sheet"]
    assert "1 hidden mesh left out" in read.notes
    alone = FbxText()
    box(alone, Visibility=0)
    with pytest.raises(InputError, match="no mesh is shown, a surface was expected; 1 hidden mesh left out"):
        load(alone)


def test_instances_are_parts(load):
    scene = FbxText()
    mesh = scene.mesh(CORNERS, SIDES)
    for number in range(3):
        scene.node(f"box{number}", mesh, Lcl_Translation=(4 * number, 0, 0))
    read = load(scene)
    assert [part.name for part in read.parts] == ["box0", "box1", "box2"]
    assert [read.corners[part.faces][:, :, 0].max() for part in read.parts] == [1, 5, 9]


def test_levels_of_a_lod_group_are_levels_of_detail(load):
    scene = FbxText()
    group = scene.node("tree", scene.lod_group(), kind="LodGroup")
    for name in ("fine", "coarse"):
        scene.node(name, scene.mesh(CORNERS, SIDES), parent=group)
    scene.node("UCX_tree", scene.mesh(CORNERS, SIDES))
    read = assign_roles(load(scene), BakeOptions())
    assert {part.name: (part.levels, part.hull) for part in read.parts} == {
        "fine": (range(1), False),
        "coarse": (range(1, 2), False),
        "UCX_tree": (None, True),
    }


def test_the_bake_becomes_a_glb_with_colours_masks_and_embedded_pictures(load, bake):
    scene = FbxText()
    leaf = scene.material("leaf", DiffuseColor=(1, 0.5, 1))
    scene.texture("leaf.png", leaf, data=png(HALF))
    scene.texture("leaf.png", leaf, "TransparencyFactor", data=png(HALF))
    glass = scene.material("glass", DiffuseColor=(0, 0, 0), Opacity=0.5)
    mesh = scene.mesh(
        [*QUAD, (4, 0, 0), (4, 2, 0)], [[0, 1, 2, 3], [1, 4, 5, 2]], uv_sets=[("map1", UVS + UVS)], materials=[0, 1]
    )
    scene.node("sheet", mesh, materials=[leaf, glass])
    before = load(scene)
    assert output_mesh_extension(before) == (".glb", "FBX is not written, so the mesh becomes a GLB")
    path, *_ = bake(before, "a_ao.glb")
    after = load_scene(path)
    assert np.array_equal(after.corners, before.corners)
    assert [part.material.transparent for part in after.parts] == [False, True]
    mask = after.parts[0].material.alpha_mask
    assert np.array_equal(mask.alpha, HALF[:, :, 3] / 255)
    assert np.array_equal(mask.uvs, before.parts[0].material.alpha_mask.uvs)
    colors, warnings = base_colors(after)
    assert (colors[0].factor, warnings) == (pytest.approx((1, 0.5, 1), abs=1e-6), ())
    assert np.array_equal(colors[0].texture, HALF[:, :, :3])


def test_a_bake_on_the_second_uv_set_is_written_on_it(load, bake):
    overlapping = FbxText()
    mesh = overlapping.mesh(
        [*QUAD, (4, 0, 0), (4, 2, 0)],
        [[0, 1, 2, 3], [1, 4, 5, 2]],
        uv_sets=[("map1", UVS + UVS), ("light", [(u / 2 + x, v) for x in (0, 0.5) for u, v in UVS])],
    )
    overlapping.node("sheet", mesh)
    before = load(overlapping)
    path, *_, messages = bake(before, "a_ao.glb", "keep 1")
    assert not [line for line in messages if "UV set" in line]
    *_, messages = bake(before, "b_ao.glb")
    assert [line for line in messages if "1 further UV set of a.fbx left out" in line]
    assert np.allclose(find_occlusion(load_scene(path)).uvs, before.uv_sets[1])


# Damage.


def whole():
    """A small scene of everything, in bytes."""
    scene = FbxText()
    leaf = scene.material("leaf", DiffuseColor=(1, 1, 1))
    scene.texture("leaf.png", leaf, data=png(HALF))
    normals = [(0, 0, 1)] * 8
    mesh = scene.mesh(
        [*QUAD, (4, 0, 0), (4, 2, 0)], [[0, 1, 2, 3], [1, 4, 5, 2]], normals, [("map1", UVS + UVS)], materials=[0, 0]
    )
    scene.node("sheet", mesh, materials=[leaf], Lcl_Scaling=(1, 2, 1))
    return str(scene).encode()


def fault(path):
    """What is wrong with a file, in one line; empty where it can be read. Any other error fails."""
    try:
        load_scene(path)
    except InputError as error:
        return str(error)
    return ""


def is_one_line(text, path):
    return text.startswith(f"{path}: ") and "\n" not in text


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.95])
def test_a_truncated_file_is_an_input_error(save, part):
    data = whole()
    path = save("a.fbx", data[: int(len(data) * part)])
    assert is_one_line(fault(path), path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(24))
def test_any_damage_is_read_or_an_input_error(save, seed):
    chance, data = random.Random(seed), bytearray(whole())
    for _ in range(chance.choice([1, 3, 30])):
        data[chance.randrange(len(data))] = chance.randrange(256)
    path = save("a.fbx", bytes(data[: chance.choice([len(data), chance.randrange(len(data))])]))
    found = fault(path)
    assert not found or is_one_line(found, path)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("a: 0,1,2,-4,1,4,5,-3", "a: 0,99,2,-4,1,4,5,-3", "cannot be read as FBX"),
        ("a: 0,0,0,2,0,0", "a: 0,0,0,nan,0,0", "not finite"),
        ("a: 0,1,2,-4,1,4,5,-3", "a: ", "no faces"),
        ("Objects:  {", "Objects: @", "cannot be read as FBX"),
    ],
)
def test_damage_is_named(save, old, new, found):
    data = whole().decode()
    assert old in data
    with pytest.raises(InputError, match=found):
        load_scene(save("a.fbx", data.replace(old, new, 1)))


@needs_validator
def test_the_validator_finds_nothing(save, bake):
    path, *_ = bake(load_scene(save("a.fbx", whole())), "a_ao.glb")
    assert [issue["message"] for issue in issues(path)[0]] == []


def test_a_missing_package_is_named(save, monkeypatch):
    monkeypatch.setattr(fbx, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=re.escape("`pip install 'aoprecalc[fbx]'`")):
        load_scene(save("a.fbx", str(FbxText())))
