"""PLY, STL and OFF."""

import struct

import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene

HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def volume(scene):
    return trimesh.Trimesh(scene.positions, scene.faces, process=False).volume


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_of_trimesh(cube, tmp_path, encoding):
    points, _, _, triangles = cube
    path = tmp_path / "cube.ply"
    path.write_bytes(trimesh.Trimesh(points, triangles, process=False).export(file_type="ply", encoding=encoding))
    scene = load_scene(path)
    assert np.array_equal(scene.corners, points[triangles])
    assert len(scene.positions) == 8


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_mixes_polygons_and_other_properties(save, cube, order):
    points, quads, _, _ = cube
    kind = {"<": "little", ">": "big"}[order]
    head = (
        f"ply\nformat binary_{kind}_endian 1.0\ncomment mixed\nelement vertex 8\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nelement face 7\nproperty uchar flag\n"
        "property list uchar int vertex_index\nproperty float quality\nend_header\n"
    )
    body = b"".join(struct.pack(order + "dddB", *point, 7) for point in points)
    faces = [*quads[:5].tolist(), quads[5][[0, 1, 2]].tolist(), quads[5][[0, 2, 3]].tolist()]
    for face in faces:
        body += struct.pack(f"{order}BB{len(face)}if", 1, len(face), *face, 0.5)
    scene = load_scene(save("cube.ply", head.encode() + body))
    assert volume(scene) == pytest.approx(8)


def test_ply_strips_wind_alternately(save):
    text = HEAD + "element tristrips 1\nproperty list int int vertex_indices\nend_header\n" + SQUARE + "4 0 1 3 2\n"
    scene = load_scene(save("strip.ply", text))
    edges = scene.corners[:, 1:] - scene.corners[:, :1]
    assert np.cross(edges[:, 0], edges[:, 1])[:, 2].tolist() == [1, 1]


def test_ply_uvs_and_normals_of_vertices(save):
    text = (
        HEAD + "property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [f"{row} 0 0 2 {index / 4} 0.5\n" for index, row in enumerate(SQUARE.splitlines())]
    scene = load_scene(save("a.ply", text + "".join(rows) + "4 0 1 2 3\n"))
    assert scene.uvs.tolist() == [[[0, 0.5], [0.25, 0.5], [0.5, 0.5]], [[0, 0.5], [0.5, 0.5], [0.75, 0.5]]]
    assert np.array_equal(scene.normals, np.broadcast_to([0, 0, 1], (2, 3, 3)))


def test_ply_quads_alone(save):
    assert load_scene(save("a.ply", QUADS + b"tail")).parts[0].vertices.tolist() == [
        [0, 1, 2],
        [0, 2, 3],
        [3, 2, 1],
        [3, 1, 0],
    ]


def test_ply_comments_of_any_letters_and_windows_lines(save):
    text = HEAD.replace("1.0\n", "1.0\ncomment TextureFile über.png\n") + FACE + SQUARE + "4 0 1 2 3\n"
    assert len(load_scene(save("a.ply", text.replace("\n", "\r\n"))).faces) == 2


def test_ply_empty_polygons_are_left_out(save):
    scene = load_scene(save("a.ply", HEAD + FACE.replace("face 1", "face 2") + SQUARE + "0\n3 0 1 2\n"))
    assert len(scene.faces) == 1


def test_ply_uvs_of_face_corners(save):
    text = (
        HEAD + "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
        "end_header\n" + SQUARE + "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 .5 .5 0 1 1 0\n"
    )
    scene = load_scene(save("a.ply", text))
    assert scene.uvs.tolist() == [[[0, 0], [1, 0], [1, 1]], [[0.5, 0.5], [0, 1], [1, 0]]]


def test_stl_binary_and_ascii_are_welded(cube, tmp_path):
    points, _, _, triangles = cube
    mesh = trimesh.Trimesh(points, triangles, process=False)
    for kind in ("stl", "stl_ascii"):
        path = tmp_path / f"{kind}.stl"
        content = mesh.export(file_type=kind)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        scene = load_scene(path)
        assert len(scene.positions) == 8
        assert volume(scene) == pytest.approx(8)
        assert scene.normals is None
        assert scene.uvs is None


def test_stl_with_bytes_after_its_last_face(cube, save):
    points, _, _, triangles = cube
    data = trimesh.Trimesh(points, triangles, process=False).export(file_type="stl")
    scene = load_scene(save("a.stl", data + b"tail"))
    assert len(scene.faces) == 12
    assert scene.warnings == ("after the last face 4 bytes ignored",)


def test_stl_solids_become_parts(save):
    scene = load_scene(save("a.stl", SOLID.replace(" x\n", " Left wing\n") + SOLID.replace(" x\n", "\n")))
    assert [(part.name, part.start, part.stop) for part in scene.parts] == [("Left wing", 0, 1), ("mesh", 1, 2)]


def test_stl_normals_that_are_no_numbers_do_no_harm(save, capfd):
    scene = load_scene(save("a.stl", SOLID.replace("normal 0 0 1", "normal x y z")))
    assert scene.corners.tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]
    assert capfd.readouterr() == ("", "")


