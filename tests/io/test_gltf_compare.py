"""The comparison of glTF documents sees each thing that could be lost, and nothing in what a bake may do."""

import json
from copy import deepcopy

import numpy as np
import pytest

from gltf_kit.gltf_compare import differences
from gltf_kit.gltf_documents import DOCUMENTS
from gltf_kit.gltf_maker import GltfMaker, data_uri, png
from gltf_kit.gltf_occlusion import occlusion_faults
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues

# Documents of which a bake may take something away.
REPLACED = {
    "transformed_textures",
    "a_transform_that_only_occlusion_requires",
    "occlusion_packed_with_roughness",
    "a_second_set_that_nothing_needs",
}
KEPT = sorted(DOCUMENTS.keys() - REPLACED - {"things_that_nothing_uses"})

# Where values lie, which may change.
LAYOUT = {
    "accessors": {"bufferView", "byteOffset", "count", "min", "max", "sparse"},
    "images": {"uri", "bufferView", "mimeType"},
}


def made(name, folder):
    maker = GltfMaker(folder)
    DOCUMENTS[name](maker)
    return maker.save("made.gltf")


def with_json(path, change):
    """The document after change(json)."""
    document = GltfValues(path)
    document.json = deepcopy(document.json)
    change(document.json)
    return document


def places(value, at=()):
    """The way to each member of each object within a JSON value."""
    for key, member in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(value, dict):
            yield (*at, key)
        if isinstance(member, dict | list):
            yield from places(member, (*at, key))


def remove(json, place):
    for key in place[:-1]:
        json = json[key]
    del json[place[-1]]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_document_is_like_itself(name, tmp_path):
    path = made(name, tmp_path)
    assert differences(GltfValues(path), GltfValues(path)) == []


@pytest.mark.parametrize("name", KEPT)
def test_each_member_that_is_removed_is_missed(name, tmp_path):
    path = made(name, tmp_path)
    before = GltfValues(path)
    members = [
        place
        for place in places(before.json)
        if place[0] not in ("bufferViews", "buffers") and place[-1] not in LAYOUT.get(place[0], ())
    ]
    assert [place for place in members if not is_missed(before, path, place)] == []


def is_missed(before, path, place):
    try:
        return differences(before, with_json(path, lambda json: remove(json, place)))
    except KeyError:  # what glTF requires, without which nothing can be compared
        return True


@pytest.mark.parametrize("name", KEPT)
def test_each_number_that_is_changed_is_found(name, tmp_path):
    path = made(name, tmp_path)
    before = GltfValues(path)
    for index in range(len(before.json["accessors"])):
        after = GltfValues(path)
        values = after.array(index)  # of this document alone
        values[-1] = values[-1] + 1 if values.dtype.kind == "f" else values[-1] ^ 1
        assert differences(before, after) != [], index


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda json: json["nodes"].append({}), "/nodes: has 5 entries, had 4"),
        (lambda json: json["nodes"][2].update(skin=0), "/nodes/2/skin: is new"),
        (lambda json: json["nodes"][0].update(name="I"), "/nodes/0/name: is I, was eye"),
        (lambda json: json["asset"].update(generator="ours"), "/asset/generator: is ours, was someone"),
        (lambda json: json["extensionsUsed"].append("EXT_x"), "/extensionsUsed: EXT_x is new"),
        (lambda json: json["extensionsUsed"].remove("EXT_of_ours"), "/extensionsUsed: EXT_of_ours is gone"),
        (lambda json: json["materials"][0].update(doubleSided=True), "/materials/0/doubleSided: is new"),
        (lambda json: json["meshes"].append({"primitives": []}), "/meshes of no node/1: is new"),
        (
            lambda json: json["accessors"][-1].update(normalized=1),
            "/animations/1/samplers/0/output/normalized: is 1, was True",
        ),
    ],
)
def test_differences_are_told_with_their_place(change, found, tmp_path):
    path = made("much_beside_the_mesh", tmp_path)
    told = differences(GltfValues(path), with_json(path, change))
    assert [line for line in told if not line.startswith(("/nodes/2/mesh", "/nodes/3/mesh"))] == [found]


def test_another_picture_is_found(tmp_path):
    path = made("data_uris", tmp_path)
    other = data_uri(png(np.zeros((8, 8))), "image/png")
    told = differences(GltfValues(path), with_json(path, lambda json: json["images"][0].update(uri=other)))
    assert [line.partition(":")[0] for line in told if line.startswith("/images")] == ["/images/0"]
    assert any(line.startswith("/materials/0/pbrMetallicRoughness/baseColorTexture") for line in told)


def test_what_only_the_replaced_occlusion_texture_used_may_go(tmp_path):
    path = made("transformed_textures", tmp_path)

    def replace(json):
        json["materials"][0]["occlusionTexture"] = {"index": 0}
        del json["textures"][1:], json["images"][1:]

    assert differences(GltfValues(path), with_json(path, replace)) == []
    unused = made("things_that_nothing_uses", tmp_path)
    without = with_json(unused, lambda json: json["textures"].pop(2))
    assert differences(GltfValues(unused), without) == ["/textures/2: is gone"]


