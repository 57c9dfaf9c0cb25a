"""glTF documents that are given back with a texture and nothing else changed."""

import json
from copy import deepcopy

import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image

from aoprecalc.io import load_scene, read_image
from aoprecalc.io.formats.gltf.document import float_values, raw_rows, raw_values


def occlusion_uvs(scene):
    """The UVs, v upwards, that each part's material names for its occlusion texture; (f, 3, 2)."""
    document, found = scene.document, []
    for part in scene.parts:
        primitive = document.json["meshes"][part.source.mesh]["primitives"][part.source.primitive]
        info = document.json["materials"][primitive["material"]]["occlusionTexture"]
        values = float_values(document, primitive["attributes"][f"TEXCOORD_{info.get('texCoord', 0)}"])
        found.append(values[part.vertices] * [1, -1] + [0, 1])
    return np.concatenate(found)


def check_document(path):
    """Read every accessor, and hold the document to what the specification asks of it."""
    scene = load_scene(path)
    document = scene.document
    for index, accessor in enumerate(document.json["accessors"]):
        rows = raw_rows(document, index)
        assert len(rows) == accessor["count"]
        if "min" in accessor:
            values = raw_values(document, index)
            assert accessor["min"] == values.min(axis=0).tolist()
            assert accessor["max"] == values.max(axis=0).tolist()
    for mesh in document.json["meshes"]:
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            assert len({document.json["accessors"][index]["count"] for index in attributes.values()}) == 1
            assert "min" in document.json["accessors"][attributes["POSITION"]]
            sets = sorted(name for name in attributes if name.startswith("TEXCOORD"))
            assert sets == [f"TEXCOORD_{number}" for number in range(len(sets))]
            for index in attributes.values():
                accessor = document.json["accessors"][index]
                view = document.json["bufferViews"][accessor["bufferView"]]
                stride = view.get("byteStride", raw_rows(document, index).shape[1])
                assert stride % 4 == 0
                assert (view.get("byteOffset", 0) + accessor.get("byteOffset", 0)) % 4 == 0
    assert pygltflib.GLTF2().load(str(path)).buffers[0].byteLength == len(document.buffers[0])
    ours = trimesh.Trimesh(scene.positions, scene.faces, process=False)
    if not any("weights" in mesh for mesh in document.json["meshes"]):  # of morph targets trimesh knows nothing
        assert trimesh.load_scene(path, process=False).to_mesh().area == pytest.approx(ours.area)
    return scene


@pytest.mark.parametrize("own", [True, False], ids=["same normals", "new normals"])
@pytest.mark.parametrize("method", ["xatlas", "keep"])
@pytest.mark.parametrize("name", ["cube_ao.gltf", "cube_ao.glb"])
def test_a_cube_comes_back_corner_by_corner(gltf_cube, bake, name, method, own):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive), scale=[-2, 1, 1], rotation=[0.5, 0.5, 0.5, 0.5])
    scene = maker.load()
    path, atlas, normals, warnings = bake(scene, name, method, scene.normals if own else None)
    back = check_document(path)
    assert np.array_equal(back.corners, scene.corners)
    assert occlusion_uvs(back) == pytest.approx(atlas.uvs, abs=1e-7)
    assert np.array_equal(back.uvs, scene.uvs)
    assert back.normals == pytest.approx(normals, abs=2e-7)
    assert warnings == ()


def test_keeping_uvs_and_normals_touches_no_vertex(gltf_cube, bake):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    scene = maker.load()
    path, *_ = bake(scene, "cube_ao.glb", "keep", scene.normals)
    back = load_scene(path).document
    for kind in ("accessors", "nodes", "asset"):
        assert back.json[kind] == scene.document.json[kind]
    assert back.buffers[0].startswith(scene.document.buffers[0])


def test_normals_that_were_of_no_use_are_replaced(gltf_cube, bake, cube):
    maker, primitive = gltf_cube
    broken = np.repeat(cube[2], 4, axis=0).astype("<f4")
    broken[5] = 0
    primitive["attributes"]["NORMAL"] = maker.accessor(broken)
    maker.node(mesh=maker.mesh(primitive))
    scene = maker.load()
    assert "no usable normal at 1 of 36 corners" in scene.notes[0]
    path, *_ = bake(scene, "cube_ao.glb", "keep", scene.normals)
    back = load_scene(path)
    assert back.warnings == back.notes == ()
    assert back.normals == pytest.approx(scene.normals, abs=1e-7)