def test_off_mixes_polygons_colours_and_comments(save, cube):
    points, quads, _, _ = cube
    rows = ["OFF # the kind", "8 7 0", "# points", *(f"{x} {y} {z}" for x, y, z in points), ""]
    rows += [f"4 {a} {b} {c} {d} 255 0 0" for a, b, c, d in quads[:5]]
    rows += [f"3 {a} {b} {c}" for a, b, c in (quads[5][[0, 1, 2]], quads[5][[0, 2, 3]])]
    assert volume(load_scene(save("a.off", "\n".join(rows)))) == pytest.approx(8)


STL = b"\0" * 80 + struct.pack("<I", 3) + b"\0" * 50
SOLID = (
    "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid x\n"
)
LONG = "9" * 15
BINARY = "ply\nformat binary_little_endian 1.0\n"
FACE = "element face 1\nproperty list int int vertex_indices\nend_header\n"
QUADS = (
    HEAD.replace("ascii", "binary_little_endian").encode()
    + b"element face 2\nproperty list uint int vertex_indices\nend_header\n"
    + struct.pack("<12f", *map(float, SQUARE.split()))
    + struct.pack("<I4iI4i", 4, 0, 1, 2, 3, 4, 3, 2, 1, 0)
)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.ply", "ply\n", "a PLY header"),
        ("a.ply", "ply\nformat odd 1.0\nend_header\n", "no known format"),
        ("a.ply", HEAD + "end_header\n" + SQUARE, "4 points but no faces"),
        ("a.ply", HEAD + "end_header\n0 0 0\n", "promises 4 of 'vertex'"),
        ("a.ply", HEAD.replace("vertex 4", f"vertex {LONG}") + "end_header\n" + SQUARE, f"promises {LONG} of 'vertex'"),
        ("a.ply", f"ply\nformat ascii 1.0\nelement vertex {LONG}\nend_header\n", "no x, y and z"),
        ("a.ply", f"{BINARY}element vertex {LONG}\nend_header\n", "no x, y and z"),
        ("a.ply", HEAD.replace("vertex 4", "vertex -4") + "end_header\n", "promises -4 of 'vertex'"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "no x, y and z"),
        ("a.ply", HEAD + "property list uchar odd z\nend_header\n", "a property was expected"),
        (
            "a.ply",
            HEAD + "element face 1\nproperty list int int vertex_indices\nend_header\n" + SQUARE + f"{LONG} 0 1 2\n",
            "not all of the 1 expected rows of 'face'",
        ),
        ("a.ply", HEAD + FACE + SQUARE + "3 0 1\n", "expected rows of 'face'"),
        ("a.ply", HEAD + FACE + SQUARE + "3 0 1 x\n", "could not convert string"),
        ("a.ply", HEAD + FACE + SQUARE + "-1 0 1 2\n", "expected rows of 'face'"),
        ("a.ply", QUADS[:-1], "expected rows of 'face'"),
        ("a.ply", QUADS[:-20] + struct.pack("<I4i", 2**32 - 1, 0, 1, 2, 3), "expected rows of 'face'"),
        (
            "a.ply",
            HEAD + "element face 1\nproperty list int int vertex_indices\nend_header\n" + SQUARE + "3 0 1 4\n",
            "refers to vertex 4, but there are 4",
        ),
        ("a.stl", STL, "3 faces in 234 bytes were expected"),
        ("a.stl", "solid x\nendsolid x\n", "no faces"),
        ("a.stl", "solid x\nvertex 0 0 0\nvertex 1 0\nvertex 0 1 0\n", "a vertex is '1 0'"),
        ("a.stl", "solid x\nfacet\nvertex 0 0 0\nvertex 1 0 0\n", "2 vertices, three for each of 1 facet"),
        ("a.stl", SOLID.replace("endfacet\n", "vertex 1 1 0\nendfacet\n"), "4 vertices, three for each of 1 facet"),
        ("a.stl", SOLID.replace("vertex 1 0 0", "vertex 1 one 0"), "could not be read to its end"),
        ("a.stl", SOLID.replace("vertex 1 0 0", "vertex nan 0 0"), "not finite"),
        ("a.stl", SOLID + SOLID.replace("endsolid x\n", ""), "only 3 of its 6 vertices"),
        ("a.stl", "nothing of the kind", "bytes were expected"),
        ("a.off", f"OFF\n{LONG} 1 0\n0 0 0\n3 0 0 0\n", f"promises {LONG} vertices"),
        ("a.off", "PLY\n", "OFF and its counts were expected"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "refers to vertex 3, but there are 3"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "vertex 1 is '1 0', 3 numbers were expected"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "face 0 is '4 0 1 2', the number of its corners"),
    ],
)
def test_damage_is_told_in_one_line(save, name, content, said):
    with pytest.raises(InputError) as failure:
        load_scene(save(name, content))
    assert said in str(failure.value)
    assert "\n" not in str(failure.value)
