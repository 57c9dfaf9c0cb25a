"""Whole bakes of glTF scenes: parts without a texture, shared places, UV sets that are kept."""

import json

import numpy as np
import pytest

from aoprecalc.api.bake import bake_file
from aoprecalc.api.verify import verify
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions, VerifyOptions


@pytest.fixture
def bake_gltf(gltf, tmp_path):
    """Bakes the document; returns (JSON before, JSON after, report)."""

    def run(**options):
        path = gltf.save("made.gltf")
        result = bake_file(path, f"{tmp_path}/out/", options=BakeOptions(size=64, directions=64, **options))
        return json.loads(path.read_text()), json.loads(result.files.mesh.read_text()), result.report.to_dict()

    return run


def occluded(document):
    """(mesh, primitive) of those whose material has an occlusion texture."""
    return {
        (mesh_index, index)
        for mesh_index, mesh in enumerate(document["meshes"])
        for index, primitive in enumerate(mesh["primitives"])
        if "occlusionTexture" in document.get("materials", [])[primitive["material"]]
    }


def test_excluded_and_unlit_parts_come_out_as_they_went_in(gltf_cube, bake_gltf):
    gltf, cube = gltf_cube
    gltf.json["materials"] = [{"name": "paint"}, {"name": "neon", "extensions": {"KHR_materials_unlit": {}}}]
    gltf.json["extensionsUsed"] = ["KHR_materials_unlit"]
    gltf.node(mesh=gltf.mesh(cube | {"material": 0}), name="car")
    gltf.node(mesh=gltf.mesh(cube | {"material": 0}), name="far", translation=[9, 0, 0])
    gltf.node(mesh=gltf.mesh(cube | {"material": 1}), name="sign", translation=[0, 9, 0])
    before, after, report = bake_gltf(exclude=("far",))
    assert occluded(after) == {(0, 0)}
    assert [(part["receives"], part["occludes"]) for part in report["parts"]] == [
        (True, True),
        (False, False),
        (False, True),
    ]
    assert after["materials"][after["meshes"][1]["primitives"][0]["material"]] == before["materials"][0]
    assert after["materials"][1] == before["materials"][1]
    for mesh in (1, 2):
        assert "TEXCOORD_1" not in after["meshes"][mesh]["primitives"][0]["attributes"]
    assert any("'sign'" in line and "unlit" in line for line in report["notes"])


def test_an_instance_that_is_excluded_keeps_the_mesh_of_the_file(gltf_cube, bake_gltf):
    gltf, cube = gltf_cube
    gltf.json["materials"] = [{"name": "paint"}]
    mesh = gltf.mesh(cube | {"material": 0})
    gltf.node(mesh=mesh, name="near")
    gltf.node(mesh=mesh, name="far", translation=[9, 0, 0])
    before, after, _ = bake_gltf(exclude=("far",))
    kept, new = after["nodes"][1]["mesh"], after["nodes"][0]["mesh"]
    assert (kept, new) == (0, 1)
    assert occluded(after) == {(1, 0)}
    assert after["accessors"][: len(before["accessors"])] == before["accessors"]


@pytest.mark.parametrize(("instances", "meshes"), [("bake", [0, 1, 2]), ("share", [0, 0, 0])])
def test_instances_become_meshes_or_share_one(gltf_cube, bake_gltf, instances, meshes):
    gltf, cube = gltf_cube
    mesh = gltf.mesh(cube)
    for x, scale in ((0, 1), (9, -1), (18, 1)):
        gltf.node(mesh=mesh, translation=[x, 0, 0], scale=[scale, 1, 1])
    _, after, report = bake_gltf(instances=instances, unwrap="xatlas")
    assert [node["mesh"] for node in after["nodes"]] == meshes
    assert [part["shares"] for part in report["parts"]] == ([None] * 3 if instances == "bake" else [None, 0, 0])
    assert any("2 instances became separate meshes" in line for line in report["notes"]) == (instances == "bake")
    assert report["ao"]["min"] > 0.9


def test_uvs_that_overlap_between_instances_hold_a_bake_where_these_share(gltf_cube, bake_gltf):
    gltf, cube = gltf_cube
    uvs = (
        np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (6, 1)) * 0.3 + np.repeat(np.mgrid[:3, :2].reshape(2, 6).T, 4, 0) / 3
    )
    cube["attributes"]["TEXCOORD_0"] = gltf.accessor(uvs.astype("<f4"))
    mesh = gltf.mesh(cube)
    for x in (0, 9):
        gltf.node(mesh=mesh, translation=[x, 0, 0])
    assert bake_gltf()[2]["unwrap"]["method"] == "xatlas"
    _, after, report = bake_gltf(instances="share")
    assert (report["unwrap"]["method"], report["unwrap"]["uv_set"]) == ("keep", 0)
    assert "TEXCOORD_1" not in after["meshes"][0]["primitives"][0]["attributes"]


