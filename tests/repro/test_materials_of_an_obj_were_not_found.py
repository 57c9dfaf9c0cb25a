"""Libraries and pictures whose names were not those of one file in the folder of the OBJ were lost without a word."""

import numpy as np
import pytest
from PIL import Image

from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n"
CASES = {
    "two libraries in one line": ("mtllib metal.mtl wood.mtl", "wood.mtl", "wood.png", "wood.png"),
    "blanks in the name": ("mtllib my wood.mtl", "my wood.mtl", "my wood.png", "my wood.png"),
    "blanks at the ends": ("mtllib \t wood.mtl  ", "wood.mtl", "wood.png  ", "wood.png"),
    "quotes": ('mtllib "my wood.mtl"', "my wood.mtl", '"my wood.png"', "my wood.png"),
    "backslashes": ("mtllib lib\\wood.mtl", "lib/wood.mtl", "..\\maps\\wood.png", "maps/wood.png"),
    "two backslashes": ("mtllib lib\\\\wood.mtl", "lib/wood.mtl", "maps\\\\wood.png", "lib/maps/wood.png"),
    "other capitals": ("mtllib Wood.MTL", "wood.mtl", "MAPS/wood.png", "maps/Wood.PNG"),
    "picture beside the library": ("mtllib lib/wood.mtl", "lib/wood.mtl", "wood.png", "lib/wood.png"),
    "picture beside the mesh": ("mtllib lib/wood.mtl", "lib/wood.mtl", "wood.png", "wood.png"),
    "absolute": ("mtllib C:\\me\\wood.mtl", "wood.mtl", "D:\\art\\maps\\wood.png", "wood.png"),
    "renamed with its mesh": ("mtllib old.mtl", "made.mtl", "wood.png", "wood.png"),
    "no statement": ("", "made.mtl", "wood.png", "wood.png"),
    "options": ("mtllib wood.mtl", "wood.mtl", "-blendu on -o .5 0 0 -s 1 1 1 -bm 1 my wood.png", "my wood.png"),
    "options of one number": ("mtllib wood.mtl", "wood.mtl", "-s 2 -o 1 -mm 0 1 -clamp off wood.png", "wood.png"),
    "name like an option": ("mtllib wood.mtl", "wood.mtl", "-wood-.png", "-wood-.png"),
    "Latin-1": ("mtllib h\xf6lz.mtl", "h\xf6lz.mtl", "h\xf6lz.png", "h\xf6lz.png"),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("case", CASES)
def test_the_picture_is_found(tmp_path, case, ends, encoding):
    statement, library, written, picture = CASES[case]
    for name in (library, picture):
        (tmp_path / name).parent.mkdir(exist_ok=True)
    color = (10, 200, 30)
    Image.new("RGB", (2, 2), color).save(tmp_path / picture)

    def save(name, text):
        (tmp_path / name).write_bytes(text.replace("\n", ends).encode(encoding))

    save("metal.mtl", "newmtl metal\nKd 0 0 1\n")
    save(library, f"newmtl wood\nKd 1 1 1\n\tMAP_kd {written}\n")
    save("made.obj", f"{statement}\n{TRIANGLE}")
    scene = load_scene(tmp_path / "made.obj")
    (base_color,), warnings = base_colors(scene)
    assert np.array_equal(base_color.texture[0, 0], color)
    assert (warnings, scene.warnings, scene.notes) == ((), (), ())


def test_a_library_that_is_not_there_is_told(tmp_path):
    (tmp_path / "made.obj").write_text(f"mtllib gone.mtl\n{TRIANGLE}")
    scene = load_scene(tmp_path / "made.obj")
    assert scene.notes == ("1 material has no colours or pictures, such as 'wood': gone.mtl is not there",)
