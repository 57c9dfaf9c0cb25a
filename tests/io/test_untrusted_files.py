"""What files from strangers must not do: reach other files, servers or devices, or fill the memory."""

import json
import os
import struct
import sys
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

import pytest
import trimesh
from PIL import Image

from aoprecalc import SphereOptions, fit_spheres
from aoprecalc.errors import InputError
from aoprecalc.io import load_scene, source_files
from aoprecalc.io.formats.files import file_beside, read_file
from aoprecalc.io.formats.gltf.document import local_file
from aoprecalc.io.images import MAX_SIDE, read_pixels
from aoprecalc.io.meshes import input_files
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS, read_spheres
from aoprecalc.pipeline.state import FileStamp, StateFolder
from gltf_kit.gltf_maker import TRIANGLE, textured_triangle

FACE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = """ply
format ascii 1.0
comment TextureFile {}
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


def files_of(path):
    """The files that a mesh refers to, by its reader and, before it is read, by a search."""
    itself, *others = input_files(path, path.read_bytes())
    assert source_files(load_scene(path)) == [itself, *others]
    return others


def save(folder, document):
    folder.mkdir(exist_ok=True)
    (folder / "a.gltf").write_text(json.dumps(document), encoding="utf-8")
    return folder / "a.gltf"


REMOTE = ["//server/a.png", r"\\server\a.png", "%5C%5Cserver%5Ca.png", "http://server/a.png", "data:image/png;base64,"]
WRONG = ["a%00.png", "a\0.png", "\ud800.png", "http://[", "//["]
ABSOLUTE = ["/etc/passwd", "%2Fetc%2Fpasswd", "C:/a.png", "C%3A/a.png", "file:///etc/passwd"]


@pytest.mark.parametrize("uri", [*REMOTE, *ABSOLUTE, *WRONG], ids=ascii)
def test_a_uri_that_is_not_relative_names_no_file(uri):
    assert local_file(Path("in/a.gltf"), uri) is None


@pytest.mark.parametrize(("uri", "file"), [("a.png", "in/a.png"), ("../b%20c.png", "in/../b c.png"), ("d/e", "in/d/e")])
def test_a_relative_uri_names_a_file(uri, file):
    assert local_file(Path("in/a.gltf"), uri) == Path(file)


def test_a_buffer_at_an_absolute_path_is_refused(tmp_path):
    (tmp_path / "a.bin").write_bytes(TRIANGLE)
    path = save(tmp_path, textured_triangle(buffers=[{"byteLength": 36, "uri": (tmp_path / "a.bin").as_posix()}]))
    with pytest.raises(InputError, match="a file beside it was expected"):
        load_scene(path)


def test_no_connection_is_opened(tmp_path, monkeypatch):
    def refuse(*arguments, **given):
        raise AssertionError("a connection was opened")

    monkeypatch.setattr("socket.socket", refuse)
    assert load_scene(save(tmp_path, textured_triangle(images=[{"uri": "http://127.0.0.1/a.png"}]))).faces.shape == (
        1,
        3,
    )


SERVERS = [
    *("".join((a, b, "server", a, "share", a, "a.mtl")) for a in "/\\" for b in "/\\"),
    r"\??\UNC\server\s\a.mtl",
]


@pytest.mark.parametrize("name", [*SERVERS, "//server", r"\\.\COM1", "//?/C:/a.mtl", "a\0.mtl"], ids=ascii)
def test_the_name_of_a_server_or_device_of_windows_names_no_file(name):
    assert file_beside(Path("in"), name) is None


@pytest.mark.parametrize(
    "name", ["a.mtl", "../b/a.mtl", "/home/a.mtl", "a//b.mtl", r"a\b.mtl", "\udce9.mtl", "C:/a.mtl"]
)
def test_any_other_path_names_a_file(name):
    assert file_beside(Path("in"), name) == Path("in") / name


@pytest.mark.parametrize("name", SERVERS)
def test_no_mesh_has_files_on_servers(name, tmp_path):
    image = name.replace(".mtl", ".png")
    (tmp_path / "a.mtl").write_text(f"newmtl a\nmap_Kd {image}\nmap_Ka {image}\n", encoding="utf-8")
    (tmp_path / "a.obj").write_text(f"mtllib {name}\nmtllib a.mtl\nusemtl a\n{FACE}", encoding="utf-8")
    (tmp_path / "a.ply").write_text(PLY.format(image), encoding="utf-8")
    assert files_of(tmp_path / "a.obj") == [tmp_path / "a.mtl"]
    assert files_of(tmp_path / "a.ply") == []


def test_an_obj_names_textures_by_absolute_paths_too(tmp_path):
    image = tmp_path / "elsewhere" / "a.png"
    (tmp_path / "a.mtl").write_text(f"newmtl a\nmap_Kd {image}\n", encoding="utf-8")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\nusemtl a\n{FACE}", encoding="utf-8")
    assert files_of(tmp_path / "a.obj") == [tmp_path / "a.mtl", image]


def test_folders_devices_and_pipes_are_not_read(tmp_path):
    paths = [tmp_path]
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        paths.append(tmp_path / "pipe")
    for path in paths:
        with pytest.raises(OSError, match="not a regular file"):
            read_file(path)
        assert FileStamp.of(path) == FileStamp(-1, None, "")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero")
def test_a_device_with_no_end_is_no_material_library(tmp_path):
    assert FileStamp.of(Path("/dev/zero")) == FileStamp(-1, None, "")
    (tmp_path / "a.obj").write_text(f"mtllib /dev/zero\n{FACE}", encoding="utf-8")
    assert len(load_scene(tmp_path / "a.obj").faces) == 1


def png_of_zeros(path, width, height):
    """Write a PNG of one bit a pixel, all black, which is small whatever its size."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes((width // 8 + 2) * height), 1)
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    return path


