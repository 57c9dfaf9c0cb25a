"""The baked texture that an OBJ shows as map_Kd was taken for its colours by the next bake of that OBJ."""

import numpy as np
import pytest
from PIL import Image

from aoprecalc import BakeOptions
from aoprecalc.api.bake import bake_file
from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors, output_mesh_extension

BOX = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"


def bake(mesh, texture):
    bake_file(mesh, texture, options=BakeOptions(directions=32, size=16, backend="ray"))


@pytest.mark.parametrize("suffix", ["png", "tif", "tga"])
def test_a_bake_of_a_bake_is_one_bake(tmp_path, suffix):
    (tmp_path / "a.obj").write_text(BOX)
    first, second = tmp_path / f"a_ao.{suffix}", tmp_path / "again" / f"a_ao.{suffix}"
    bake(tmp_path / "a.obj", first)
    scene = load_scene(first.with_suffix(".obj"))
    (color,), warnings = base_colors(scene)
    assert (color.texture, warnings) == (None, ())
    assert output_mesh_extension(scene)[0] == ".obj"
    second.parent.mkdir()
    bake(first.with_suffix(".obj"), second)
    library = second.with_suffix(".mtl").read_text()
    assert library.count("map_K") == 1
    assert f"map_Kd {second.name}" in library
    assert second.read_bytes() == first.read_bytes()


def test_colours_stay_beside_a_second_bake(tmp_path):
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{BOX}")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd c.png\n")
    Image.fromarray(np.full((2, 2, 3), 90, np.uint8)).save(tmp_path / "c.png")
    first = tmp_path / "a_ao.png"
    bake(tmp_path / "a.obj", first)
    bake(first.with_suffix(".obj"), tmp_path / "b.png")
    library = (tmp_path / "b.mtl").read_text().split()
    assert library == ["newmtl", "a", "map_Kd", "c.png", "map_Ka", "b.png"]
