"""New UVs became TEXCOORD_2, which many viewers ignore, where TEXCOORD_0 or TEXCOORD_1 was there for nothing."""

import numpy as np
import pytest

from aoprecalc.io import load_scene
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_documents import BLUES, STACKED, corner, extend, pictured, transformed
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_values import GltfValues

OVERRIDE = {"extensions": {"KHR_texture_transform": {"texCoord": 1}}}
COAT = {"extensions": {"KHR_materials_clearcoat": {"clearcoatTexture": {"index": 0, "texCoord": 1}}}}
VARIANT = {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0]}]}}
FEATURES = {"EXT_mesh_features": {"featureIds": [{"featureCount": 9, "texture": {"index": 0, "texCoord": 1}}]}}
METADATA = {"EXT_structural_metadata": {"propertyTextures": [0]}}
BOTH = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}, "emissiveTexture": {"index": 0}}
TOLD = "TEXCOORD_{} of 1 primitive, to which nothing referred, was replaced"
BEYOND = "1 primitive uses TEXCOORD_2 or beyond, which not every viewer supports"
OCCLUDED = "the occlusion textures of 1 material were replaced"

# materials, members of the primitive -> the n of the set, what is told
CASES = {
    "nothing needs the second": ([{}], {}, 1, [TOLD.format(1)]),
    "nor the first, as the second is needed": ([COAT], {}, 0, [TOLD.format(0)]),
    "the old occlusion needed it": ([{"occlusionTexture": {"index": 0, "texCoord": 1}}], {}, 1, [OCCLUDED]),
    "by its transform": ([{"occlusionTexture": {"index": 0} | OVERRIDE}], {}, 1, [OCCLUDED]),
    "both are needed": ([BOTH], {}, 2, [BEYOND]),
    "a transform overrides": ([{"emissiveTexture": {"index": 0} | OVERRIDE}], {}, 2, [BEYOND]),
    "a variant needs it": ([{"normalTexture": {"index": 0}}, COAT], {"extensions": VARIANT}, 2, [BEYOND]),
    "feature ids need it": ([{"normalTexture": {"index": 0}}], {"extensions": FEATURES}, 2, [BEYOND]),
    "metadata need it": ([{"normalTexture": {"index": 0}}], {"extensions": METADATA}, 2, [BEYOND]),
}


def save(folder, materials, **members):
    maker = GltfMaker(folder)
    maker.texture(BLUES)
    maker.json["materials"] = materials
    names = ["variants", "clearcoat"]
    extend(maker, "KHR_texture_transform", "EXT_mesh_features", *(f"KHR_materials_{name}" for name in names))
    tables = {"propertyTextures": [{"class": "a", "properties": {"b": {"index": 0, "texCoord": 1, "channels": [0]}}}]}
    maker.json["extensions"] = {"EXT_structural_metadata": tables}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, STACKED[::-1].copy(), material=0, **members)))
    return maker.save()


@pytest.mark.parametrize(("materials", "members", "expected", "told"), CASES.values(), ids=CASES)
def test_a_set_that_nothing_needs_makes_room(materials, members, expected, told, tmp_path):
    source = save(tmp_path, materials, **members)
    path, atlas, _, messages = write_with_texture(load_scene(source), tmp_path / "out" / "a.glb")
    assert list(messages) == told
    before, after = GltfValues(source), GltfValues(path)
    old, new = (document.json["meshes"][0]["primitives"][0] for document in (before, after))
    assert after.material(new)["occlusionTexture"]["texCoord"] == expected
    at, was = after.corners(new), before.corners(old)
    for name in {"TEXCOORD_0", "TEXCOORD_1"} - {f"TEXCOORD_{expected}"}:
        assert np.array_equal(after.array(new["attributes"][name])[at], before.array(old["attributes"][name])[was])
    uvs = after.array(new["attributes"][f"TEXCOORD_{expected}"])[at]
    assert uvs * (1, -1) + (0, 1) == pytest.approx(atlas.uvs.reshape(-1, 2), abs=1e-6)


def test_an_unlit_material_keeps_its_occlusion(tmp_path):
    """It is not replaced, so its UVs are needed; here beside a variant that is lit."""
    unlit = {"occlusionTexture": {"index": 0, "texCoord": 1}, "extensions": {"KHR_materials_unlit": {}}}
    source = save(tmp_path, [{"normalTexture": {"index": 0}}, unlit], extensions=VARIANT)
    *_, messages = write_with_texture(load_scene(source), tmp_path / "out" / "a.glb")
    assert list(messages) == [BEYOND]


@pytest.mark.parametrize("kind", ["scenes", "nodes", "meshes", None])
def test_an_extension_of_something_else_needs_its_set(kind, tmp_path):
    lights = {"EXT_of_lightmaps": {"maps": [{"texture": {"index": 0, "texCoord": 1}}]}}
    maker = GltfMaker(tmp_path)
    maker.node(mesh=maker.mesh(corner(maker, STACKED, STACKED, material=pictured(maker))))
    maker.json |= {"scene": 0, "scenes": [{"nodes": [0]}]}
    (maker.json if kind is None else maker.json[kind][0])["extensions"] = lights
    *_, messages = write_with_texture(maker.load(), tmp_path / "out" / "a.glb")
    assert BEYOND in messages


def test_morph_targets_need_their_set(tmp_path):
    maker = GltfMaker(tmp_path)
    primitive = corner(maker, STACKED, STACKED, material=pictured(maker))
    primitive["targets"] = [{"TEXCOORD_1": maker.vertices(STACKED)}]
    maker.node(mesh=maker.mesh(primitive))
    *_, messages = write_with_texture(maker.load(), tmp_path / "out" / "a.glb")
    assert list(messages) == [BEYOND]


def test_repeated_bakes_do_not_pile_up_sets(tmp_path):
    source = save(tmp_path, [{"normalTexture": transformed(0)}])
    path = write_with_texture(load_scene(source), tmp_path / "one" / "a.glb")[0]
    again = write_with_texture(load_scene(path), tmp_path / "two" / "a.glb")[0]
    sets = [set(GltfValues(each).json["meshes"][0]["primitives"][0]["attributes"]) for each in (path, again)]
    assert sets[0] == sets[1] == {"POSITION", "NORMAL", "TEXCOORD_0", "TEXCOORD_1"}