def test_an_image_beyond_any_texture_is_refused_before_it_is_decoded(tmp_path):
    path = png_of_zeros(tmp_path / "a.png", MAX_SIDE + 1, 8)
    with pytest.raises(InputError, match="has 32769 x 8 pixels, at most 32,768 a side were expected"):
        read_pixels(path)
    assert read_pixels(png_of_zeros(tmp_path / "b.png", MAX_SIDE, 1)).shape[:2] == (1, MAX_SIDE)


def test_a_zip_that_would_fill_the_memory_is_refused_before_it_is_unpacked(tmp_path):
    pytest.importorskip("lxml")
    with zipfile.ZipFile(tmp_path / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b" " * 1000)
    data = (tmp_path / "a.3mf").read_bytes()
    size, huge = struct.pack("<I", 1000), struct.pack("<I", 2**32 - 2)
    (tmp_path / "a.3mf").write_bytes(data.replace(size, huge))
    with pytest.raises(InputError, match=r"is a ZIP of 4\.0 GiB when unpacked, at most 1 GiB were expected"):
        load_scene(tmp_path / "a.3mf")


@pytest.mark.parametrize("extension", SPHERE_EXTENSIONS)
def test_bytes_that_are_no_text_are_no_fault_of_ours(extension, tmp_path):
    path = tmp_path / f"a{extension}"
    fit_spheres(trimesh.creation.icosphere(1), SphereOptions(4, samples=300)).save(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + b"\x80\xff" + data[len(data) // 2 + 2 :])
    with suppress(InputError):  # the damage may be where nobody looks
        read_spheres(path)


ENTITIES = (
    '<!DOCTYPE a [<!ENTITY a0 "ha">' + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10)) + "]>"
)
COLLADA = '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">{}</COLLADA>'


