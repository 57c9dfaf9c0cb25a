"""Avatars: a GLB by another name, whose extensions refer to textures, images, materials, meshes and nodes."""

import json
import struct

import numpy as np
import pytest
from click.testing import CliRunner

import aoprecalc as ao
from aoprecalc.cli import main
from aoprecalc.io import load_scene
from gltf_kit.gltf_maker import GltfMaker


def json_of(path):
    data = path.read_bytes()
    assert data[:4] == b"glTF"
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def image_bytes(document, path, index):
    """The bytes of image `index` of a GLB."""
    data = path.read_bytes()
    view = document["bufferViews"][document["images"][index]["bufferView"]]
    start = 28 + struct.unpack_from("<I", data, 12)[0] + view.get("byteOffset", 0)
    return data[start : start + view["byteLength"]]


@pytest.fixture
def avatar(tmp_path):
    """avatar(extensions) -> the path of a .vrm of two triangles of one material, whose own occlusion texture goes."""
    maker = GltfMaker(tmp_path)
    old, face, _ = (maker.texture(np.full((2, 2, 3), value, np.uint8)) for value in (9, 99, 199))
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    attributes = {"POSITION": maker.vertices(points, bounds=True)}
    toon = {"specVersion": "1.0", "shadeMultiplyTexture": {"index": face}}
    material = {
        "name": "skin",
        "occlusionTexture": {"index": old},
        "pbrMetallicRoughness": {"baseColorTexture": {"index": face}},
        "extensions": {"VRMC_materials_mtoon": toon},
    }
    uvs = {"TEXCOORD_0": maker.vertices(np.array([[0, 0], [1, 0], [0, 1]], "<f4"))}
    skin = maker.add("materials", material)
    for name, moved in (("body", 0), ("hat", 3)):
        primitive = {"attributes": attributes | uvs, "material": skin}
        maker.node(mesh=maker.mesh(primitive), name=name, translation=[moved, 0, 0])

    def save(extensions):
        maker.json["extensions"] = extensions
        maker.json["extensionsUsed"] = [*extensions, "VRMC_materials_mtoon"]
        path = maker.save("me.glb")
        return path.rename(path.with_suffix(".vrm"))

    return save


def vrm_0(face, thumbnail):
    properties = {"name": "skin", "shader": "VRM/MToon", "textureProperties": {"_MainTex": face}}
    bones = [{"bone": "hips", "node": 0}]
    groups = [{"name": "a", "binds": [{"mesh": 0, "index": 0, "weight": 100}]}]
    return {
        "VRM": {
            "specVersion": "0.0",
            "meta": {"title": "me", "texture": thumbnail},
            "humanoid": {"humanBones": bones},
            "blendShapeMaster": {"blendShapeGroups": groups},
            "materialProperties": [properties],
        }
    }


def vrm_1(face, thumbnail):
    return {
        "VRMC_vrm": {
            "specVersion": "1.0",
            "meta": {"thumbnailImage": thumbnail},
            "humanoid": {"humanBones": {"hips": {"node": 0}}},
        },
        "VRMC_springBone": {"specVersion": "1.0", "springs": [{"joints": [{"node": 0}]}]},
    }


@pytest.mark.parametrize("version", [vrm_0, vrm_1])
@pytest.mark.parametrize("only", [(), ("body",)])
def test_the_copy_is_an_avatar_whose_references_hold(avatar, tmp_path, version, only):
    path = avatar(version(1, 2))
    before = json_of(path)
    (tmp_path / "out").mkdir()
    options = ao.BakeOptions(size=32, directions=16, unwrap="uvunwrap", only=only)
    ao.bake(path, options).save(tmp_path / "out" / "me_ao.png")
    baked = tmp_path / "out" / "me_ao.vrm"
    after = json_of(baked)
    assert len(load_scene(baked).faces) == 2
    occlusion = [material.get("occlusionTexture") for material in after["materials"]]
    assert any(occlusion)
    pictures = [image_bytes(before, path, image) for image in range(3)]

    def shown(texture):
        return image_bytes(after, baked, after["textures"][texture]["source"])

    toon = after["materials"][0]["extensions"]["VRMC_materials_mtoon"]
    assert shown(toon["shadeMultiplyTexture"]["index"]) == pictures[1]
    if version is vrm_0:
        avatar_0 = after["extensions"]["VRM"]
        assert [shown(entry["textureProperties"]["_MainTex"]) for entry in avatar_0["materialProperties"]] == [
            pictures[1]
        ] * len(after["materials"])
        assert shown(avatar_0["meta"]["texture"]) == pictures[2]
        kept = {key: value for key, value in avatar_0.items() if key not in ("meta", "materialProperties")}
        original = before["extensions"]["VRM"]
        assert kept == {key: original[key] for key in kept}
    else:
        avatar_1 = after["extensions"]["VRMC_vrm"]
        assert image_bytes(after, baked, avatar_1["meta"]["thumbnailImage"]) == pictures[2]
        assert avatar_1["humanoid"] == before["extensions"]["VRMC_vrm"]["humanoid"]
        assert after["extensions"]["VRMC_springBone"] == before["extensions"]["VRMC_springBone"]
    assert set(before["extensionsUsed"]) <= set(after["extensionsUsed"])


def test_what_is_no_avatar_gets_a_warning_under_that_name(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    done = CliRunner().invoke(main, ["bake", str(path), "--size", "16", "-n", "8", "-o", str(tmp_path / "a_ao.vrm")])
    assert done.exit_code == 0
    assert "lacks what makes an avatar of a GLB, as a.obj has none; write a .glb" in done.stderr
    assert json_of(tmp_path / "a_ao.vrm")["asset"]["version"] == "2.0"
