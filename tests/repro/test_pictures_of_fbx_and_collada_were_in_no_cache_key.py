"""FBX and COLLADA counted as unchanged whatever their pictures became; a .zae mixed up pictures of one base name."""

import io
import zipfile

import numpy as np
import pytest
from PIL import Image

from aoprecalc import BakeOptions
from aoprecalc.io import input_files, load_scene
from aoprecalc.io.meshes import base_colors
from aoprecalc.pipeline import batch
from collada_text import document, textured
from fbx_text import FbxText

QUAD, UVS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [(0, 0), (1, 0), (1, 1), (0, 1)]


def png(opacity, color=(255, 255, 255)):
    pixels = np.full((4, 4, 4), (*color, 255), np.uint8)
    pixels[:, 2:, 3] = opacity
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    return data.getvalue()


def fbx(slot="TransparentColor"):
    scene = FbxText()
    leaf = scene.material("leaf")
    scene.texture("textures/holes.png", leaf, slot)
    scene.node("sheet", scene.mesh(QUAD, [[0, 1, 2, 3]], uv_sets=[("map", UVS)], materials=[0]), materials=(leaf,))
    return str(scene)


def dae():
    text = document(f"<transparent opaque='A_ONE'>{textured('holes')}</transparent>")
    return text.replace(">holes.png<", "> textures/holes.png <")


@pytest.mark.parametrize(("name", "package"), [("a.fbx", "ufbx"), ("a.dae", "collada")])
def test_a_changed_picture_bakes_again(tmp_path, name, package):
    pytest.importorskip(package)
    picture = tmp_path / "textures" / "holes.png"
    picture.parent.mkdir()
    (tmp_path / name).write_text(fbx() if name == "a.fbx" else dae())

    def make():
        made = batch(tmp_path / name, tmp_path / "out", bake=BakeOptions(size=16, directions=64, backend="ray"))
        return [entry.status for entry in made.results]

    picture.write_bytes(png(opacity=0))
    assert picture in input_files(tmp_path / name, (tmp_path / name).read_bytes())
    assert [make(), make()] == [["made"], ["unchanged"]]
    picture.write_bytes(png(opacity=255, color=(0, 0, 0)))
    assert make() == ["made"]


@pytest.mark.parametrize("key", [b"FileName", b"Filename", b"RelativeFilename"])
def test_binary_fbx_names_its_pictures(tmp_path, key):
    name = "bläck & white.png".encode()
    node = bytes([len(key)]) + key + b"S" + len(name).to_bytes(4, "little") + name
    other = b"\x11Original|FileNameS\x07\0\0\0KString"
    data = b"Kaydara FBX Binary  \0\x1a\0" + other + node + b"\0" * 13
    assert input_files(tmp_path / "a.fbx", data) == [tmp_path / "a.fbx", tmp_path / "bläck & white.png"]


def test_names_in_collada_are_of_its_images_alone(tmp_path):
    text = document().replace(">color.png<", "><ref>a%20b/&#228;&amp;.png</ref><").encode()
    assert input_files(tmp_path / "a.dae", text)[1:] == [tmp_path / "a%20b/ä&.png", tmp_path / "holes.png"]


@pytest.mark.parametrize("named", ["one/wood.png", "two/wood.png", "../other/wood.png"])
def test_pictures_of_one_name_in_an_archive_stay_apart(tmp_path, named):
    pytest.importorskip("collada")
    colors = {"one": (255, 0, 0), "two": (0, 255, 0), "../other": (0, 0, 255)}
    text = document(f"<diffuse>{textured('color')}</diffuse>").replace(">color.png<", f">{named}<")
    with zipfile.ZipFile(tmp_path / "a.zae", "w") as files:
        files.writestr("scene/a.dae", text)
        for folder, color in colors.items():
            files.writestr(f"scene/{folder}/wood.png".replace("scene/../", ""), png(255, color))
    (color,), warnings = base_colors(load_scene(tmp_path / "a.zae"))
    assert (color.texture[0, 0].tolist(), warnings) == (list(colors[named.rpartition("/")[0]]), ())
    inside = [tmp_path / "a.zae", tmp_path / "holes.png"]
    assert input_files(tmp_path / "a.zae", (tmp_path / "a.zae").read_bytes()) == inside
