"""What the materials, names and places of a glTF document say about its parts."""

import base64

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import read_image
from aoprecalc.io.images import write_colors

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")


def primitive(maker, material, **attributes):
    """A triangle of a new material."""
    materials = maker.json.setdefault("materials", [])
    materials.append(material)
    given = {name: maker.accessor(values) for name, values in attributes.items()}
    return {"attributes": {"POSITION": maker.accessor(TRIANGLE), **given}, "material": len(materials) - 1}


def material_of(maker, material, **attributes):
    maker.node(mesh=maker.mesh(primitive(maker, material, **attributes)))
    return maker.load().parts[-1].material


@pytest.fixture
def picture(gltf, tmp_path):
    """Adds a texture of 2 x 2 texels of RGBA to the document; returns its number."""
    from PIL import Image

    alpha = np.array([[0, 64], [128, 255]], np.uint8)
    Image.fromarray(np.dstack([np.full((2, 2, 3), 9, np.uint8), alpha])).save(tmp_path / "leaf.png")
    uri = "data:image/png;base64," + base64.b64encode((tmp_path / "leaf.png").read_bytes()).decode()
    gltf.json |= {"images": [{"uri": uri}], "textures": [{"source": 0, "sampler": 0}]}
    gltf.json["samplers"] = [{"wrapS": 33071, "wrapT": 33648}]
    return 0


@pytest.mark.parametrize(
    ("material", "glass", "unlit"),
    [
        ({}, False, False),
        ({"alphaMode": "OPAQUE", "doubleSided": True}, False, False),
        ({"alphaMode": "BLEND"}, True, False),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}}}, True, False),
        ({"extensions": {"KHR_materials_transmission": {}}}, False, False),
        ({"extensions": {"KHR_materials_unlit": {}}}, False, True),
    ],
    ids=str,
)
def test_glass_and_unlit(gltf, material, glass, unlit):
    found = material_of(gltf, material)
    assert (found.transparent, found.unlit, found.foliage, found.alpha_mask) == (glass, unlit, False, None)


@pytest.mark.parametrize(
    ("mode", "double", "foliage"), [("MASK", True, True), ("MASK", False, False), ("OPAQUE", True, False)]
)
def test_double_sided_cut_outs_are_foliage(gltf, mode, double, foliage):
    assert material_of(gltf, {"alphaMode": mode, "doubleSided": double}).foliage == foliage


def test_a_primitive_without_material_is_plain(gltf):
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}}))
    found = gltf.load().parts[0].material
    assert (found.transparent, found.unlit, found.alpha_mask) == (False, False, None)


