"""Ambient occlusion at vertices as files hold it: _AO or COLOR_0 in glTF, ao in PLY, read by other programs."""

import json
from dataclasses import replace

import numpy as np
import pygltflib
import pytest
import trimesh

from aoprecalc.api.bake import bake_file
from aoprecalc.errors import UsageError
from aoprecalc.io import load_scene
from aoprecalc.io.formats.base import VertexOcclusion
from aoprecalc.io.formats.gltf.document import float_values
from aoprecalc.options import BakeOptions
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_validator import issues, needs_validator


def by_position(scene):
    """A value at each corner that depends on its position alone, (f, 3) float32 in [0, 1]."""
    return (0.5 + scene.corners @ [0.25, 0.125, 0.0625]).astype(np.float32)


def written(scene, path, as_color=False, method="xatlas", normals=None):
    """Write it; the messages."""
    vertices = VertexOcclusion(by_position(scene), as_color)
    normals = scene.normals if normals is None else normals
    return write_with_texture(scene, path, method, normals, vertices=vertices)[3]


def read(path, name):
    """The values of an attribute at the corners of the scene in a glTF file, (f, 3, c), and that scene."""
    scene = load_scene(path)
    found = []
    for part in scene.parts:
        primitive = scene.document.json["meshes"][part.source.mesh]["primitives"][part.source.primitive]
        found.append(float_values(scene.document, primitive["attributes"][name])[part.vertices])
    return np.concatenate(found), scene


@pytest.mark.parametrize("method", ["xatlas", "keep"])
@pytest.mark.parametrize("source", ["obj", "glb"])
@pytest.mark.parametrize(("name", "width"), [("_AO", 1), ("COLOR_0", 3)])
def test_gltf_has_the_values_at_its_corners(cube_obj, gltf_cube, tmp_path, source, method, name, width):
    maker, primitive = gltf_cube
    if source == "glb":
        maker.node(mesh=maker.mesh(primitive))
    scene = load_scene(cube_obj) if source == "obj" else maker.load()
    path = tmp_path / "out/a.glb"
    assert written(scene, path, name == "COLOR_0", method) == ()
    values, back = read(path, name)
    assert values.shape[2] == width
    assert values == pytest.approx(by_position(back)[:, :, None].repeat(width, axis=2), abs=1e-6)
    accessors = pygltflib.GLTF2().load(path)
    attributes = [primitive.attributes for mesh in accessors.meshes for primitive in mesh.primitives]
    for found in attributes:
        accessor = accessors.accessors[getattr(found, name)]
        assert (accessor.componentType, accessor.type) == (pygltflib.FLOAT, "SCALAR" if width == 1 else "VEC3")
    if source == "glb" and method == "keep":  # no vertex is split
        assert sum(accessors.accessors[found.POSITION].count for found in attributes) == 24


def test_trimesh_reads_the_attribute(cube_obj, tmp_path):
    scene, path = load_scene(cube_obj), tmp_path / "out/a.glb"
    written(scene, path)
    for mesh in trimesh.load_scene(path, process=False).geometry.values():
        expected = 0.5 + mesh.vertices @ [0.25, 0.125, 0.0625]
        assert mesh.vertex_attributes["_AO"][:, 0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("as_color", "others"), [(False, ()), (True, ("COLOR_0 already, which is kept",))])
def test_colours_of_a_gltf_are_kept(gltf_cube, tmp_path, as_color, others):
    maker, primitive = gltf_cube
    colors = np.random.default_rng(0).random((24, 3)).astype("<f4")
    primitive["attributes"]["COLOR_0"] = maker.accessor(colors)
    maker.node(mesh=maker.mesh(primitive))
    scene, path = maker.load(), tmp_path / "out/a.glb"
    messages = written(scene, path, as_color)
    assert [other in message for other, message in zip(others, messages, strict=True)] == [True] * len(others)
    values, back = read(path, "_AO")
    assert values[:, :, 0] == pytest.approx(by_position(back), abs=1e-6)
    assert read(path, "COLOR_0")[0] == pytest.approx(colors[scene.parts[0].vertices])


def test_ao_as_colour_is_not_the_base_texture_as_well(cube_obj, tmp_path):
    for as_color in (False, True):
        path = tmp_path / "out" / f"{as_color}.gltf"
        written(load_scene(cube_obj), path, as_color)
        materials = json.loads(path.read_text())["materials"]
        shown = ["baseColorTexture" in material["pbrMetallicRoughness"] for material in materials]
        assert shown == [not as_color] * len(materials)
        assert all("occlusionTexture" in material for material in materials)


def test_ply_has_a_property_and_keeps_the_rest(save, tmp_path):
    text = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "property float heat\nproperty float ao\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0 5 7\n1 0 0 6 7\n1 1 0 7 7\n0 1 0 8 7\n4 0 1 2 3\n"
    )
    scene, path = load_scene(save("a.ply", text)), tmp_path / "out/a.ply"
    up = np.zeros((2, 3, 3), np.float32) + np.float32([0, 0, 1])
    written(replace(scene, normals=up), path)
    mesh = trimesh.load(path, process=False)
    rows = mesh.metadata["_ply_raw"]["vertex"]["data"]
    expected = 0.5 + np.column_stack([rows["x"], rows["y"], rows["z"]]) @ [0.25, 0.125, 0.0625]
    assert rows["ao"] == pytest.approx(expected, abs=1e-6)
    assert sorted(set(rows["heat"].tolist())) == [5, 6, 7, 8]


@pytest.mark.parametrize("name", ["a.obj", "a.usda", "out/"])
def test_other_formats_are_refused_before_the_work(cube_obj, tmp_path, name):
    options = BakeOptions(size=64, directions=16, vertex_ao="attribute")
    with pytest.raises(UsageError, match=r"needs \.gltf, \.glb or \.ply"):
        bake_file(cube_obj, f"{tmp_path}/{name}", options=options)
    assert [file.name for file in tmp_path.iterdir()] == ["cube.obj"]


@needs_validator
@pytest.mark.parametrize("as_color", [False, True])
def test_the_validator_accepts_them(cube_obj, tmp_path, as_color):
    path = tmp_path / "out/a.glb"
    written(load_scene(cube_obj), path, as_color)
    assert [issue for issue in issues(path)[0] if issue["severity"] <= 1] == []
