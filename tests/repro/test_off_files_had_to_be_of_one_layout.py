"""OFF without a line for its header alone, as in ModelNet40, was called damaged, and colours went without a word."""

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene

POINTS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)])
FACES = [(3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
VERTICES = ["{:g} {:g} {:g}".format(*point) for point in POINTS]
POLYGONS = [" ".join(map(str, [len(face), *face])) for face in FACES]
BODY = "\n".join([*VERTICES, *POLYGONS, ""])


def rows(of_vertex="", of_face=""):
    return "".join([*(f"{row}{of_vertex}\n" for row in VERTICES), *(f"{row}{of_face}\n" for row in POLYGONS)])


READ = {
    "plain": f"OFF\n5 5 0\n{BODY}",
    "glued": f"OFF5 5 0\n{BODY}",
    "on the header's line": f"OFF 5 5 0\n{BODY}",
    "no header": f"5 5 0\n{BODY}",
    "no number of edges": f"OFF\n5 5\n{BODY}",
    "counts on lines": f"OFF\n5\n5\n8\n{BODY}",
    "lower case": f"off\n5 5 0\n{BODY}",
    "windows": f"OFF\n5 5 0\n{BODY}".replace("\n", "\r\n"),
    "old mac": f"OFF\n5 5 0\n{BODY}".replace("\n", "\r"),
    "tabs and blanks": f"  OFF \n\t5  5\t0 \n{BODY}".replace(" ", "  "),
    "byte order mark": f"\ufeffOFF\n5 5 0\n{BODY}",
    "comments": "# first\nOFF # a kind\n# 9 9 9\n5 5 0 # counts\n\n"
    + "\n\n# between\n".join(f"{line} # 1 2 3" for line in BODY.splitlines()),
    "no end of line": f"OFF\n5 5 0\n{BODY}".rstrip("\n"),
    "all on one line": f"OFF 5 5 0 {' '.join(BODY.split())}",
    "lines that break anywhere": "OFF\n5 5 0\n" + "\n".join(BODY.split()),
    "homogeneous": f"4OFF\n5 5 0\n{''.join(f'{2 * x} {2 * y} {2 * z} 2' + chr(10) for x, y, z in POINTS)}"
    + "\n".join(POLYGONS),
    "of a dimension": f"nOFF 3\n5 5 0\n{BODY}",
    "normals": f"NOFF\n5 5 0\n{rows(' 0 0 1')}",
    "normals and UVs": f"STNOFF\n5 5 0\n{rows(' 0 0 1 0.25 0.75')}",
}


@pytest.mark.parametrize("layout", READ)
def test_it_is_read_without_a_word(tmp_path, layout):
    path = tmp_path / "a.off"
    path.write_bytes(READ[layout].encode())
    scene = load_scene(path)
    assert scene.positions.tolist() == POINTS.tolist()
    assert (len(scene.faces), scene.warnings, scene.notes) == (6, (), ())
    assert (scene.normals is not None) == ("normals" in layout)
    assert (scene.uvs is not None) == ("UVs" in layout)
    assert scene.uvs is None or (scene.uvs == (0.25, 0.75)).all()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (f"COFF\n5 5 0\n{rows(' 255 0 0 255')}", "vertices"),
        (f"OFF\n5 5 0\n{rows(' 0.5 0.5 0.5')}", "vertices"),
        (f"OFF\n5 5 0\n{rows('', ' 255 0 0')}", "faces"),
        (f"OFF\n5 5 0\n{rows('', ' 3')}", "faces"),
        (f"STCNOFF\n5 5 0\n{rows(' 0 0 1 9 9 9 255 0.25 0.75', ' 0.5 0.5 0.5 1')}", "vertices and faces"),
    ],
)
def test_colours_are_told_to_be_left_out(tmp_path, text, what):
    path = tmp_path / "a.off"
    path.write_text(text)
    scene = load_scene(path)
    assert [f"the colours of its {what} are left out" in line for line in scene.warnings] == [True]
    assert len(scene.faces) == 6
    assert "ST" not in text[:7] or (scene.uvs == (0.25, 0.75)).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"OFF\n5 6 0\n{BODY}", "promises 5 vertices and 6 faces, but has 10 lines"),
        (f"OFF\n5 4 0\n{BODY}", "promises 5 vertices and 4 faces, but has 10 lines"),
        (f"OFF\n6 5 0\n{BODY}", "promises 6 vertices and 5 faces, but has 10 lines"),
        (f"OFF\n4 6 0\n{BODY}", "face 0 is '0.5 0.5 1'"),
        (f"OFF\n6 4 0\n{BODY}", "vertex 5 is '4 3 2 1 0', 3 numbers were expected; it promises 6 vertices and 4 faces"),
        (f"OFF 5 5 0\n{BODY}".replace("1 1 0\n", "1 1\n"), "vertex 2 is '1 1', 3 numbers were expected"),
        (f"OFF 5 5 0\n{BODY}".replace("1 1 0\n", "1 one 0\n"), "vertex 2 is '1 one 0', 3 numbers were expected"),
        (f"OFF 5 5 0\n{BODY}".replace("3 0 1 4", "3 0 1"), "face 1 is '3 0 1', the number of its corners"),
        (f"OFF 5 5 0\n{BODY}".replace("3 0 1 4", "-3 0 1 4"), "face 1 is '-3 0 1 4'"),
        ("OFF BINARY\n\0\0\0\5", "is a binary OFF"),
        (f"4nOFF 5\n5 5 0\n{BODY}", "is an OFF of dimension 5"),
        ("OFFICE hours\n", "OFF and its counts were expected"),
        ("", "is empty"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, said):
    path = tmp_path / "a.off"
    path.write_text(text)
    with pytest.raises(InputError) as failure:
        load_scene(path)
    assert said in str(failure.value)
    assert "\n" not in str(failure.value)


def test_faces_of_two_corners_are_told(tmp_path):
    for name, text in (
        ("a.off", f"OFF\n5 6 0\n{BODY}2 0 1\n"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face 6\nproperty list int int vertex_indices\nend_header\n{BODY}2 0 1\n",
        ),
    ):
        path = tmp_path / name
        path.write_text(text)
        assert load_scene(path).warnings == ("1 face of fewer than 3 corners is skipped",)