def test_all_else_in_the_document_stays(gltf_cube, bake):
    maker, primitive = gltf_cube
    extra = {"anything": [1, {"two": None}]}
    maker.node(
        mesh=maker.mesh(primitive | {"material": 1, "extras": extra}, name="mesh", extras=extra),
        name="box",
        extras=extra,
    )
    maker.node(name="camera", camera=0)
    maker.json |= {
        "asset": {"version": "2.0", "generator": "someone", "copyright": "hers"},
        "extensionsUsed": ["EXT_of_ours"],
        "extensions": {"EXT_of_ours": extra},
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
        "materials": [
            {"name": "unused", "occlusionTexture": {"index": 0}},
            {"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}, "extras": extra},
        ],
        "textures": [{"source": 0}],
        "images": [{"uri": "data:image/png;base64,AAAA"}],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
                "samplers": [
                    {
                        "input": maker.accessor(np.array([0, 1], "<f4")),
                        "output": maker.accessor(np.eye(3, dtype="<f4")[:2]),
                    }
                ],
            }
        ],
    }
    scene = maker.load()
    before = deepcopy(scene.document.json)
    path, *_ = bake(scene, "cube_ao.gltf")
    after = check_document(path).document
    assert scene.document.json == before
    for kind in ("asset", "extensionsUsed", "extensions", "cameras", "animations", "nodes"):
        assert after.json[kind] == before[kind]
    assert after.json["materials"][0] == before["materials"][0]
    assert after.json["materials"][1] == before["materials"][1] | {
        "occlusionTexture": {"index": 1, "texCoord": 1, "strength": 1}
    }
    assert after.json["textures"][0] == before["textures"][0]
    assert after.json["images"][:2] == [before["images"][0], {"uri": "x_ao.png"}]
    assert after.json["meshes"][0]["extras"] == after.json["meshes"][0]["primitives"][0]["extras"] == extra
    sampler = after.json["animations"][0]["samplers"][0]
    assert raw_values(after, sampler["input"])[:, 0].tolist() == [0, 1]
    assert raw_values(after, sampler["output"]).tolist() == [[1, 0, 0], [0, 1, 0]]


def test_every_attribute_and_morph_target_goes_along(gltf, bake):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
    stamp = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]], dtype="<u1")
    padded = np.pad(stamp, ((0, 0), (0, 1)))
    delta = np.arange(12, dtype="<f4").reshape(4, 3)
    attributes = {
        "POSITION": gltf.accessor(points, min=[0, 0, 0], max=[1, 1, 0]),
        "COLOR_0": gltf.accessor(stamp, bufferView=gltf.view(padded.tobytes(), byteStride=4), normalized=True),
        "_OURS": gltf.accessor(np.array([5, 6, 7, 8], dtype="<f4")),
    }
    primitive = {"attributes": attributes, "indices": gltf.accessor(np.array([0, 1, 2, 0, 2, 3], dtype="<u4"))}
    primitive["targets"] = [{"POSITION": gltf.accessor(delta, min=[0, 1, 2], max=[9, 10, 11])}]
    gltf.node(mesh=gltf.mesh(primitive, weights=[0.5]))
    scene = gltf.load()
    assert np.array_equal(scene.corners[0], (points + delta / 2)[:3])
    path, atlas, normals, _ = bake(scene, "a.glb")
    back = check_document(path)
    document, part = back.document, back.parts[0]
    written = document.json["meshes"][0]["primitives"][0]
    corners = [[0, 1, 2], [0, 2, 3]]
    assert raw_values(document, written["attributes"]["COLOR_0"])[part.vertices].tolist() == stamp[corners].tolist()
    assert document.json["accessors"][written["attributes"]["COLOR_0"]]["normalized"] is True
    assert raw_values(document, written["attributes"]["_OURS"])[part.vertices][:, :, 0].tolist() == [
        [5, 6, 7],
        [5, 7, 8],
    ]
    assert raw_values(document, written["targets"][0]["POSITION"])[part.vertices].tolist() == delta[corners].tolist()
    assert occlusion_uvs(back) == pytest.approx(atlas.uvs, abs=1e-7)
    assert back.normals == pytest.approx(normals, abs=2e-7)
    assert document.json["meshes"][0]["weights"] == [0.5]
    assert len(document.json["accessors"]) == 7  # no dead ones are left: 5 of before, UVs and normals


