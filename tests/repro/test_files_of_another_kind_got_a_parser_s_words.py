"""Pages, pictures and archives under the names of meshes got the words of a parser; damage of an OBJ had no line."""

import gzip
import io
import zipfile

import numpy as np
import pytest
from PIL import Image

from aoprecalc.api import bake as api_bake
from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors
from fbx_text import FbxText
from gltf_kit.baked_by_hand import write_with_texture

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def picture():
    data = io.BytesIO()
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(data, "PNG")
    return data.getvalue()


def zipped(files):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return data.getvalue()


def fault(path):
    with pytest.raises(InputError) as failure:
        load_scene(path)
    return str(failure.value)


KINDS = {
    "is an HTML page, {} was expected; download the file itself": b"\n<!DOCTYPE html>\n<html><body>404</body></html>",
    "is an HTML page, {} was expected; download": b'<?xml version="1.0"?>\n<!-- a -->\n<html></html>',
    "is a PNG picture, {} was expected; name the mesh": picture(),
    "is a JPEG picture, {} was expected": b"\xff\xd8\xff\xe0\0\x10JFIF",
    "is a gzip archive, {} was expected; unpack it": gzip.compress(TRIANGLE.encode(), mtime=0),
    "is a 7z archive, {} was expected": b"7z\xbc\xaf\x27\x1c\0\4",
    "is a Blender file, {} was expected; export it as glTF there": b"BLENDER-v402",
    "is a Git LFS pointer, {} was expected; run `git lfs pull`": b"version https://git-lfs.github.com/spec/v1",
    "is an XML document of svg, {} was expected": b'<?xml version="1.0"?><!-- a --><svg/>',
    "is a JSON document, {} was expected": b'{"a": 1}',
    "its content is OBJ, {} was expected; rename it to .obj": TRIANGLE.encode(),
    "its content is ZIP, {} was expected; rename it to .zip": zipped({"a.obj": TRIANGLE}),
    "its content is FBX, {} was expected; rename it to .fbx": str(FbxText()).encode(),
}
FORMATS = {".obj": "OBJ", ".glb": "glTF", ".ply": "PLY", ".stl": "STL", ".off": "OFF", ".zip": "ZIP", ".3mf": "3MF"}


@pytest.mark.parametrize("kind", KINDS)
def test_they_are_named(tmp_path, kind):
    for extension, name in FORMATS.items():
        path = tmp_path / f"a{extension}"
        path.write_bytes(KINDS[kind])
        if f"content is {name}," not in kind:
            assert fault(path).startswith(f"{path}: {kind.format(name)}")


def test_text_under_the_name_of_a_zip(tmp_path):
    path = tmp_path / "a.zip"
    path.write_text("a licence")
    assert fault(path).startswith(f"{path}: it starts with 'a licence', a ZIP was expected; pack the mesh")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (f"# a\r\n\r\n{TRIANGLE}f 1 2 9\n", "line 10: a face refers to v 9, but there are 3"),
        (
            TRIANGLE.replace("v 0 1 0", "v 0 \\\n1 x"),
            "line 3: vertex (v) number 3 is '0  1 x', 3 numbers",
        ),
        (TRIANGLE.replace("vt 1 0", "vt \\\n 1 \\\n x"), "line 5: texture coordinate (vt) number 2 is"),
        (TRIANGLE.replace("v 1 0 0", "v \\\n1 0 0") + "f 1 x 2\n", "line 9: a face is '1 x 2', corners such as"),
    ],
)
def test_damage_of_an_obj_has_a_line(tmp_path, text, found):
    path = tmp_path / "a.obj"
    path.write_bytes(text.encode())
    assert fault(path).startswith(f"{path}: {found}")


@pytest.fixture
def packed(tmp_path):
    """An OBJ in a ZIP with a picture that is none."""
    path = tmp_path / "a.zip"
    text = TRIANGLE.replace("f ", "usemtl wood\nf ")
    library = "newmtl wood\nmap_Kd wood.png\nmap_d holes.png\n"
    path.write_bytes(zipped({"in/a.obj": f"mtllib a.mtl\n{text}", "in/a.mtl": library, "in/wood.png": "x"}))
    return path


def test_messages_show_the_paths_in_a_zip(packed, tmp_path):
    scene = load_scene(packed)
    _, warnings = base_colors(scene)
    *_, messages = write_with_texture(scene, tmp_path / "out" / "a_ao.glb")
    said = [*scene.warnings, *warnings, *messages]
    assert not [line for line in said if "aoprecalc-zip-" in line]
    assert any(str(packed / "in" / "wood.png") in line for line in warnings)
    assert any(str(packed / "in" / "wood.png") in line for line in messages)


def test_an_obj_of_a_zip_is_refused_before_the_bake(packed, tmp_path, monkeypatch):
    monkeypatch.setattr(api_bake, "bake_textures", None)  # calling it would fail
    with pytest.raises(UsageError, match=r"cannot refer to pictures in .*a\.zip; write a \.glb"):
        api_bake.bake_file(packed, tmp_path / "x.obj")
    assert not (tmp_path / "x.obj").exists()
