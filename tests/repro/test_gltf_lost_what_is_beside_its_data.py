"""Of a glTF document were lost: animations of materials and meshes that were copied, names and extras of buffers, and
the places at multiples of 8 bytes that 64-bit numbers of metadata need. Animations of a replaced texture stayed.
"""

import struct

import numpy as np
import pytest

from aoprecalc.io import load_scene
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_documents import BLUES, STACKED, animate, colored, corner, data_uri, extend, pictured, transformed
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues


@pytest.fixture
def maker(tmp_path):
    return GltfMaker(tmp_path)


def write(source, name="a.glb"):
    scene = load_scene(source)
    path, *_, messages = write_with_texture(scene, source.parent / "out" / name, normals=scene.normals.astype("<f4"))
    return GltfValues(path), messages


def point(maker, *pointers):
    """Animate what each JSON pointer leads to."""
    extend(maker, "KHR_animation_pointer")
    for pointer in pointers:
        animate(maker, 0, "pointer", np.zeros((2, 4), "<f4"))
        target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
        maker.json["animations"][-1]["channels"][0]["target"] = target


def pointers(document):
    return [
        [channel["target"]["extensions"]["KHR_animation_pointer"]["pointer"] for channel in animation["channels"]]
        for animation in document.json.get("animations", [])
    ]


def test_copies_of_materials_and_meshes_are_animated_as_well(maker):
    paint = colored(maker)
    unbaked = {"attributes": {"POSITION": maker.vertices(np.zeros((1, 3), "<f4"), bounds=True)}, "mode": 0}
    mesh = maker.mesh(corner(maker, STACKED, material=paint), unbaked | {"material": paint}, weights=[])
    maker.json["meshes"][0].pop("weights")
    for x in (0, 3, 6):
        maker.node(mesh=mesh, translation=[x, 0, 0])
    color = "pbrMetallicRoughness/baseColorFactor"
    point(maker, f"/materials/0/{color}", "/meshes/0/weights", "/nodes/1/scale", f"/materials/10/{color}")
    document, _ = write(maker.save())
    assert (len(document.json["materials"]), len(document.json["meshes"])) == (2, 3)
    assert pointers(document) == [
        [f"/materials/0/{color}", f"/materials/1/{color}"],
        ["/meshes/0/weights", "/meshes/1/weights", "/meshes/2/weights"],
        ["/nodes/1/scale"],
        [f"/materials/10/{color}"],
    ]


def test_animations_of_a_replaced_texture_are_told_to_be_gone(maker):
    extend(maker, "KHR_texture_transform")
    info = transformed(maker.texture(BLUES))
    both = {"occlusionTexture": info, "pbrMetallicRoughness": {"baseColorTexture": info}}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=maker.add("materials", both))))
    moved = "extensions/KHR_texture_transform/offset"
    color = f"/materials/0/pbrMetallicRoughness/baseColorTexture/{moved}"
    point(maker, f"/materials/0/occlusionTexture/{moved}", color)
    maker.json["animations"][1]["channels"] += maker.json["animations"][0]["channels"]
    document, messages = write(maker.save())
    assert pointers(document) == [[color]]
    assert "2 animation channels are gone: the transforms of occlusion textures that were replaced" in messages


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_what_buffers_say_of_themselves_stays(name, maker):
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker))))
    path = maker.save("made.gltf", "made.bin")
    said = {"name": "all", "extras": {"of": "ours"}}
    text = path.read_text()
    assert text.count('"uri": "made.bin"') == 1
    path.write_text(text.replace('"uri": "made.bin"', '"uri": "made.bin", "name": "all", "extras": {"of": "ours"}'))
    document, messages = write(path, name)
    (buffer,) = document.json["buffers"]
    assert {key: buffer[key] for key in said} == said
    assert messages == ()


