"""A ZIP with one mesh is read as that mesh, and nothing of what else it may hold does harm."""

import gc
import io
import json
import tempfile
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import aoprecalc as ao
from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import input_files, load_scene, output_mesh_extension, source_files
from aoprecalc.io.formats import archives
from gltf_kit.gltf_maker import textured_triangle
from gltf_kit.gltf_validator import issues, needs_validator

OPTIONS = ao.BakeOptions(size=16, directions=8, unwrap="uvunwrap")
TRIANGLE = "mtllib m/paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl paint\nf 1/1 2/2 3/3\n"


def picture(color=(255, 0, 0)):
    file = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(file, "png")
    return file.getvalue()


OBJ = {"a/t.obj": TRIANGLE, "a/m/paint.mtl": "newmtl paint\nmap_Kd paint.png\n", "a/m/paint.png": picture()}
GLTF = {"scene.gltf": json.dumps(textured_triangle()), "color.png": picture()}


@pytest.fixture
def pack(tmp_path, monkeypatch):
    """pack(files, name) -> the path of a ZIP of {name: content}; what is unpacked goes below `tmp_path`."""
    (tmp_path / "unpacked").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "unpacked"))

    def make(files, name="a.zip"):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            for member, content in files.items():
                archive.writestr(member, content)
        return tmp_path / name

    return make


def unpacked(path):
    return list((path.parent / "unpacked").iterdir())


@pytest.mark.parametrize("files", [OBJ, GLTF], ids=["obj", "gltf"])
def test_the_mesh_in_it_becomes_a_glb_with_its_picture(pack, tmp_path, files):
    path = pack(files)
    result = ao.bake(path, OPTIONS)
    (tmp_path / "out").mkdir()
    result.save(tmp_path / "out" / "x_ao.png")
    baked = tmp_path / "out" / "x_ao.glb"
    document = load_scene(baked).document
    images = [image for image in document.json["images"] if "bufferView" in image]
    assert len(images) == len(document.json["images"]) >= 1
    views = [document.json["bufferViews"][image["bufferView"]] for image in images]
    stored = [document.buffers[0][view["byteOffset"] :][: view["byteLength"]] for view in views]
    assert picture() in stored
    assert result.report.input.path == str(path)
    assert str(tmp_path / "unpacked") not in json.dumps(result.report.to_dict())


@needs_validator
def test_the_validator_finds_nothing(pack, tmp_path):
    ao.bake(pack(OBJ), OPTIONS).save(tmp_path / "x.glb")
    assert [issue["message"] for issue in issues(tmp_path / "x.glb")[0]] == []


def test_a_gltf_has_copies_of_the_pictures(pack, tmp_path):
    for name, files in (("obj", OBJ), ("gltf", GLTF)):
        (tmp_path / name).mkdir()
        ao.bake(pack(files), OPTIONS).save(tmp_path / name / "x.gltf")
        document = json.loads((tmp_path / name / "x.gltf").read_text())
        assert all((tmp_path / name / image["uri"]).is_file() for image in document["images"])


@pytest.mark.parametrize("extension", ["obj", "ply"])
def test_no_other_mesh_refers_into_a_zip(pack, tmp_path, extension):
    with pytest.raises(UsageError, match=r"cannot refer to pictures in .*a\.zip; write a \.glb"):
        ao.bake(pack(OBJ), OPTIONS).save(tmp_path / f"x.{extension}")


def test_what_was_unpacked_goes_when_the_mesh_does(pack):
    path = pack(OBJ)
    scene = load_scene(path)
    assert len(unpacked(path)) == 1
    assert source_files(scene) == [path]
    assert input_files(path, path.read_bytes()) == [path]
    assert output_mesh_extension(scene)[0] == ".glb"
    del scene
    gc.collect()
    assert unpacked(path) == []
    with pytest.raises(InputError):
        load_scene(pack({"a.obj": "v 0 0 0\nf 1 2 3\n"}))
    assert unpacked(path) == []


def test_a_mesh_without_files_needs_no_folder(pack):
    path = pack({"a.off": "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"})
    scene = load_scene(path)
    assert (len(scene.faces), scene.format, scene.path) == (1, "off", path)
    assert unpacked(path) == []