def test_entities_are_not_expanded_without_end(tmp_path):
    pytest.importorskip("collada")
    (tmp_path / "a.dae").write_text(
        ENTITIES + COLLADA.format("<asset><created>&a9;</created></asset>"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="cannot be read as COLLADA"):
        load_scene(tmp_path / "a.dae")


def test_entities_name_no_files(tmp_path):
    pytest.importorskip("collada")
    (tmp_path / "secret.txt").write_text("secret", encoding="utf-8")
    entity = f'<!DOCTYPE a [<!ENTITY x SYSTEM "{(tmp_path / "secret.txt").as_uri()}">]>'
    (tmp_path / "a.dae").write_text(entity + COLLADA.format("<asset><created>&x;</created></asset>"), encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_scene(tmp_path / "a.dae")
    assert "secret" not in str(error.value).replace("secret.txt", "")


def test_a_record_of_a_batch_names_no_files_elsewhere(tmp_path):
    stamp = {"size": 1, "times": None, "digest": ""}
    record = {"schema": 2, "order": "", "inputs": {"files": {}}, "outputs": {"a.png": stamp}, "summary": {}}
    folder = tmp_path / "out"
    file = folder / ".aoprecalc" / "assets" / "a.asset.json"
    file.parent.mkdir(parents=True)
    found = []
    for name in ("a.png", "../a.png", "/a.png", "b/a.png"):
        record["outputs"] = {name: stamp}
        file.write_text(json.dumps(record), encoding="utf-8")
        found.append(StateFolder(folder).get("a") is not None)
    assert found == [True, False, False, False]


def test_names_in_files_do_not_steer_the_terminal(tmp_path, command):
    Image.new("L", (4, 4)).save(tmp_path / "t.png")
    (tmp_path / "a.mtl").write_text("newmtl \x1b[2Jname\nmap_Kd t.png\n", encoding="utf-8")
    text = f"mtllib a.mtl\nusemtl \x1b[2Jname\nvt 1 1\n{FACE.replace('1 2 3', '1/1 2/1 3/1')}"
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    done = command("bake", tmp_path / "a.obj", "-o", f"{tmp_path}/out/", "--size", "16", "-n", "64", "--backend", "ray")
    assert "[2Jname" in done.stderr
    assert "\x1b" not in done.stdout + done.stderr


def test_keys_of_reports_do_not_steer_the_terminal(tmp_path, command):
    for name, value in (("a", 1), ("b", 2)):
        report = {"schema": 1, "bell\x07": {"escape\x9b2J\nline": value}, "is\x9b": f"\x07{value}"}
        (tmp_path / f"{name}.json").write_text(json.dumps(report), encoding="utf-8")
    for words in ((), ("--json",)):
        said = command("compare", tmp_path / "a.json", tmp_path / "b.json", *words).stdout
        assert "2Jline" in said.replace("?", "").replace(r"\n", "")
        assert not set(said) & {"\x07", "\x9b"}
    assert json.loads(said)["details"]["differing"] == 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such file names")
def test_names_of_pictures_and_meshes_do_not_steer_the_terminal(tmp_path, command):
    Image.new("RGB", (4, 4)).save(tmp_path / "bell\x07.png")
    mesh = save(tmp_path, textured_triangle(images=[{"uri": "bell%07.png"}]))
    mesh.rename(tmp_path / "csi\x9b.gltf")
    options = ("-o", f"{tmp_path}/out/", "--size", "16", "-n", "64", "--backend", "ray")
    said = command("bake", tmp_path / "csi\x9b.gltf", *options).stdout
    assert "csi?" in said
    assert "bell?.png" in said
    assert not set(said) & {"\x07", "\x9b"}


@pytest.mark.parametrize("images", [5, {}, [1.5], [None], [{"uri": 5}], [{"uri": ["a.png"]}]], ids=repr)
def test_lists_of_images_of_another_type_are_damage(images, tmp_path, command):
    path = save(tmp_path, textured_triangle(images=images))
    done = command("bake", path, "-o", f"{tmp_path}/out/", "--size", "32", "-n", "64", "--backend", "ray")
    assert done.returncode == 4
    assert "a list of images, each with a text as URI if any, was expected" in done.stderr
