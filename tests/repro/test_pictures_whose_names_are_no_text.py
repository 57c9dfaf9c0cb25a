"""A picture whose name is Latin-1 on the disk was not read: OpenImageIO takes text alone."""

import os
import sys

import numpy as np
import pytest
from PIL import Image

from aoprecalc import BakeOptions, PreviewOptions, preview
from aoprecalc.api.bake import bake_file
from aoprecalc.errors import OutputError
from aoprecalc.io import load_scene
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import channel_count, is_baked, read_pixels, write_image
from aoprecalc.io.meshes import base_colors
from aoprecalc.io.outputs import read_json_object
from gltf_kit.baked_by_hand import write_with_texture

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names of files are text there")

NAME = os.fsdecode(b"st\xfchle.png")
PIXELS = np.dstack([np.full((2, 3), 40 * c + 20, np.uint8) for c in range(3)])
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n"


@pytest.fixture
def folder(tmp_path):
    with open(tmp_path / NAME, "wb") as file:
        Image.fromarray(PIXELS).save(file, "PNG")
    return tmp_path


def test_they_are_images(folder):
    file = folder / NAME
    assert read_pixels(file) * 255 == pytest.approx(PIXELS)
    assert ImageSource.of(file).opacity("green") == pytest.approx(np.full((2, 3), 60 / 255))
    assert (channel_count(file), is_baked(file)) == (3, False)
    write_image(file, np.ones((2, 2), np.float32), text="{}")
    assert is_baked(file)


def test_they_are_written(folder):
    values = np.linspace(0, 1, 4, dtype=np.float32).reshape(2, 2)
    for suffix in (".png", ".exr"):
        file = (folder / NAME).with_suffix(suffix)
        write_image(file, values)
        write_image(folder / f"plain{suffix}", values)
        assert file.read_bytes() == (folder / f"plain{suffix}").read_bytes()
    with pytest.raises(OutputError, match="cannot be written"):
        write_image(folder / "none" / NAME, values)


def test_a_bake_in_such_a_folder_has_such_names(folder):
    inside = folder / os.fsdecode(b"m\xf6bel")
    inside.mkdir()
    (inside / NAME).with_suffix(".obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh, options = (inside / NAME).with_suffix(".obj"), BakeOptions(size=32, directions=64)
    done = bake_file(mesh, f"{inside}/", report=inside / "report.json", options=options)
    assert read_json_object(inside / "report.json")["outputs"]["texture"] == str(done.files.texture)
    assert read_pixels(done.files.texture).shape == (32, 32, 1)
    picture = (inside / NAME).with_suffix(".jpg")
    preview(done.files.mesh, PreviewOptions(size=(40, 30))).save(picture)
    assert read_pixels(picture).shape == (30, 40, 3)


@pytest.mark.parametrize("name", ["a_ao.glb", "a_ao.gltf", "a_ao.obj"])
def test_they_reach_what_is_written(folder, name):
    (folder / "a.mtl").write_bytes(b"newmtl wood\nmap_Kd " + os.fsencode(NAME) + b"\n")
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{TRIANGLE}")
    scene = load_scene(folder / "a.obj")
    path, *_ = write_with_texture(scene, folder / "out" / name, "keep")
    (color,), warnings = base_colors(load_scene(path))
    assert warnings == ()
    assert np.array_equal(color.texture, PIXELS)
