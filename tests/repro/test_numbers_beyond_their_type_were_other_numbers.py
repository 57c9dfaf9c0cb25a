"""A vertex of 99999999999 in an ASCII PLY or an OFF became another one, or was called a fault of the reader."""

import pytest

import aoprecalc as ao
from aoprecalc.errors import InputError
from aoprecalc.io import load_scene

PLY = """ply
format ascii 1.0
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
3 0 1 {}
"""
OFF = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {}\n"


@pytest.mark.parametrize("number", ["99999999999", "-99999999999", "nan", "1e300"])
def test_a_ply_tells_the_element_and_the_type(tmp_path, number):
    (tmp_path / "a.ply").write_text(PLY.format(number))
    with pytest.raises(InputError, match=r"'face' has a number that is no int"):
        load_scene(tmp_path / "a.ply")


@pytest.mark.parametrize("number", ["9" * 23, "-" + "9" * 23])
def test_an_off_tells_the_face(tmp_path, number):
    (tmp_path / "a.off").write_text(OFF.format(number))
    with pytest.raises(InputError, match=rf"face 0 is '3 0 1 {number}'"):
        load_scene(tmp_path / "a.off")


def test_the_lists_of_a_first_face_without_corners_are_kept(tmp_path):
    """Its number of corners was divided by."""
    lists = "vertex_indices\nproperty list uchar int w\n"
    rows = PLY.replace("element face 1", "element face 2").replace("vertex_indices\n", lists)
    (tmp_path / "a.ply").write_text(rows.replace("3 0 1 {}\n", "0 0\n3 0 1 2 3 7 8 9\n"))
    ao.bake(tmp_path / "a.ply", ao.BakeOptions(size=32, directions=64, backend="ray")).save(tmp_path / "b.ply")
    assert load_scene(tmp_path / "b.ply").document.face_lists["w"].values.tolist() == [7, 8, 9]
