"""OBJ, PLY and glTF made from other formats, read back and read by trimesh."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from aoprecalc.errors import UsageError
from aoprecalc.io import load_scene, output_mesh_extension
from aoprecalc.texture_lookup import linear_from_srgb

TOLERANCE = {".obj": 0, ".ply": 1e-7, ".glb": 1e-7, ".gltf": 1e-7}


@pytest.mark.parametrize("method", ["xatlas", "keep"])
@pytest.mark.parametrize("suffix", TOLERANCE)
def test_a_mesh_comes_back_corner_by_corner(cube_obj, bake, suffix, method):
    scene = load_scene(cube_obj)
    path, atlas, normals, warnings = bake(scene, f"cube_ao{suffix}", method)
    back = load_scene(path)
    assert np.array_equal(back.corners, scene.corners)
    assert back.uvs == pytest.approx(atlas.uvs, abs=TOLERANCE[suffix])
    assert back.normals == pytest.approx(normals, abs=1e-7)
    lost = method == "xatlas" and suffix in (".obj", ".ply")
    assert [f"{suffix[1:].upper()} holds one set of UVs" in warning for warning in warnings] == [True] * lost
    assert back.warnings == ()


@pytest.mark.parametrize("suffix", TOLERANCE)
def test_trimesh_sees_the_same_surface_uvs_and_texture(cube_obj, bake, suffix):
    scene = load_scene(cube_obj)
    path, atlas, _, _ = bake(scene, f"cube_ao{suffix}")
    theirs = trimesh.load_scene(path, process=False)
    assert theirs.to_mesh().volume == pytest.approx(8)
    rows = []
    for mesh in theirs.geometry.values():
        corners = np.concatenate([mesh.triangles, mesh.visual.uv[mesh.faces]], axis=2)
        rows += corners.reshape(-1, 15).round(5).tolist()
        material = mesh.visual.material
        picture = material.image if hasattr(material, "image") else material.baseColorTexture
        assert isinstance(picture, Image.Image)
        assert picture.size == (8, 8)
        assert np.asarray(picture)[0, 0] == 0
        assert np.asarray(picture)[7, 7] == 255
    expected = np.concatenate([scene.corners, atlas.uvs], axis=2).reshape(-1, 15).round(5).tolist()
    assert sorted(rows) == sorted(expected)


@pytest.mark.parametrize("suffix", TOLERANCE)
def test_the_same_mesh_gives_the_same_bytes(cube_obj, bake, suffix):
    scene = load_scene(cube_obj)
    contents = []
    for _ in range(2):
        path, *_ = bake(scene, f"cube_ao{suffix}")
        contents.append({file.name: file.read_bytes() for file in path.parent.iterdir()})
    assert contents[0] == contents[1]


def test_obj_keeps_its_groups_and_materials(cube_obj, bake):
    path, *_ = bake(load_scene(cube_obj), "cube_ao.obj")
    back = load_scene(path)
    assert [part.name for part in back.parts] == ["half 0", "half 2"]
    assert [part.source.material for part in back.parts] == ["paint 0", "paint 2"]
    assert set(back.document.materials) == {"paint 0", "paint 2"}
    assert all(material.texture.path == path.with_name("x_ao.png") for material in back.document.materials.values())
    assert "map_Kd x_ao.png" in path.with_suffix(".mtl").read_text()


def test_obj_positions_keep_every_digit(save, bake):
    text = "v 0.1 1e-9 123456.789012345678\nv 1.0000000000000002 0 0\nv 0 1 0\nf 1 2 3\n"
    scene = load_scene(save("a.obj", text))
    path, *_ = bake(scene, "a_ao.obj")
    assert np.array_equal(load_scene(path).positions, scene.positions)
    path, *_ = bake(scene, "a_ao.ply")
    assert np.array_equal(load_scene(path).positions, scene.positions)


def test_ply_keeps_colours_and_splits_only_at_seams(save, bake):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty float u\nproperty float v\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    body = "0 0 0 10 0 0\n1 0 0 20 1 0\n1 1 0 30 1 1\n0 1 0 40 0 1\n3 0 1 2\n3 0 2 3\n"
    scene = load_scene(save("a.ply", head + body))
    flat = np.broadcast_to(np.float32([0, 0, 1]), (2, 3, 3))
    for method, count in (("keep", 4), ("xatlas", 6)):
        path, *_ = bake(scene, "a_ao.ply", method, flat)
        back = load_scene(path)
        columns = back.document.vertices
        assert list(columns) == ["x", "y", "z", "red", "nx", "ny", "nz", "s", "t"]
        assert len(columns["red"]) == count
        assert columns["red"][back.parts[0].vertices].tolist() == [[10, 20, 30], [10, 30, 40]]
        assert b"property float x\n" in path.read_bytes()


def test_a_textured_obj_becomes_a_glb_with_both_textures(cube_obj, save, bake, tmp_path):
    Image.new("RGB", (4, 4), (250, 20, 20)).save(tmp_path / "red paint.png")
    save("none.mtl", "newmtl paint 0\nKd 0.5 0.5 0.5\nmap_Kd red paint.png\nnewmtl paint 2\nKd 0 1 0\n")
    scene = load_scene(cube_obj)
    suffix, why = output_mesh_extension(scene)
    assert suffix == ".glb"
    assert "OBJ holds one set of UVs" in why
    path, *_ = bake(scene, "cube_ao.glb")
    back = load_scene(path)
    materials = {material["name"]: material for material in back.document.json["materials"]}
    textured = materials["paint 0"]
    assert textured["occlusionTexture"]["texCoord"] == 1
    assert "texCoord" not in textured["pbrMetallicRoughness"]["baseColorTexture"]
    assert textured["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([*linear_from_srgb(np.full(3, 0.5)), 1])
    plain = materials["paint 2"]
    color = plain["pbrMetallicRoughness"]["baseColorTexture"]
    assert plain["occlusionTexture"] == {"texCoord": 0} | color | {"strength": 1}
    assert back.uvs[:4] == pytest.approx(scene.uvs[:4], abs=1e-7)
    theirs = trimesh.load_scene(path)
    pictures = [mesh.visual.material.baseColorTexture for mesh in theirs.geometry.values()]
    assert {picture.size for picture in pictures} == {(4, 4), (8, 8)}


def test_other_maps_of_an_mtl_are_left_out_with_a_word(cube_obj, save, bake):
    save("none.mtl", "newmtl paint 0\nKd 0.5 0.5 0.5\nmap_Bump bumps.png\nNs 7\n")
    path, _, _, warnings = bake(load_scene(cube_obj), "cube_ao.obj")
    text = path.with_suffix(".mtl").read_text()
    assert "Ns 7" in text
    assert "bumps" not in text
    assert "left out" in warnings[0]


def test_which_kind_a_mesh_becomes(cube_obj, cube, save):
    assert output_mesh_extension(load_scene(cube_obj)) == (".obj", "")
    data = trimesh.Trimesh(cube[0], cube[3]).export(file_type="stl")
    suffix, why = output_mesh_extension(load_scene(save("a.stl", data)))
    assert suffix == ".glb"
    assert "STL holds no UVs" in why


def test_a_format_without_uvs_is_refused(cube_obj, bake):
    with pytest.raises(UsageError, match=r"\.obj, \.ply, \.gltf, \.glb"):
        bake(load_scene(cube_obj), "cube_ao.stl")