def test_the_first_set_of_uvs_that_can_hold_a_bake_is_kept(gltf_cube, bake_gltf):
    """The first covers a texel twice, the second is flat, the third leaves the unit square by whole tiles."""
    gltf, cube = gltf_cube
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    apart = np.tile(square * 0.3, (6, 1)) + np.repeat(np.mgrid[:3, :2].reshape(2, 6).T, 4, 0) / 3
    twice, flat, far = np.tile(square, (6, 1)), apart * (1, 0), apart + (3, -2)
    for number, uvs in enumerate((twice, flat, far)):
        cube["attributes"][f"TEXCOORD_{number}"] = gltf.accessor(uvs.astype("<f4"))
    gltf.node(mesh=gltf.mesh(cube))
    before, after, report = bake_gltf()
    assert report["unwrap"]["uv_set"] == 2
    first, second, third = report["unwrap"]["checks"]
    assert first["overlap"] == 1
    assert first["fault"].startswith("100.0% of the texels")
    assert (second["flat_faces"], second["overlap"]) == (12, None)
    assert (third["fault"], third["flat_faces"], third["overlap"]) == ("", 0, 0)
    assert after["materials"][0]["occlusionTexture"]["texCoord"] == 2
    assert after["meshes"][0]["primitives"][0]["attributes"] == before["meshes"][0]["primitives"][0]["attributes"]
    assert any("TEXCOORD_2" in line for line in report["warnings"])


def test_repeated_meshes_are_given_back_with_their_extension(gltf_cube, bake_gltf, tmp_path):
    gltf, cube = gltf_cube
    moved = gltf.accessor(np.array([[0, 0, 0], [9, 0, 0]], dtype="<f4"))
    repeated = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moved}}}
    gltf.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    gltf.node(mesh=gltf.mesh(cube), extensions=repeated)
    before, after, report = bake_gltf(unwrap="xatlas")
    assert after["nodes"] == before["nodes"]
    assert [part["shares"] for part in report["parts"]] == [None, 0]
    scenes = [load_scene(tmp_path / name) for name in ("made.gltf", "out/made_ao.gltf")]
    assert np.array_equal(scenes[0].corners, scenes[1].corners)


def test_numbers_that_an_unknown_extension_may_know_stay(gltf_cube, bake_gltf):
    """As of an avatar that names textures and images under names of its own."""
    gltf, cube = gltf_cube
    picture = {"uri": "data:image/png;base64,AAAA"}
    gltf.json |= {"images": [picture] * 4, "textures": [{"source": at} for at in range(4)]}
    gltf.json |= {"extensionsUsed": ["MADE_avatar"], "extensions": {"MADE_avatar": {"meta": {"texture": 3}}}}
    gltf.json["materials"] = [{"occlusionTexture": {"index": at}} for at in (0, 1)]
    gltf.node(mesh=gltf.mesh(cube | {"material": 0}, cube | {"material": 1}))
    before, after, _ = bake_gltf()
    assert after["textures"][:4] == before["textures"]
    assert len(after["images"]) == 5
    assert after["extensions"] == before["extensions"]


def test_an_extension_that_may_count_vertices_is_told(gltf_cube, bake_gltf):
    gltf, cube = gltf_cube
    visible = {"EXT_mesh_primitive_edge_visibility": {"visibility": cube["indices"]}}
    gltf.json["extensionsUsed"] = ["EXT_mesh_primitive_edge_visibility"]
    gltf.node(mesh=gltf.mesh(cube | {"extensions": visible}))
    assert any("EXT_mesh_primitive_edge_visibility, which may refer" in line for line in bake_gltf()[2]["warnings"])


@pytest.mark.slow
def test_the_error_of_shared_places_is_told(gltf_cube, tmp_path):
    gltf, cube = gltf_cube
    mesh = gltf.mesh(cube)
    for x in (0, 2.5):
        gltf.node(mesh=mesh, translation=[x, 0, 0])
    options = BakeOptions(size=64, directions=256, instances="share", unwrap="xatlas")
    result = bake_file(gltf.save("made.gltf"), f"{tmp_path}/out/", options=options, verify=True)
    measured = verify(result.files.mesh, options=VerifyOptions(points=500))
    for notes in (measured.notes, result.report.notes):
        assert any("1 part shares its UVs" in line for line in notes)


def test_glass_is_told_to_be_lost_in_an_obj(gltf_cube, tmp_path):
    gltf, cube = gltf_cube
    gltf.json["materials"] = [{"alphaMode": "BLEND"}]
    gltf.node(mesh=gltf.mesh(cube | {"material": 0}))
    options = BakeOptions(size=64, directions=64)
    report = bake_file(
        gltf.save(), tmp_path / "a.png", mesh_output=tmp_path / "a.obj", options=options
    ).report.to_dict()
    assert any("OBJ holds neither transparency nor alpha masks" in line for line in report["warnings"])