def test_what_several_buffers_say_is_told_to_be_lost(maker):
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker))))
    more = {"byteLength": 4, "uri": data_uri(b"abcd", "application/octet-stream")}
    maker.further_buffers = [more | {"name": "first"}, more | {"name": "second"}]
    document, messages = write(maker.save())
    assert [buffer["name"] for buffer in document.json["buffers"]] == ["first"]
    assert [line for line in messages if "keeps the name and extras of the first" in line]


@needs_validator
def test_tables_of_metadata_lie_at_multiples_of_8(maker):
    extend(maker, "EXT_structural_metadata")
    properties = {}
    for number in range(3):
        maker.view(bytes(4 + number))  # what lies between
        maker.data += bytes(-len(maker.data) % 8)
        properties[f"p{number}"] = {"values": maker.view(np.arange(3, dtype="<u8").tobytes())}
    table = {"class": "a", "count": 3, "properties": properties}
    maker.json["extensions"] = {"EXT_structural_metadata": {"schema": {"id": "s"}, "propertyTables": [table]}}
    info = {"index": maker.texture(BLUES)}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=maker.add("materials", {"occlusionTexture": info}))))
    source = maker.save()
    document, _ = write(source)
    for entry in document.json["extensions"]["EXT_structural_metadata"]["propertyTables"][0]["properties"].values():
        view = document.json["bufferViews"][entry["values"]]
        assert view["byteOffset"] % 8 == 0
        start = view["byteOffset"]
        assert document.bytes_at(None)[start : start + 24] == np.arange(3, dtype="<u8").tobytes()
    assert new_issues(source, document.path) == []


def test_chunks_of_other_kinds_are_told_to_be_lost(maker):
    maker.node(mesh=maker.mesh(corner(maker, STACKED)))
    source = maker.save()
    data = source.read_bytes()
    chunk = struct.pack("<II", 4, 0x584D5000) + b"data"
    source.write_bytes(data[:8] + struct.pack("<I", len(data) + len(chunk)) + data[12:] + chunk)
    (warning,) = load_scene(source).warnings
    assert warning == f"{source} has 1 chunk beside JSON and BIN, which a baked copy lacks"


@pytest.mark.parametrize("with_normals", [False, True])
def test_accessors_and_views_keep_names_and_extras(with_normals, maker):
    primitive = corner(maker, STACKED, material=pictured(maker))
    for number, entry in enumerate(maker.json["accessors"]):
        entry |= {"name": f"accessor {number}", "extras": {"of": number}}
        maker.json["bufferViews"][entry["bufferView"]] |= {"name": f"view {number}", "extras": {"of": number}}
    maker.node(mesh=maker.mesh(primitive))
    scene = load_scene(maker.save())
    normals = None if with_normals else scene.normals.astype("<f4")
    document = GltfValues(write_with_texture(scene, scene.path.parent / "out" / "a.glb", normals=normals)[0])
    written = document.json["meshes"][0]["primitives"][0]
    places = {**written["attributes"], "indices": written["indices"]}
    before = {**primitive["attributes"], "indices": primitive["indices"]}
    for name, old in before.items():
        accessor = document.json["accessors"][places[name]]
        view = document.json["bufferViews"][accessor["bufferView"]]
        assert (accessor["name"], view["name"]) == (f"accessor {old}", f"view {old}")
        assert accessor["extras"] == view["extras"] == {"of": old}
    assert "name" not in document.json["accessors"][written["attributes"]["TEXCOORD_1"]]


@pytest.mark.parametrize("extension", ["EXT_of_ours", "KHR_lights_punctual"])
def test_extensions_that_count_materials_and_meshes_are_told_of_new_ones(extension, maker):
    extend(maker, extension)
    maker.json["extensions"] = {extension: {"lights": [{"type": "point"}]}}
    mesh = maker.mesh(corner(maker, STACKED))
    for x in (0, 3):
        maker.node(mesh=mesh, translation=[x, 0, 0])
    _, messages = write(maker.save())
    told = "EXT_of_ours may refer to materials and meshes by number; 1 material and 1 mesh of the result are new to it"
    assert (told in messages) == (extension == "EXT_of_ours")