def test_instances_get_a_place_each(gltf_cube, bake):
    maker, primitive = gltf_cube
    mesh = maker.mesh(primitive, name="shared")
    for x in (0, 5, 10):
        maker.node(mesh=mesh, translation=[x, 0, 0])
    scene = maker.load()
    path, atlas, normals, _ = bake(scene, "cubes_ao.glb")
    back = check_document(path)
    assert [node["mesh"] for node in back.document.json["nodes"]] == [0, 1, 2]
    assert np.array_equal(back.corners, scene.corners)
    assert occlusion_uvs(back) == pytest.approx(atlas.uvs, abs=1e-7)
    assert back.normals == pytest.approx(normals, abs=2e-7)
    path, *_ = bake(scene, "kept_ao.glb", "keep", scene.normals)
    assert [node["mesh"] for node in load_scene(path).document.json["nodes"]] == [0, 0, 0]


def test_strips_lines_and_shared_vertices(gltf, bake):
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")
    position = gltf.accessor(square, min=[0, 0, 0], max=[1, 1, 0])
    lines = {"attributes": {"POSITION": position}, "mode": 1, "material": 0}
    strip = {"attributes": {"POSITION": position}, "mode": 5, "material": 0}
    fan = {"attributes": {"POSITION": position}, "mode": 6, "indices": gltf.accessor(np.array([3, 2, 0, 1], "<u2"))}
    gltf.json["materials"] = [{"name": "ink"}]
    gltf.node(mesh=gltf.mesh(lines, strip, fan))
    scene = gltf.load()
    path, atlas, _, _ = bake(scene, "a.gltf")
    back = check_document(path)
    primitives = back.document.json["meshes"][0]["primitives"]
    assert primitives[0] == lines
    assert np.array_equal(raw_values(back.document, position), square)
    assert "mode" not in primitives[1] | primitives[2]
    assert np.array_equal(back.corners, scene.corners)
    assert occlusion_uvs(back) == pytest.approx(atlas.uvs, abs=1e-7)
    materials = back.document.json["materials"]
    assert materials[0] == {"name": "ink"}  # the lines have no UVs for the texture
    assert materials[primitives[1]["material"]] == {
        "name": "ink",
        "occlusionTexture": {"index": 0, "texCoord": 0, "strength": 1},
    }