def test_an_extension_may_leave_the_lists_with_its_last_use(tmp_path):
    path = made("a_transform_that_only_occlusion_requires", tmp_path)

    def unlist(json):
        del json["extensionsUsed"], json["extensionsRequired"]

    def unlist_unused(json):
        unlist(json)
        del json["materials"][0]["occlusionTexture"]

    lists = ["/extensionsUsed: KHR_texture_transform is gone", "/extensionsRequired: KHR_texture_transform is gone"]
    assert differences(GltfValues(path), with_json(path, unlist)) == lists
    assert differences(GltfValues(path), with_json(path, unlist_unused)) == []


def test_vertices_may_be_reordered(tmp_path):
    path = made("colors_tangents_and_own_attributes", tmp_path)
    after = GltfValues(path)
    primitive = after.json["meshes"][0]["primitives"][0]
    for index in primitive["attributes"].values():
        after.array(index)[:] = after.array(index)[::-1].copy()
    assert differences(GltfValues(path), after) != []
    after.array(primitive["indices"])[:] = 7 - after.array(primitive["indices"])
    assert differences(GltfValues(path), after) == []


def test_meshes_and_materials_may_be_doubled_for_a_texture(tmp_path):
    path = made("instances_under_different_nodes", tmp_path)

    def double(json):
        json["meshes"].append(deepcopy(json["meshes"][0]))
        json["materials"].append(json["materials"][0] | {"occlusionTexture": {"index": 0, "texCoord": 1}})
        json["nodes"][2]["mesh"] = 1
        primitive = json["meshes"][1]["primitives"][0]
        primitive["attributes"]["TEXCOORD_1"] = primitive["attributes"]["TEXCOORD_0"]
        primitive["material"] = 1

    assert differences(GltfValues(path), with_json(path, double)) == []


def test_normals_may_be_others_only_where_they_were_asked_for(tmp_path):
    path = made("skin", tmp_path)
    after = GltfValues(path)
    after.array(after.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"])[:] = 0
    assert differences(GltfValues(path), after) == [
        "/nodes/2/mesh/primitives/0/attributes/NORMAL/values: has other values"
    ]
    assert differences(GltfValues(path), after, new_normals=True) == []


BAKED = {"index": 1, "texCoord": 1}


@pytest.mark.parametrize(
    ("occlusion", "attributes", "fault"),
    [
        (BAKED, {"TEXCOORD_1": 2}, None),
        (None, {}, "its occlusionTexture is missing"),
        (BAKED | {"index": 0}, {"TEXCOORD_1": 2}, "its occlusionTexture shows another picture"),
        (BAKED, {}, "its occlusionTexture names a set that is not there"),
        (
            BAKED | {"extensions": {"KHR_texture_transform": {}}},
            {"TEXCOORD_1": 2},
            "its occlusionTexture is transformed",
        ),
        (BAKED, {"TEXCOORD_1": 2, "TEXCOORD_3": 2}, "has ['TEXCOORD_0', 'TEXCOORD_1', 'TEXCOORD_3']"),
    ],
)
def test_faults_of_occlusion_textures_are_found(occlusion, attributes, fault, tmp_path):
    path = made("uvs_that_hold_a_bake", tmp_path)
    picture = png(np.ones((4, 4)))

    def occlude(json):
        json["meshes"][0]["primitives"][0]["attributes"].update(attributes)
        json["materials"][0] |= {} if occlusion is None else {"occlusionTexture": occlusion}
        json["images"].append({"uri": data_uri(picture, "image/png")})
        json["textures"].append({"source": 1})

    after = with_json(path, occlude)
    told = [] if fault is None else [f"/nodes/0/mesh/primitives/0: {fault}"]
    assert occlusion_faults(GltfValues(path), after, picture, {(0, 0)}) == told
    unasked = occlusion_faults(GltfValues(path), after, picture, set())
    assert ("is not baked, but has another occlusionTexture" in str(unasked)) == (occlusion is not None)


def test_unlit_variants_are_to_have_no_occlusion_texture(tmp_path):
    path = made("variants", tmp_path)
    picture = GltfValues(path).image(0)[0]

    def occlude(json):
        for material in json["materials"]:
            material["occlusionTexture"] = {"index": 0}

    told = occlusion_faults(GltfValues(path), with_json(path, occlude), picture, {(0, 0)})
    assert [line.partition(":")[0] for line in told] == ["/nodes/0/mesh/primitives/0", "/nodes/1/mesh/primitives/0"]
    assert all("is not baked" in line for line in told)


@needs_validator
def test_the_validator_is_heard(tmp_path):
    path = made("much_beside_the_mesh", tmp_path)
    assert new_issues(path, path) == []
    worse = with_json(path, lambda json: json["accessors"][0].pop("max"))
    (tmp_path / "worse.gltf").write_text(json.dumps(worse.json))
    assert [issue["code"] for issue in new_issues(path, tmp_path / "worse.gltf")] == [
        "MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS"
    ]
