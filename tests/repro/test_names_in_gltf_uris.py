"""Names with a meaning in URIs: the buffer's was written as it is, so that `stool#2_ao.bin` was the file `stool`.

An encoded name such as a%3Ab was taken for a drive of Windows. What game packs hold, names with backslashes or other
capitals than the file's, was not found.
"""

import os
import shutil
import sys
from urllib.parse import unquote

import numpy as np
import pytest
import trimesh

from aoprecalc.api.bake import bake_file
from aoprecalc.api.verify import verify
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions, VerifyOptions
from gltf_kit.gltf_documents import CHECKS, STACKED, corner, pictured
from gltf_kit.gltf_maker import GltfMaker, png
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues

NAMES = ["stool 10%", "stool#2", "stühle", "a:b?c", "C:d", "50%25", "q&a+b;c=d", "[x]{y}^`|~", "日本", "a'b\"c", "..x"]
posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows takes fewer names")


def bake(path, out, **options):
    out.mkdir(exist_ok=True)
    return bake_file(path, out, options=BakeOptions(size=32, directions=16, **options))


def made(folder, picture="wood.png", uri=None):
    """A .gltf with its buffer and a picture beside it."""
    maker = GltfMaker(folder)
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker))))
    del maker.json["images"][0]["bufferView"], maker.json["images"][0]["mimeType"]
    maker.json["images"][0]["uri"] = uri or picture
    (folder / picture).parent.mkdir(exist_ok=True)
    (folder / picture).write_bytes(png(CHECKS))
    return maker.save("made.gltf", "made.bin")


@posix
@pytest.mark.parametrize("name", NAMES)
def test_every_reader_finds_the_files(name, tmp_path):
    source = made(tmp_path, f"{name}.png", "".join(f"%{byte:02X}" for byte in f"{name}.png".encode()))
    shutil.move(source, tmp_path / f"{name}.gltf")
    result = bake(tmp_path / f"{name}.gltf", tmp_path / "out")
    assert not [line for line in result.report.warnings if "gutters" not in line]
    mesh, json = result.files.mesh, GltfValues(result.files.mesh).json
    assert (result.files.texture.name, mesh.name) == (f"{name}_ao.png", f"{name}_ao.gltf")
    uris = [entry["uri"] for kind in ("buffers", "images") for entry in json[kind]]
    assert all(uri.isascii() and not set(uri) & set(' #?:[]{}^`|"<>\\') for uri in uris)
    assert {unquote(uri) for uri in uris} | {mesh.name} == {file.name for file in mesh.parent.iterdir()}
    assert load_scene(mesh).faces.shape == load_scene(source.with_name(f"{name}.gltf")).faces.shape
    assert verify(mesh, options=VerifyOptions(points=50)).points  # it finds the texture
    assert trimesh.load_scene(mesh).area == pytest.approx(2)


@posix
@needs_validator
def test_the_validator_finds_the_files(tmp_path):
    for number, name in enumerate(NAMES):
        folder = tmp_path / str(number)
        folder.mkdir()
        source = made(folder)
        shutil.move(source, folder / f"{name}.gltf")
        assert new_issues(folder / f"{name}.gltf", bake(folder / f"{name}.gltf", folder / "out").files.mesh) == []


def test_unlike_names_have_unlike_buffers(tmp_path):
    """Their URIs need no escape, since trimesh does not decode them, and one does not replace the other."""
    source = made(tmp_path)
    for name in ("a b", "a#b", "a_b"):
        shutil.copy(source, tmp_path / f"{name}.gltf")
        bake(tmp_path / f"{name}.gltf", tmp_path / "out")
    buffers = sorted(file.name for file in (tmp_path / "out").glob("*.bin"))
    assert buffers[-1] == "a_b_ao.bin"
    assert [name.partition("-")[0] for name in buffers[:2]] == ["a_b_ao"] * 2


MISNAMED = {
    r"textures\Wood.png": "textures/Wood.png",
    "Textures/WOOD.png": "textures/Wood.png",
    r"Textures\\wood.PNG": "textures/Wood.png",
    "wood%20.png": "wood%20.png",
    "textures/Wood.png?v=3#page": "textures/Wood.png",
    "maps/of/wood.png": "Wood.png",
    "wo\N{COMBINING DIAERESIS}od.png": "w\N{LATIN SMALL LETTER O WITH DIAERESIS}od.png",
    "./sub/..\\TEXTURES/wood%2Epng": "textures/Wood.png",
}


@posix
@pytest.mark.parametrize("kind", ["gltf", "glb"])
@pytest.mark.parametrize(("uri", "file"), MISNAMED.items(), ids=ascii)
def test_what_other_systems_find_is_found_and_told(uri, file, kind, tmp_path):
    source = made(tmp_path, file, uri)
    (tmp_path / "sub").mkdir()
    assert [line.partition(" refers to ")[2] for line in load_scene(source).warnings] == [
        f"{uri!a}, which is read from {file!a}; other programs may not find it"
    ]
    out = tmp_path / "out"
    out.mkdir()
    for folder in (out, tmp_path):
        options = BakeOptions(size=32, directions=16)
        mesh = bake_file(source, folder, mesh_output=folder / f"new.{kind}", options=options).files.mesh
        after = GltfValues(mesh)
        assert after.image(0)[0] == png(CHECKS)
        assert load_scene(mesh).warnings == ()
        if folder == tmp_path and kind == "gltf":
            assert os.path.samefile(tmp_path / unquote(after.json["images"][0]["uri"]), tmp_path / file)


@posix
def test_a_buffer_in_other_capitals_is_found(tmp_path):
    source = made(tmp_path)
    (tmp_path / "made.bin").rename(tmp_path / "MADE.Bin")
    (warning,) = load_scene(source).warnings
    assert "'made.bin', which is read from 'MADE.Bin'" in warning


@posix
def test_a_file_of_the_very_name_is_preferred(tmp_path):
    source = made(tmp_path, "WOOD.png", "wood.png")
    (tmp_path / "wood.png").write_bytes(png(np.zeros((4, 4, 3))))
    assert load_scene(source).warnings == ()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems take no such name")
def test_a_name_that_is_not_text(tmp_path):
    source = made(tmp_path, os.fsdecode(b"w\xffood.png"), "w%FFood.png")
    after = GltfValues(bake(source, tmp_path / "out").files.mesh)
    assert after.json["images"][0]["uri"] == "w%FFood.png"
    assert (tmp_path / "out" / os.fsdecode(b"w\xffood.png")).read_bytes() == png(CHECKS)