def test_holes_come_from_picture_factor_and_vertex_colour(gltf, picture):
    uvs = np.array([[0, 0], [1, 0], [0, 2]], dtype="<f4")
    colors = np.array([[255, 255, 255, 255], [0, 0, 0, 51], [1, 2, 3, 0]], dtype="<u1")
    color = {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": picture}}
    material = {"alphaMode": "MASK", "alphaCutoff": 0.25, "pbrMetallicRoughness": color}
    gltf.json["accessors"] = []
    color_index = gltf.accessor(colors, normalized=True)
    built = primitive(gltf, material, TEXCOORD_0=uvs)
    built["attributes"]["COLOR_0"] = color_index
    gltf.node(mesh=gltf.mesh(built))
    alpha_mask = gltf.load().parts[0].material.alpha_mask
    assert alpha_mask.alpha == pytest.approx(np.array([[0, 64], [128, 255]]) / 255)
    assert alpha_mask.uvs[0].tolist() == [[0, 1], [1, 1], [0, -1]]
    assert alpha_mask.factors[0] == pytest.approx([0.5, 0.1, 0])
    assert (alpha_mask.cutoff, alpha_mask.wraps) == (0.25, ("clamp", "mirror"))


def test_a_texture_transform_moves_the_holes(gltf, picture):
    """Scaled by (2, 3), turned by a quarter, moved by (0.5, 0.25), all with v downwards."""
    uvs = np.array([[0, 0], [1, 0], [0, 1]], dtype="<f4")
    transform = {"scale": [2, 3], "rotation": np.pi / 2, "offset": [0.5, 0.25], "texCoord": 1}
    info = {"index": picture, "texCoord": 0, "extensions": {"KHR_texture_transform": transform}}
    found = material_of(
        gltf,
        {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": info}},
        TEXCOORD_0=uvs + 5,
        TEXCOORD_1=uvs,
    )
    assert found.alpha_mask.uvs[0] == pytest.approx(np.array([[0.5, 0.75], [0.5, 2.75], [3.5, 0.75]]))
    assert found.alpha_mask.cutoff == 0.5


def test_a_picture_without_alpha_has_no_holes_and_a_missing_one_is_told(gltf, tmp_path):
    write_colors(tmp_path / "plain.png", np.zeros((2, 2, 3), np.uint8))
    assert read_image(tmp_path / "plain.png").max() == 0
    gltf.json |= {"images": [{"uri": "plain.png"}, {"uri": "none.png"}], "textures": [{"source": 0}, {"source": 1}, {}]}
    for texture in (0, 1, 2):
        color = {"baseColorTexture": {"index": texture}}
        uvs = np.zeros((3, 2), "<f4")
        gltf.node(mesh=gltf.mesh(primitive(gltf, {"alphaMode": "MASK", "pbrMetallicRoughness": color}, TEXCOORD_0=uvs)))
    scene = gltf.load("made.gltf")
    assert [part.material.alpha_mask.alpha.min() for part in scene.parts] == [1, 1, 1]
    assert ["an alpha mask cannot be read" in line for line in scene.warnings] == [True, True]
    assert "none.png" in scene.warnings[0]
    assert "texture 2 has no image" in scene.warnings[1]


def test_a_mirrored_part_has_its_holes_where_its_corners_are(gltf, picture):
    uvs = np.array([[0, 0], [1, 0], [0, 1]], dtype="<f4")
    color = {"baseColorTexture": {"index": picture}}
    built = primitive(gltf, {"alphaMode": "MASK", "pbrMetallicRoughness": color}, TEXCOORD_0=uvs)
    gltf.node(mesh=gltf.mesh(built), scale=[-1, 1, 1])
    scene = gltf.load()
    assert np.array_equal(scene.parts[0].material.alpha_mask.uvs, scene.uvs)
    assert (scene.corners[0] * (-1, 1, 1)).tolist() == TRIANGLE[[0, 2, 1]].tolist()


def test_parts_go_by_all_their_names(gltf):
    built = primitive(gltf, {"name": "chrome"})
    inner = gltf.node(mesh=gltf.mesh(built, built, name="rim"), name="front left")
    gltf.node(name="wheels", children=[inner])
    scene = gltf.load()
    assert [part.name for part in scene.parts] == ["front left.0", "front left.1"]
    assert scene.parts[1].names | {scene.parts[1].name} == {"front left.1", "front left", "wheels", "rim", "chrome"}


def test_morph_targets_stand_as_the_files_weights_say(gltf):
    attributes = {
        "POSITION": gltf.accessor(TRIANGLE),
        "NORMAL": gltf.accessor(np.tile([0, 0, 1], (3, 1)).astype("<f4")),
    }
    lift, tilt = np.tile([0, 0, 1], (3, 1)).astype("<f4"), np.tile([1, 0, 0], (3, 1)).astype("<f4")
    targets = [{"POSITION": gltf.accessor(lift)}, {"POSITION": gltf.accessor(lift), "NORMAL": gltf.accessor(tilt)}]
    mesh = gltf.mesh({"attributes": attributes, "targets": targets}, weights=[0.5, 0])
    gltf.node(mesh=mesh)
    gltf.node(mesh=mesh, weights=[1, 2])
    scene = gltf.load()
    assert scene.corners[:, :, 2].tolist() == [[0.5] * 3, [3] * 3]
    assert scene.normals[:, 0] == pytest.approx(np.array([[0, 0, 1], [2, 0, 1] / np.sqrt(5)]))
    targets[0]["POSITION"] = gltf.accessor(lift[:2])
    with pytest.raises(InputError, match="a morph target has 2 vertices, 3 were expected"):
        gltf.load()


def test_a_node_that_repeats_its_mesh_is_there_as_often(gltf):
    moved = gltf.accessor(np.array([[0, 0, 0], [5, 0, 0], [0, 0, 7]], dtype="<f4"))
    scaled = gltf.accessor(np.array([[1, 1, 1], [2, 2, 2], [-1, 1, 1]], dtype="<f4"))
    repeated = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moved, "SCALE": scaled, "_ID": moved}}}
    mesh = gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}})
    gltf.node(mesh=mesh, translation=[0, 100, 0])
    gltf.node(mesh=mesh, extensions=repeated, translation=[0, 1, 0])
    gltf.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    scene = gltf.load()
    expected = [
        TRIANGLE + (0, 100, 0),
        TRIANGLE + (0, 1, 0),
        TRIANGLE * 2 + (5, 1, 0),
        (TRIANGLE * (-1, 1, 1) + (0, 1, 7))[[0, 2, 1]],
    ]
    assert scene.corners == pytest.approx(np.array(expected))
    assert [part.instance_of for part in scene.parts] == [None, 0, 0, 0]
    assert [part.duplicate_of for part in scene.parts] == [None, None, 1, 1]
    repeated["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = gltf.accessor(np.ones((2, 3), "<f4"))
    with pytest.raises(InputError, match="attributes of different lengths"):
        gltf.load()


def test_every_set_of_uvs_is_read(gltf):
    sets = [np.array([[0, 0], [1, 0], [0, 1]], dtype="<f4") + shift for shift in (0, 2, 4)]
    first = primitive(gltf, {}, TEXCOORD_0=sets[0], TEXCOORD_1=sets[1])
    second = primitive(gltf, {}, TEXCOORD_0=sets[1], TEXCOORD_1=sets[0], TEXCOORD_2=sets[2])
    gltf.node(mesh=gltf.mesh(first, second))
    scene = gltf.load()
    found = [np.stack([uvs[:, :, 0], 1 - uvs[:, :, 1]], axis=2) for uvs in scene.uv_sets]
    assert np.array_equal(found[0], np.stack([sets[0], sets[1]]))
    assert np.array_equal(found[1], np.stack([sets[1], sets[0]]))
    assert np.array_equal(found[2][1], sets[2])
    assert (scene.uv_sets[2][0] == 0).all()
    assert not any("lack usable UVs" in line for line in scene.warnings)