def test_files_of_systems_and_other_files_are_no_meshes(pack):
    files = OBJ | {"__MACOSX/a/._t.obj": "x", "a/.t.obj": "x", "licence.txt": "x", "preview.png": picture()}
    assert len(load_scene(pack(files)).faces) == 1


def test_messages_name_the_zip(pack, tmp_path):
    path = pack({"a/t.obj": TRIANGLE.replace("f 1/1", "f 9/1")})
    with pytest.raises(InputError) as failure:
        load_scene(path)
    assert str(failure.value).startswith(f"{path}/a/t.obj: ") or str(failure.value).startswith(f"{path}\\a")
    assert "unpacked" not in str(failure.value)
    scene = load_scene(pack({"a.off": "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n"}))
    assert all("unpacked" not in line for line in scene.warnings)
    assert any("a.zip" in line for line in scene.warnings)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "is an empty ZIP, one mesh with its files was expected"),
        ({"a/stool.blend": "x", "b.txt": "x"}, "export a/stool.blend as glTF"),
        ({"readme.txt": "x"}, "1 file and no mesh, one of .obj, "),
        ({"in.zip": "PK"}, "unpack it and use in.zip"),
        ({"a.obj": "x", "b/c.gltf": "x"}, "holds 2 meshes (a.obj, b/c.gltf), one was expected"),
        ({f"{number}.stl": "x" for number in range(20)}, "holds 20 meshes (0.stl, 1.stl, "),
        ({"../a.obj": "x"}, "is named '../a.obj', a path inside it was expected"),
        ({"b/../../a.obj": "x"}, "a path inside it was expected"),
        ({"..\\a.obj": "x"}, "is named '../a.obj'"),
        ({"/a.obj": "x"}, "is named '/a.obj'"),
        ({"C:\\a.obj": "x"}, "is named 'C:/a.obj'"),
    ],
)
def test_what_cannot_be_used_is_named(pack, files, said):
    path = pack(files)
    with pytest.raises(InputError) as failure:
        load_scene(path)
    assert said in str(failure.value)
    assert "\n" not in str(failure.value)
    assert unpacked(path) == []
    assert not (path.parent / "a.obj").exists()


def test_a_bomb_is_not_unpacked(pack, monkeypatch):
    path = pack({"a.obj": "0" * 1_000_000})
    assert path.stat().st_size < 10_000
    monkeypatch.setattr(archives, "_MAX_UNPACKED", 999_999)
    monkeypatch.setattr(zipfile.ZipFile, "read", None)  # calling it would fail
    with pytest.raises(InputError, match="when unpacked"):
        load_scene(path)
    monkeypatch.setattr(archives, "_MAX_UNPACKED", 1 << 30)
    monkeypatch.setattr(archives, "_MAX_FILES", 0)
    with pytest.raises(InputError, match="is a ZIP of 1 files, at most 0"):
        load_scene(path)


def test_an_entry_that_lies_about_its_size_is_damage(pack):
    path = pack({"a.obj": "0" * 100_000})
    data = path.read_bytes().replace((100_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    path.write_bytes(data)
    with pytest.raises(InputError, match="the file is damaged"):
        load_scene(path)


@pytest.mark.parametrize("seed", range(20))
def test_damage_is_an_input_error(pack, seed):
    path = pack(OBJ)
    random = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    if seed % 2:
        data = data[: random.integers(1, len(data))]
    else:
        for at in random.integers(0, len(data), 20):
            data[at] ^= int(random.integers(1, 256))
    path.write_bytes(bytes(data))
    with suppress(InputError):  # some bytes are of no consequence
        load_scene(path)
    gc.collect()
    assert unpacked(path) == []


def test_a_password_is_told(pack):
    path = pack({"a.obj": TRIANGLE})
    data = bytearray(path.read_bytes())
    for mark, offset in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        data[data.index(mark) + offset] |= 1
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="is protected by a password"):
        load_scene(path)


def test_a_link_is_no_way_out(pack, tmp_path):
    (tmp_path / "secret.mtl").write_text("newmtl paint\nKd 1 0 0\n")
    path = pack({"a/t.obj": TRIANGLE})
    link = zipfile.ZipInfo("a/m")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, str(tmp_path))
    scene = load_scene(path)
    assert all(not Path(file).is_symlink() for file in unpacked(path)[0].rglob("*"))
    assert "paint" not in scene.document.materials