def test_a_material_is_doubled_for_another_set(gltf_cube, bake):
    maker, primitive = gltf_cube
    plain = {key: value for key, value in primitive["attributes"].items() if key != "TEXCOORD_0"}
    maker.json["materials"] = [{"name": "paint", "occlusionTexture": {"index": 0, "strength": 0.5}}]
    maker.json |= {"textures": [{"source": 0}], "images": [{"uri": "data:image/png;base64,AAAA"}]}
    variants = {"KHR_materials_variants": {"mappings": [{"material": 0, "variants": [0]}]}}
    both = [primitive | {"material": 0, "extensions": variants}, primitive | {"attributes": plain, "material": 0}]
    maker.node(mesh=maker.mesh(*both))
    path, _, _, warnings = bake(maker.load(), "a.glb")
    document = load_scene(path).document.json
    first, second = document["meshes"][0]["primitives"]
    assert document["materials"][first["material"]]["occlusionTexture"] == {"index": 0, "texCoord": 1, "strength": 1}
    assert document["materials"][second["material"]]["occlusionTexture"] == {"index": 0, "texCoord": 0, "strength": 1}
    assert first["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] == first["material"]
    assert len(document["materials"]) == 2
    assert warnings == ("the occlusion textures of 1 material were replaced; their strength is 1, it was 0.5",)


def test_images_are_copied_beside_a_gltf_and_put_into_a_glb(gltf_cube, bake, tmp_path):
    maker, primitive = gltf_cube
    (tmp_path / "maps").mkdir()
    Image.new("RGB", (3, 3), (9, 9, 9)).save(tmp_path / "maps" / "the map.png")
    Image.new("RGB", (5, 5), (9, 9, 9)).save(tmp_path / "x_ao.png")  # of the same name as the texture
    maker.json["images"] = [{"uri": "maps/the%20map.png"}, {"uri": "x_ao.png"}, {"uri": "none.png"}]
    maker.json["textures"] = [{"source": 0}, {"source": 1}]
    maker.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1}}
    ]
    maker.node(mesh=maker.mesh(primitive | {"material": 0}))
    scene = maker.load("made.gltf")
    path, _, _, warnings = bake(scene, "cube_ao.gltf")
    assert len(warnings) == 1
    assert "refers to 1 image that cannot be read: 'none.png'; it was missing before the bake" in warnings[0]
    images = load_scene(path).document.json["images"]
    assert [image["uri"] for image in images] == ["the%20map.png", "x_ao_1.png", "none.png", "x_ao.png"]
    for name, size in (("the map.png", 3), ("x_ao_1.png", 5), ("x_ao.png", 8)):
        assert len(read_image(path.parent / name)) == size

    path, *_ = bake(scene, "cube_ao.glb")
    document = pygltflib.GLTF2().load(str(path))
    assert [image.mimeType for image in document.images] == ["image/png", "image/png", None, "image/png"]
    material = next(iter(trimesh.load_scene(path).geometry.values())).visual.material
    assert material.baseColorTexture.size == (3, 3)
    assert material.occlusionTexture.size == (8, 8)


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_a_picture_that_gltf_cannot_hold_gets_a_png_beside_it(gltf_cube, bake, name):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    path, _, _, warnings = bake(maker.load(), name, texture="x_ao.exr")
    assert "allows no .exr images" in warnings[0]
    material = next(iter(trimesh.load_scene(path).geometry.values())).visual.material
    assert np.asarray(material.occlusionTexture).reshape(-1)[[0, -1]].tolist() == [0, 255]


def test_bytes_are_the_same_each_time(gltf_cube, bake):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    scene = maker.load()
    for name in ("a.gltf", "a.glb"):
        contents = []
        for _ in range(2):
            path, *_ = bake(scene, name)
            contents.append({file.name: file.read_bytes() for file in path.parent.iterdir()})
        assert contents[0] == contents[1]
        assert not any(json.dumps(str(path.parent))[1:-1].encode() in content for content in contents[0].values())


def test_normals_of_skinned_meshes_come_back_through_their_joints(gltf, bake):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
    attributes = {
        "POSITION": gltf.accessor(points, min=[0, 0, 0], max=[1, 1, 0]),
        "JOINTS_0": gltf.accessor(np.array([[0, 1, 0, 0]] * 3, dtype="<u1")),
        "WEIGHTS_0": gltf.accessor(np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]], dtype="<f4")),
    }
    joints = [gltf.node(scale=[1, 2, 3]), gltf.node(rotation=[0.6, 0, 0, 0.8], translation=[0, 0, 4])]
    gltf.json["skins"] = [{"joints": joints}]
    gltf.node(mesh=gltf.mesh({"attributes": attributes}), skin=0)
    scene = gltf.load()
    path, atlas, normals, _ = bake(scene, "a.glb")
    back = load_scene(path)
    assert back.corners == pytest.approx(scene.corners)
    assert back.normals == pytest.approx(normals, abs=1e-6)
    assert occlusion_uvs(back) == pytest.approx(atlas.uvs, abs=1e-7)


def test_numbers_that_are_not_finite_leave_the_document_valid_json(gltf_cube, bake):
    maker, primitive = gltf_cube
    tangents = np.tile([1, 0, 0, 1], (24, 1)).astype("<f4")
    tangents[3, 0] = np.nan
    primitive["attributes"]["TANGENT"] = maker.accessor(tangents, min=[1, 0, 0, 1], max=[1, 0, 0, 1])
    maker.node(mesh=maker.mesh(primitive))
    path, *_ = bake(maker.load(), "cube_ao.gltf")
    json.loads(path.read_text(), parse_constant=pytest.fail)
