"""The registry of mesh formats: by extension, by content, and what every format states about itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import MESH_EXTENSIONS, OUTPUT_MESH_EXTENSIONS, output_mesh_extension
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene
from aoprecalc.io.meshes import FORMATS, format_of, load_scene, read_scene, sniff_format

FILES = ("obj", "ply", "stl", "stl_ascii", "off", "gltf", "glb", "dae", "3mf")


def content(kind):
    box = trimesh.creation.box()
    if kind == "gltf":
        return box.export(file_type="gltf")["model.gltf"]
    data = box.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize("kind", FILES)
def test_content_is_recognised_by_its_own_format_only(kind):
    data, extension = content(kind), f".{kind.removesuffix('_ascii')}"
    assert [extension in mesh_format.extensions for mesh_format in FORMATS if mesh_format.sniff(data)] == [True]


@pytest.mark.parametrize(
    "data", [b"", b"\0", b"PK", b"{}", b"plyer", b"solid", bytes(range(256)) * 9, "Ünïcödé".encode()]
)
def test_other_content_is_not_recognised(data):
    assert sniff_format(data) is None


@pytest.mark.parametrize("kind", [kind for kind in FILES if kind not in ("gltf", "stl_ascii")])
def test_bytes_are_read_without_a_file(kind):
    scene = read_scene(Path(f"/nowhere/box.{kind}"), content(kind))
    assert len(scene.faces) == 12
    assert scene.format == kind


def test_extensions_are_distinct_and_those_that_are_written_are_known():
    assert len(set(MESH_EXTENSIONS)) == len(MESH_EXTENSIONS) == sum(len(known.extensions) for known in FORMATS)
    assert set(OUTPUT_MESH_EXTENSIONS) <= set(MESH_EXTENSIONS)
    assert format_of("A.GLB") is format_of("b.gltf")
    with pytest.raises(UsageError, match=r"is not one of \.obj, "):
        format_of("a.blend")


def test_a_file_under_the_name_of_another_format_is_named(save):
    with pytest.raises(InputError, match=r"its content is PLY, OBJ was expected; rename it to \.ply"):
        load_scene(save("a.obj", content("ply")))


class PointsFormat(MeshFormat):
    """Nine numbers a triangle."""

    name = "numbers"
    extensions = (".numbers",)

    def sniff(self, data):
        return data.startswith(b"numbers")

    def read(self, path, data):
        positions = np.array(data.split()[1:], float).reshape(-1, 3)
        return build_scene(path, "numbers", [MeshPiece("mesh", positions, np.arange(len(positions)).reshape(-1, 3))])


def test_a_new_format_needs_a_name_and_a_reader(monkeypatch, save):
    monkeypatch.setattr("aoprecalc.io.meshes._BY_EXTENSION", {".numbers": PointsFormat()})
    scene = load_scene(save("a.numbers", "numbers 0 0 0 1 0 0 0 1 0"))
    assert len(scene.faces) == 1
    assert output_mesh_extension(scene) == (".glb", "numbers holds no UVs, so the mesh becomes a GLB")
    assert output_mesh_extension(replace(scene, format="")) == (".glb", "")
