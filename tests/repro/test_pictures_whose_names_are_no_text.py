"""A picture whose name is Latin-1 on the disk was not read: OpenImageIO takes text alone."""

import os
import sys

import numpy as np
import pytest
from PIL import Image

from aoprecalc.io import load_scene
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import channel_count, is_baked, read_pixels, write_image
from aoprecalc.io.meshes import base_colors
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
    write_image(folder / "baked.png", np.ones((2, 2), np.float32), text="{}")
    os.rename(folder / "baked.png", file)
    assert is_baked(file)


@pytest.mark.parametrize("name", ["a_ao.glb", "a_ao.gltf", "a_ao.obj"])
def test_they_reach_what_is_written(folder, name):
    (folder / "a.mtl").write_bytes(b"newmtl wood\nmap_Kd " + os.fsencode(NAME) + b"\n")
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{TRIANGLE}")
    scene = load_scene(folder / "a.obj")
    path, *_ = write_with_texture(scene, folder / "out" / name, "keep")
    (color,), warnings = base_colors(load_scene(path))
    assert warnings == ()
    assert np.array_equal(color.texture, PIXELS)
