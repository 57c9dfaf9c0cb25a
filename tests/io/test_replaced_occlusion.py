"""What a replaced occlusion texture leaves behind: nothing, while all else keeps what it refers to."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import Outputs, write_image
from aoprecalc.io.formats.gltf.references import GltfBuffer, add_entry, compact, release_references
from gltf_kit.gltf_maker import png
from gltf_kit.gltf_values import GltfValues
from written_meshes import write_with_one_texture

PICTURES = np.random.default_rng(3).integers(0, 256, (9, 4, 4, 3), np.uint8)


@pytest.fixture
def cube(gltf_cube):
    """cube(material, ...) adds a cube of each to the maker that it returns."""

    def make(*materials):
        maker, primitive = gltf_cube
        for material in materials:
            maker.node(mesh=maker.mesh(primitive | {"material": maker.add("materials", material)}))
        return maker

    return make


def occluded(texture, base=None, **members):
    color = {} if base is None else {"pbrMetallicRoughness": {"baseColorTexture": {"index": base}}}
    return color | {"occlusionTexture": {"index": texture}} | members


def unused(path):
    """(kind, number) of each entry that nothing refers to, and words for what is out of order."""
    document = GltfValues(path)
    text = json.dumps(document.json)
    sources = [json.dumps(texture) for texture in document.json.get("textures", [])]
    used = {
        "textures": re.findall(r'[tT]exture": \{"index": (\d+)', text),
        "images": re.findall(r'"source": (\d+)', " ".join(sources)),
        "samplers": re.findall(r'"sampler": (\d+)', " ".join(sources)),
        "bufferViews": re.findall(r'"bufferView": (\d+)', text),
    }
    found = []
    for kind, numbers in used.items():
        entries = document.json.get(kind, [])
        found += [(kind, number) for number in range(len(entries)) if str(number) not in numbers]
        found += [f"{kind} has no {number}" for number in numbers if int(number) >= len(entries)]
        if None in entries or document.json.get(kind) == []:
            found.append(f"{kind} has gaps or is empty")
    views = document.json["bufferViews"]
    runs = sorted((view["byteOffset"], view["byteOffset"] + view["byteLength"]) for view in views)
    between = [after[0] - before[1] for before, after in pairwise([(0, 0), *runs])]
    if not all(0 <= gap < 4 for gap in between) or document.json["buffers"][0]["byteLength"] != runs[-1][1]:
        found.append("the buffer holds bytes of no view")
    return found


def followed(path, at):
    """A material but for its occlusion, with what its textures are."""
    document = GltfValues(path)
    material = {key: value for key, value in document.json["materials"][at].items() if key != "occlusionTexture"}
    return document.followed(material)


@pytest.mark.parametrize("where", ["view", "data", "the.png"])
@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_the_new_one_takes_the_places_of_the_old_one(cube, gltf, bake, name, where):
    wraps = [{"wrapS": 33071}, {"wrapT": 33071}, {"wrapS": 33648}]
    places = ["base.png", where, "normal.png"] if where == "the.png" else [where] * 3
    textures = [gltf.texture(*each) for each in zip(PICTURES[:3], places, wraps, strict=True)]
    source = cube(occluded(1, 0, normalTexture={"index": 2})).load("made.gltf")
    path, *_, warnings = bake(source, name)
    assert warnings == ("the occlusion textures of 1 material were replaced",)
    document = GltfValues(path)
    assert followed(path, 0) == followed(source.path, 0)
    material = document.json["materials"][0]
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["index"] == 0
    assert material["normalTexture"]["index"] == 2
    assert material["occlusionTexture"] == {"index": 1, "texCoord": 1, "strength": 1}
    assert [texture["source"] for texture in document.json["textures"]] == textures
    assert [texture["sampler"] for texture in document.json["textures"]] == textures
    assert [document.image(number)[0] for number in (0, 2)] == [png(PICTURES[0]), png(PICTURES[2])]
    assert document.image(1)[0] == (path.parent / "x_ao.png").read_bytes()
    assert unused(path) == []
    assert png(PICTURES[1]) not in b"".join(file.read_bytes() for file in path.parent.iterdir())


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_one_takes_the_places_of_many(cube, gltf, bake, name):
    wraps = [None, {"wrapS": 33071}, None, {"wrapT": 33071}, None, {"wrapS": 33648}, {"wrapT": 33648}]
    for pixels, sampler in zip(PICTURES, wraps, strict=False):
        gltf.texture(pixels, sampler=sampler)
    coat = {"KHR_materials_clearcoat": {"clearcoatTexture": {"index": 6}}}
    materials = [occluded(0, 2), occluded(1, 2), occluded(3, 4), occluded(5, extensions=coat)]
    source = cube(*materials).load()
    path, *_ = bake(source, name)
    assert unused(path) == []
    for at in range(4):
        assert followed(path, at) == followed(source.path, at)
    document = GltfValues(path)
    assert {material["occlusionTexture"]["index"] for material in document.json["materials"]} == {0}
    assert len(document.json["textures"]) == len(document.json["images"]) == 4
    assert len(document.json["samplers"]) == 2  # that of the clear coat, and the new one's


def test_files_of_what_was_replaced_stay_behind(cube, gltf, bake, tmp_path):
    textures = [gltf.texture(pixels, f"{name}.png") for pixels, name in zip(PICTURES, ("old", "base"), strict=False)]
    gltf.add("textures", {"source": gltf.add("images", {"uri": "missing.png"})})
    source = cube(occluded(textures[0], textures[1]), occluded(2)).load("made.gltf")
    path, *_, warnings = bake(source, "a.gltf")
    assert warnings == ("the occlusion textures of 2 materials were replaced",)
    assert {file.name for file in path.parent.iterdir()} == {"a.gltf", "a.bin", "base.png", "x_ao.png"}
    assert unused(path) == []
    assert (tmp_path / "old.png").exists()


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_what_others_need_as_well_stays(cube, gltf, bake, name):
    sampler = {"wrapS": 33071}
    same = gltf.texture(PICTURES[0], sampler=sampler)
    image = gltf.texture(PICTURES[1]), gltf.add("textures", {"source": 1})
    gltf.texture(PICTURES[2])
    gltf.json["textures"][3]["sampler"] = 0
    one = occluded(same, emissiveTexture={"index": same})  # the texture
    two = occluded(image[0], emissiveTexture={"index": image[1]})  # the image
    three = occluded(3)  # the sampler
    source = cube(one, two, three).load()
    path, *_ = bake(source, name)
    assert unused(path) == []
    assert [followed(path, at) for at in (0, 1)] == [followed(source.path, at) for at in (0, 1)]
    document = GltfValues(path)
    assert document.json["textures"][0] == {"source": 0, "sampler": 0}
    assert document.json["samplers"][0] == sampler
    assert document.json["images"][0]["name"] == "inside"
    assert len(document.json["textures"]) == 3


def test_what_only_materials_without_a_texture_of_the_bake_need_stays(gltf_cube, bake):
    maker, primitive = gltf_cube
    texture = maker.texture(PICTURES[0])
    dots = {"attributes": {"POSITION": primitive["attributes"]["POSITION"]}, "mode": 0}
    both = maker.add("materials", occluded(texture))
    maker.add("materials", occluded(maker.texture(PICTURES[1]), name="of nothing"))
    maker.node(mesh=maker.mesh(primitive | {"material": both}, dots | {"material": both}))
    path, *_ = bake(maker.load(), "a.glb")
    document = GltfValues(path)
    assert [material["occlusionTexture"]["index"] for material in document.json["materials"]] == [0, 1, 2]
    assert [document.image(number)[0] for number in (0, 1)] == [png(PICTURES[0]), png(PICTURES[1])]
    assert unused(path) == []


def test_what_nothing_used_before_stays(cube, gltf, bake):
    """A texture, an image, a sampler and a buffer view."""
    old, lone = gltf.texture(PICTURES[0]), gltf.texture(PICTURES[1], sampler={"wrapS": 33071})
    gltf.add("images", {"uri": "data:image/png;base64,AAAA"})
    gltf.add("samplers", {"name": "of nothing"})
    view = gltf.view(b"bytes that only an application knows")
    path, *_ = bake(cube(occluded(old)).load(), "a.gltf")
    document = GltfValues(path)
    assert document.json["textures"][lone] == {"source": 1, "sampler": 0}
    assert document.json["images"][2] == {"uri": "data:image/png;base64,AAAA"}
    assert document.json["samplers"][1] == {"name": "of nothing"}
    view -= 1  # that of the old picture is gone
    assert sorted(unused(path)) == [("bufferViews", view), ("images", 2), ("samplers", 1), ("textures", lone)]
    start = document.json["bufferViews"][view]["byteOffset"]
    data = (path.parent / "a.bin").read_bytes()[start:]
    assert data.startswith(b"bytes that only an application knows")


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_packing_leaves_nothing_either(cube, gltf, atlas_of, tmp_path, name):
    textures = [gltf.texture(pixels, sampler={"wrapS": 33071, "n": at}) for at, pixels in enumerate(PICTURES[:4])]
    rough = [{"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": index}}} for index in textures]
    materials = [occluded(3) | rough[1], occluded(0) | rough[1], rough[2]]
    scene = cube(*materials).load()
    path = tmp_path / "out" / name
    with Outputs() as outputs:
        outputs.folder(path.parent)
        write_image(outputs.path(path.parent / "x_ao.png"), np.ones((4, 4), np.float32))
        atlas, texture = atlas_of(scene, "keep"), path.parent / "x_ao.png"
        write_with_one_texture(outputs, path, scene, atlas, scene.normals, texture, pack="orm")
    assert unused(path) == []
    document = GltfValues(path)
    assert [len(document.json[kind]) for kind in ("textures", "images", "samplers")] == [2, 2, 2]
    infos = [material["pbrMetallicRoughness"]["metallicRoughnessTexture"] for material in document.json["materials"]]
    assert [document.texture(info["index"])["sampler"]["n"] for info in infos] == [1, 1, 2]
    occlusion = [material["occlusionTexture"] for material in document.json["materials"]]
    assert [info["index"] for info in infos] == [info["index"] for info in occlusion]


def test_a_reference_into_nothing_is_refused_before_something_new_takes_its_place(cube, gltf):
    gltf.texture(PICTURES[0])
    with pytest.raises(InputError, match="entry 99 of textures, but there are 1"):
        cube(occluded(0) | {"normalTexture": {"index": 99}}).load()


def everything():
    """Textures, images, samplers and views 0 to 3, each referred to in its own way; 1 is what goes."""
    textures = [
        {"extensions": {"KHR_texture_basisu": {"source": 3}}, "source": 0},
        {"source": 1, "sampler": 1},
        {"extensions": {"EXT_texture_webp": {"source": 2}}, "sampler": 2, "extras": {"source": 3}},
        {"sampler": 3},
        {"sampler": 0},
    ]
    return {
        "accessors": [{"bufferView": 3, "sparse": {"indices": {"bufferView": 2}}, "extras": {"bufferView": 3}}],
        "animations": [{"channels": [{"sampler": 3}]}],
        "bufferViews": [{"byteOffset": 4 * at, "byteLength": 3, "name": at} for at in range(5)],
        "extensions": {
            "EXT_lights_image_based": {"lights": [{"specularImages": [[2, 3], [0]]}]},
            "EXT_structural_metadata": {
                "propertyTextures": [{"properties": {"heat": {"index": 4, "channels": [2]}}}],
                "propertyTables": [{"count": 3, "properties": {"name": {"values": 4, "stringOffsets": 0}}}],
            },
        },
        "images": [{"uri": f"{at}.png"} for at in range(4)] + [{"bufferView": 1}],
        "materials": [
            {
                "occlusionTexture": {"index": 1, "texCoord": 3},
                "extensions": {"KHR_materials_iridescence": {"iridescenceThicknessTexture": {"index": 2}}},
                "extras": {"someTexture": {"index": 3}},
            }
        ],
        "meshes": [
            {"primitives": [{"extensions": {"EXT_mesh_features": {"featureIds": [{"texture": {"index": 3}}]}}}]}
        ],
        "nodes": [{"extensions": {"EXT_ours": {"index": 3}}}],
        "samplers": [{"name": at} for at in range(4)],
        "textures": textures,
    }


def without_one(value):
    """The same with all references to what comes after number 1 lower by one, by hand."""
    text = json.dumps(value)
    replacements = [
        ('"KHR_texture_basisu": {"source": 3}', '"KHR_texture_basisu": {"source": 2}'),
        ('"EXT_texture_webp": {"source": 2}', '"EXT_texture_webp": {"source": 1}'),
        ('"sampler": 2, "extras"', '"sampler": 1, "extras"'),
        ('{"sampler": 3}, {"sampler": 0}', '{"sampler": 2}, {"sampler": 0}'),
        ('"specularImages": [[2, 3], [0]]', '"specularImages": [[1, 2], [0]]'),
        ('"heat": {"index": 4,', '"heat": {"index": 3,'),
        ('"iridescenceThicknessTexture": {"index": 2}', '"iridescenceThicknessTexture": {"index": 1}'),
        ('"texture": {"index": 3}', '"texture": {"index": 2}'),
        ('{"source": 1, "sampler": 1}, ', ""),
        ('{"uri": "1.png"}, ', ""),
        ('{"name": 1}, ', ""),
        ('"index": 1, "texCoord"', '"index": null, "texCoord"'),
    ]
    for before, after in replacements:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    return json.loads(text)


def test_every_reference_is_renumbered_and_nothing_else():
    document = everything()
    buffer = GltfBuffer(document)
    for view in document["bufferViews"]:
        buffer.append(b"%d.." % view["name"])
    expected = without_one(document)
    release_references(document, buffer, [(document["materials"][0]["occlusionTexture"], "index")])
    assert document["textures"][1] is document["images"][1] is document["samplers"][1] is None
    compact(document)
    assert document == expected


def test_views_that_go_take_their_bytes_along():
    document = everything()
    buffer = GltfBuffer(document)
    for view in document["bufferViews"]:
        buffer.append(b"%d.." % view["name"])
    document["textures"][1]["source"] = 4
    release_references(document, buffer, [(document["materials"][0], "occlusionTexture")])
    assert document["bufferViews"][1] is document["images"][4] is None
    assert document["images"][1] == {"uri": "1.png"}  # nothing needed it before
    assert buffer.data == b"0..\0002..\0003..\0004.."
    compact(document)
    assert [view["name"] for view in document["bufferViews"]] == [0, 2, 3, 4]
    assert [view["byteOffset"] for view in document["bufferViews"]] == [0, 4, 8, 12]
    assert document["accessors"][0] == {
        "bufferView": 2,
        "sparse": {"indices": {"bufferView": 1}},
        "extras": {"bufferView": 3},
    }
    tables = document["extensions"]["EXT_structural_metadata"]["propertyTables"][0]
    assert tables == {"count": 3, "properties": {"name": {"values": 3, "stringOffsets": 0}}}


def test_new_entries_take_free_places_first():
    document = everything()
    release_references(document, GltfBuffer(document), [(document["materials"][0], "occlusionTexture")])
    assert [add_entry(document, "images", {"uri": uri}) for uri in ("x", "y")] == [1, 5]
    assert document["images"][1] == {"uri": "x"}
    assert add_entry({}, "samplers", {}) == 0


def test_no_empty_lists_are_left():
    document = {
        "materials": [{"occlusionTexture": {"index": 0}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "a"}],
    }
    release_references(document, GltfBuffer(document), [(document["materials"][0], "occlusionTexture")])
    compact(document)
    assert document == {"materials": [{"occlusionTexture": None}]}
