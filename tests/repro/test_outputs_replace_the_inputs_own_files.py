"""A .bin or .mtl that goes with an output took the place of the one that the input was read from."""

import pytest

from aoprecalc.errors import UsageError
from aoprecalc.io import Outputs, load_scene, source_files
from shapes import box


def write_box(folder):
    positions, faces = box()
    text = "mtllib paint.mtl\nusemtl red\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in positions)
    (folder / "box.obj").write_text(text + "".join("f {} {} {}\n".format(*(face + 1)) for face in faces))
    (folder / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n")
    return folder / "box.obj"


@pytest.mark.parametrize("name", ["box.obj", "paint.mtl", "./paint.mtl", "link.mtl"])
def test_files_of_the_input_are_refused(tmp_path, name):
    scene = load_scene(write_box(tmp_path))
    (tmp_path / "link.mtl").symlink_to(tmp_path / "paint.mtl")
    before = (tmp_path / "paint.mtl").read_bytes()
    with Outputs() as outputs:
        outputs.protect(source_files(scene))
        with pytest.raises(UsageError, match="belongs to the input"):
            outputs.path(tmp_path / name)
    assert (tmp_path / "paint.mtl").read_bytes() == before


def test_two_outputs_of_one_name_are_refused(tmp_path):
    with Outputs() as outputs:
        outputs.claim(tmp_path / "a.png")
        with pytest.raises(UsageError, match="two outputs"):
            outputs.claim(tmp_path / "." / "a.png")
        outputs.path(tmp_path / "a.png").write_text("once")
        with pytest.raises(UsageError, match="two outputs"):
            outputs.path(tmp_path / "b" / ".." / "a.png")
    assert (tmp_path / "a.png").read_text() == "once"
