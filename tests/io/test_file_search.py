"""The files that a mesh names are found as other programs write the names; text is read whatever its encoding."""

import unicodedata

import pytest

from aoprecalc.io import load_scene
from aoprecalc.io.formats.files import FileSearch, text_as_utf8
from aoprecalc.io.meshes import input_files

TEXTS = {
    "a.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\ng stühle\nf 1 2 3\n",
    "a.off": "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "a.ply": (
        "ply\nformat ascii 1.0\ncomment ü\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    ),
    "a.stl": (
        "solid ü\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        "endsolid ü\n"
    ),
    "a.gltf": (
        '{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "ü"}], '
        '"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [{"bufferView": 0, '
        '"componentType": 5126, "count": 3, "type": "VEC3"}], "bufferViews": [{"buffer": 0, "byteLength": 36}], '
        '"buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}'
    ),
}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("name", TEXTS)
def test_text_of_any_encoding_with_a_mark_or_of_utf_16_is_read(save, name, encoding):
    scene = load_scene(save(name, TEXTS[name].encode(encoding)))
    assert sorted(map(tuple, scene.corners[0])) == [(0, 0, 0), (0, 1, 0), (1, 0, 0)]
    assert scene.warnings == ()


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_marks_change_no_line_ends(ends):
    text = f"a{ends}ü{ends}"
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-32"):
        assert text_as_utf8(text.encode(encoding)) == text.encode()


@pytest.mark.parametrize(
    "data",
    [b"", b"a", "naïve".encode("latin-1"), b"glTF\2\0\0\0", b"\xff\xfe" + bytes(84), b"\xef\xbb\xbf" + bytes(81)],
    ids=ascii,
)
def test_what_is_no_marked_text_stays(data):
    assert text_as_utf8(data) == data


def names_in(folder, *files):
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).touch()
    return FileSearch(folder / "mtl", folder)


@pytest.mark.parametrize(
    ("written", "file"),
    [
        ("wood.png", "wood.png"),
        ("./wood.png", "wood.png"),
        ("WOOD.PNG", "wood.png"),
        ("wood.png", "mtl/wood.png"),
        ("mtl/../wood.png", "wood.png"),
        (r"..\wood.png", "wood.png"),
        (r"Textures\Oak\Wood.PNG", "textures/oak/wood.png"),
        (r"maps\\wood.png", "maps/wood.png"),
        ('"my wood.png"', "my wood.png"),
        ("'my wood.png'", "my wood.png"),
        (r'"maps\my wood.png"', "maps/my wood.png"),
        ("my%20wood.png", "my wood.png"),
        ("my%20wood.png", "my%20wood.png"),
        ("wood.png # of oak", "wood.png"),
        ("wood #2.png", "wood #2.png"),
        (r"C:\Users\me\maps\wood.png", "wood.png"),
        ("/Users/me/wood.png", "wood.png"),
        ("maps/wood.png", "wood.png"),
        ("St\udcfchle.png", "Stühle.png"),
        (b"\x96\xd8.png".decode("utf-8", "surrogateescape"), "木.png"),
        ("Stühle.png", unicodedata.normalize("NFD", "Stühle.png")),
        ("STÜHLE.png", "stühle.png"),
    ],
    ids=ascii,
)
def test_a_file_is_found_as_its_name_is_written(tmp_path, written, file):
    found = names_in(tmp_path, file).find(written)
    assert found is not None
    assert found.samefile(tmp_path / file)


def test_the_exact_name_comes_before_others(tmp_path):
    search = names_in(tmp_path, "Wood.png", "wood.png", "mtl/WOOD.png")
    assert search.find("wood.png") == tmp_path / "wood.png"
    assert search.find("WOOD.png") == tmp_path / "mtl" / "WOOD.png"


@pytest.mark.parametrize("written", ["", "other.png", "..", ".", "maps", "n" * 300, "n" * 9000, "a\0b", "wood.png/x"])
def test_what_is_not_there_is_not_found(tmp_path, written):
    search = names_in(tmp_path, "wood.png", "maps/other")
    assert search.find(written) is None


@pytest.mark.parametrize("written", [r"\\server\share\wood.png", '"//server/share/wood.png"'])
def test_no_server_is_asked_and_its_file_is_not_taken(tmp_path, written):
    search = names_in(tmp_path, "wood.png")
    assert search.find(written) is None


@pytest.mark.parametrize(
    ("statement", "names"),
    [
        ("a.mtl b.mtl", ["a.mtl", "b.mtl"]),
        ("a b.mtl", ["a b.mtl"]),
        ("a b.mtl a.mtl", ["a b.mtl", "a.mtl"]),
        ('"a b.mtl" "b.mtl"', ['"a b.mtl"', '"b.mtl"']),
        ("none.mtl a.mtl", ["none.mtl", "a.mtl"]),
        ("my none.mtl", ["my none.mtl"]),
        ("a.mtl none", ["a.mtl", "none"]),
        ("A.MTL\tsub\\c.mtl", ["A.MTL", "sub\\c.mtl"]),
        ("a.mtl.mtl", ["a.mtl.mtl"]),
        ("n " * 4000, ["n"] * 4000),
    ],
    ids=lambda value: str(value)[:20],
)
def test_a_statement_names_one_file_or_several(tmp_path, statement, names):
    search = names_in(tmp_path, "a.mtl", "b.mtl", "a b.mtl", "sub/c.mtl")
    assert search.split(statement, ".mtl") == names


def test_the_files_of_a_mesh_are_those_that_are_found(save, tmp_path):
    save("maps/Wood.PNG", b"")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib/wood.mtl").write_bytes("newmtl wood\nmap_Kd -s 2 2 2 ..\\MAPS\\wood.png\n".encode("utf-16"))
    data = "mtllib LIB\\\\\nwood.mtl\nusemtl wood\n".replace("\\\\\n", "\\").encode()
    files = input_files(tmp_path / "a.obj", data)
    assert [file.resolve() for file in files[1:]] == [tmp_path / "lib/wood.mtl", tmp_path / "maps/Wood.PNG"]
