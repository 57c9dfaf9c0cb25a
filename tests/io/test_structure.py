"""What OBJ, PLY and the GLB made from them keep of a mesh's structure; the results are read by parsers of their own."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from aoprecalc.io import Outputs, load_scene, output_mesh_extension, write_image
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.options import BakeOptions
from aoprecalc.types import Atlas
from gltf_kit.gltf_values import GltfValues
from written_meshes import write_with_one_texture

SEEDS = range(6)
KINDS = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}


class Obj:
    """The lines of an OBJ by keyword; faces as lists of (v, vt, vn), 0 where left out, each with its material."""

    def __init__(self, path):
        self.lines = path.read_text().splitlines()
        self.v, self.vt, self.vn, self.faces, self.materials = [], [], [], [], []
        material = None
        for keyword, *rest in (line.split() for line in self.lines if line.split()):
            if keyword in ("v", "vt", "vn"):
                getattr(self, keyword).append([float(word) for word in rest])
            elif keyword == "usemtl":
                material = " ".join(rest)
            elif keyword == "f":
                self.faces.append([tuple(int(n or 0) for n in f"{word}//".split("/")[:3]) for word in rest])
                self.materials.append(material)

    def corners(self, face, column):
        """What stands at the corners of a face: column 0 positions, 1 UVs, 2 normals; None where left out."""
        table = (self.v, self.vt, self.vn)[column]
        numbers = [corner[column] for corner in self.faces[face]]
        assert all(0 < number <= len(table) for number in numbers) or not any(numbers)
        return [table[number - 1] for number in numbers] if all(numbers) else None


class Ply:
    """The header's lines and the rows of each element of a little-endian binary PLY, as dictionaries."""

    def __init__(self, path):
        head, _, self._body = path.read_bytes().partition(b"end_header\n")
        self.header = head.decode().splitlines()
        self.elements, kinds = {}, []
        for words in (line.split() for line in self.header):
            if words[0] == "element":
                kinds.append((words[1], int(words[2]), []))
            elif words[0] == "property":
                kinds[-1][2].append(words[1:])
        for name, count, properties in kinds:
            self.elements[name] = [{words[-1]: self._take(words) for words in properties} for _ in range(count)]
        assert self._body == b""
        self.faces = [row["vertex_indices"] for row in self.elements["face"]]
        self.v = [[row[axis] for axis in "xyz"] for row in self.elements["vertex"]]

    def corners(self, face, _):
        """The positions of a face."""
        return [self.v[vertex] for vertex in self.faces[face]]

    def _take(self, words):
        if words[0] == "list":
            return [self._number(words[2]) for _ in range(self._number(words[1]))]
        return self._number(words[0])

    def _number(self, kind):
        size = struct.calcsize("<" + KINDS[kind])
        number, self._body = struct.unpack("<" + KINDS[kind], self._body[:size])[0], self._body[size:]
        return number


def library(path):
    """The materials of an MTL: name -> lines."""
    blocks = path.read_text().split("newmtl ")[1:]
    return {block.splitlines()[0]: [line for line in block.splitlines()[1:] if line] for block in blocks}


def polygons(seed, count=40):
    """(v, 3) points and the vertices of polygons of 3 to 7 corners, some concave, each in a plane of its own."""
    random = np.random.default_rng(seed)
    sizes = random.integers(3, 8, count)
    order = random.permutation(sizes.sum())
    points, faces = np.empty((sizes.sum(), 3)), []
    for number, size in enumerate(sizes):
        angles = 2 * np.pi * (np.arange(size) + random.uniform(-0.2, 0.2, size)) / size
        flat = np.stack([np.cos(angles), np.sin(angles)]) * random.uniform(0.4, 1.5, size)
        tilt = np.linalg.qr(random.normal(size=(3, 3)))[0][:, :2]
        face = order[sizes[:number].sum() :][:size]
        points[face] = ((tilt @ flat).T + (4 * number, 0, 0)).round(6)
        faces.append(face.tolist())
    return points, faces


def vector_area(points):
    """Twice the area of a polygon, as a vector."""
    points = np.asarray(points) - points[0]
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


def atlas_with_seams(scene, faces, seed):
    """An atlas that tears some polygons apart, and which: (atlas, (p,) bool); the others show the same in every cut."""
    random = np.random.default_rng(seed)
    uvs = scene.corners @ random.uniform(-1e-3, 1e-3, (3, 2)) + 0.25
    torn = random.random(len(faces)) < 0.4
    first = np.cumsum([0] + [len(face) - 2 for face in faces])[:-1]  # triangle of each polygon
    uvs[first[torn]] += 0.5
    return Atlas("xatlas", uvs, np.ones(len(uvs), bool), 2), torn & (np.array([len(face) for face in faces]) > 3)


def check_faces(faces, torn, found, points_found):
    """Polygons that no seam tears are there as they were, the others as triangles of the same area."""
    found = iter(zip(found, points_found, strict=True))
    for face, is_torn in zip(faces, torn, strict=True):
        if not is_torn:
            whole = next(found)[0]  # it may begin at another corner
            at = face.index(whole[0])
            assert whole == face[at:] + face[:at]
            continue
        parts = [next(found) for _ in range(len(face) - 2)]
        assert all(len(part) == 3 and set(part) <= set(face) for part, _ in parts)
        assert {vertex for part, _ in parts for vertex in part} == set(face)
        yield face, sum(vector_area(points) for _, points in parts)
    assert next(found, None) is None


def obj_text(points, faces):
    return "".join([*(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()), *(f_line(face) for face in faces)])


def f_line(face):
    return f"f {' '.join(str(vertex + 1) for vertex in face)}\n"


def smooth(scene):
    """Normals that agree wherever positions do."""
    normals = np.cos(np.arange(scene.positions.size)).reshape(-1, 3)[scene.faces]
    return (normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)


@pytest.fixture
def write(tmp_path):
    """write(scene, name, atlas, normals) -> the path of the mesh, and the warnings."""

    def write_mesh(scene, name, atlas, normals):
        path = tmp_path / "out" / name
        with Outputs() as outputs:
            picture = outputs.folder(path.parent) / "x_ao.png"
            write_image(outputs.path(picture), np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8))
            return path, write_with_one_texture(outputs, path, scene, atlas, normals, picture).messages

    return write_mesh


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("suffix", [".obj", ".ply"])
@pytest.mark.parametrize("source", [".obj", ".ply"])
def test_seams_alone_cut_polygons(save, write, source, suffix, seed):
    points, faces = polygons(seed)
    scene = load_scene(save(f"a{source}", obj_text(points, faces) if source == ".obj" else ply_text(points, faces)))
    atlas, torn = atlas_with_seams(scene, faces, seed)
    assert 0 < torn.sum() < len(faces)
    path, warnings = write(scene, f"b{suffix}", atlas, normals := smooth(scene))
    assert warnings == ()

    back = load_scene(path)
    assert np.array_equal(back.corners, scene.corners)
    assert back.uvs == pytest.approx(atlas.uvs, abs=0 if suffix == ".obj" else 1e-7)
    assert back.normals == pytest.approx(normals, abs=1e-7)
    made = (Obj if suffix == ".obj" else Ply)(path)
    at = [made.corners(number, 0) for number in range(len(made.faces))]
    place = {tuple(point): number for number, point in enumerate(points.tolist())}
    found = [[place[tuple(point)] for point in face] for face in at]
    for face, area in check_faces(faces, torn, found, at):
        assert area == pytest.approx(vector_area(points[face]), abs=1e-9)
    if source == suffix:
        assert made.v[: len(points)] == points.tolist()


def ply_text(points, faces, elements="", rows="", of_faces=lambda number: "", header=""):
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", header, elements, "end_header"]
    lines = [*(f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist())]
    lines += [
        f"{len(face)} {' '.join(map(str, face))} {of_faces(number)}".rstrip() for number, face in enumerate(faces)
    ]
    return "\n".join([*filter(None, head), *lines, rows])


PAINTED = """# made by hand
mtllib none.mtl

o House
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 9 9 9
v 1 1 0 0 0 1
v 0 1 0 0.5 0.5 0.5
vt 0 0
vt 0.5 0
vt 0.5 0.5
vt 0 0.5
vn 0 0 1
vn 0 0 2
g wall
usemtl paint
s 1
f 1/1/1 2/2/1 4/3/1 5/4/2
l 1/1 2/2
o Roof
v 0 0 3
v 1 0 3
v 1 1 3
vt 0.6 0.6
vt 0.7 0.6
vt 0.7 0.7
s off
usemtl tiles
f -3/-3/1 -2/-2/2 -1/-1/1
g chimney
f 6/7/1 8/6/1 7/5/1
p 3
"""
MTL = """newmtl paint
Kd 0.5 0.25 0
Ns 7
newmtl unused
Kd 1 0 0
map_Kd -s 2 2 1 bricks.png
newmtl tiles
map_Bump bumps.png
"""


@pytest.fixture
def painted(save, tmp_path):
    """An OBJ of three parts, wall, Roof and chimney, the latter two of one material; with pictures beside it."""
    for name in ("bricks.png", "bumps.png", "old.png"):
        Image.new("L", (2, 2)).save(tmp_path / name)
    save("none.mtl", MTL)
    return save("painted.obj", PAINTED)


def kept(scene):
    """The atlas of the file's own UVs."""
    return Atlas("keep", scene.uvs, np.ones(len(scene.faces), bool), 1, uv_set=0)


def fresh(scene):
    """An atlas in which all corners at a position agree, and every cut of a planar polygon shows the same."""
    uvs = scene.corners @ np.array([[0.003, 0.001], [0.0005, 0.003], [0.001, 0.002]]) + 0.5
    return Atlas("xatlas", uvs, np.ones(len(uvs), bool), 1)


def only(scene, *names):
    """The scene in which other parts receive nothing."""
    return assign_roles(scene, BakeOptions(only=names))


def test_an_obj_whose_uvs_and_normals_are_kept_stays_line_by_line(painted, write):
    scene = load_scene(painted)
    path, warnings = write(scene, "a.obj", kept(scene), scene.normals)
    expected = PAINTED.replace("-3/-3/1 -2/-2/2 -1/-1/1", "6/5/1 7/6/2 8/7/1").replace("mtllib none.mtl\n", "")
    assert path.read_text() == "mtllib a.mtl\n" + expected
    assert warnings == ()
    made = library(path.with_suffix(".mtl"))
    assert made["paint"] == ["Kd 0.5 0.25 0", "Ns 7", "map_Kd x_ao.png"]
    assert made["unused"] == ["Kd 1 0 0", "map_Kd -s 2 2 1 ../bricks.png"]
    assert made["tiles"] == ["map_Bump bumps.png", "map_Kd x_ao.png"]


def test_an_obj_with_new_uvs_keeps_all_but_these(painted, write):
    scene = load_scene(painted)
    path, warnings = write(scene, "a.obj", atlas := fresh(scene), normals := smooth(scene))
    made = Obj(path)
    changed = ("vt", "vn", "f", "l", "mtllib")
    lines = [line for line in PAINTED.splitlines() if line.partition(" ")[0] not in changed]
    assert [line for line in made.lines if line.partition(" ")[0] not in changed] == lines
    assert [[v for v, _, _ in face] for face in made.faces] == [[1, 2, 4, 5], [6, 7, 8], [6, 8, 7]]
    assert "l 1 2" in made.lines
    assert len(made.vt) == 7
    assert np.array_equal(made.corners(0, 1), atlas.uvs[[0, 0, 0, 1], [0, 1, 2, 2]])
    assert made.corners(1, 2) == pytest.approx(normals[2], abs=1e-7)
    assert "left out" in warnings[0]
    assert library(path.with_suffix(".mtl"))["tiles"] == ["Kd 1 1 1", "map_Kd x_ao.png"]


@pytest.mark.parametrize("atlas_of", [kept, fresh])
def test_parts_that_do_not_receive_stay_in_an_obj(painted, write, atlas_of):
    before, scene = Obj(painted), only(load_scene(painted), "wall", "chimney")
    atlas = atlas_of(scene)
    path, _ = write(scene, "a.obj", atlas, smooth(scene))
    made, materials = Obj(path), library(path.with_suffix(".mtl"))
    assert made.v == before.v
    assert made.materials == ["paint", "tiles", "tiles_ao"]
    assert made.corners(1, 1) == before.vt[4:7]
    assert made.corners(1, 2) == [[0, 0, 1], [0, 0, 2], [0, 0, 1]]
    assert np.array_equal(made.corners(2, 1), atlas.uvs[3])
    assert list(materials) == ["paint", "unused", "tiles", "tiles_ao"]
    assert materials["tiles"] == ["map_Bump bumps.png"]
    assert materials["tiles_ao"][-1] == "map_Kd x_ao.png"
    back = load_scene(path)
    assert np.array_equal(back.corners, scene.corners)
    assert [part.name for part in back.parts] == ["wall", "Roof", "chimney"]


def test_parts_without_uvs_normals_and_material_get_none(save, write):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\ng a\nf 1 2 3\ng baked\nusemtl baked\nf 2 4 3\ng c\nf 3 2 1\n"
    scene = only(load_scene(save("a.obj", text)), "a")
    path, _ = write(scene, "b.obj", fresh(scene), smooth(scene))
    made = Obj(path)
    assert made.materials == ["baked_2", "baked", "baked"]
    assert [made.corners(face, 1) is None for face in range(3)] == [False, True, True]
    assert made.lines[-4:] == ["usemtl baked", "f 2 4 3", "g c", "f 3 2 1"]
    scene = only(load_scene(save("a.obj", text)), "c")
    made = Obj(write(scene, "b.obj", fresh(scene), smooth(scene))[0])
    assert made.materials == ["plain", "baked", "baked_ao"]


def test_textures_stay_on_uvs_that_are_kept(painted, save, write, tmp_path):
    save("none.mtl", "newmtl paint\nKd 1 1 0\nmap_Kd bricks.png\nmap_Ka old.png\nbump -bm 2 bumps.png\n")
    scene = load_scene(painted)
    assert output_mesh_extension(scene)[0] == ".glb"
    assert "(paint)" in output_mesh_extension(scene, [fresh(scene)])[1]
    assert output_mesh_extension(scene, [kept(scene)]) == (".obj", "")
    path, warnings = write(scene, "a.obj", kept(scene), scene.normals)
    made = library(path.with_suffix(".mtl"))
    assert made["paint"] == ["Kd 1 1 0", "map_Kd bricks.png", "bump -bm 2 bumps.png", "map_Ka x_ao.png"]
    assert made["tiles"] == ["Kd 1 1 1", "map_Kd x_ao.png"]
    assert "the ambient textures (map_Ka) of 1 material were replaced" in warnings[0]
    back = load_scene(path)
    assert back.document.materials["paint"].occlusion == path.with_name("x_ao.png")
    assert back.document.materials["paint"].texture.content() == (tmp_path / "bricks.png").read_bytes()


def test_pictures_that_no_receiver_shows_leave_an_obj_what_it_is(painted, save):
    scene = load_scene(painted)
    assert output_mesh_extension(scene) == (".obj", "")  # the picture of an unused material
    save("none.mtl", "newmtl tiles\nmap_Kd bricks.png\n")
    assert output_mesh_extension(load_scene(painted))[0] == ".glb"
    assert output_mesh_extension(only(load_scene(painted), "wall")) == (".obj", "")
    assert output_mesh_extension(only(load_scene(painted), "chimney"))[0] == ".glb"


def test_a_polygon_with_a_corner_on_a_straight_side_needs_no_flat_triangle():
    square = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0], [1, 2, 0], [0, 2, 0], [0, 1, 0]], float)
    corner = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 2, 0]], float)
    for points in (square, corner, square[:-1], square[[0, 1, 2, 3, 4, 6]]):
        for turn in range(len(points)):
            turned = np.roll(points, turn, axis=0)
            triangles, _ = polygon_triangles(np.array([len(points)]), np.arange(len(points)), turned)
            areas = np.array([vector_area(turned[triangle])[2] for triangle in triangles])
            assert areas.min() > 0.1
            assert areas.sum() == pytest.approx(vector_area(points)[2])


def test_flat_normals_keep_planar_polygons_whole(save, write):
    points, faces = polygons(9)
    scene = load_scene(save("a.obj", obj_text(points, faces)))
    edges = scene.corners[:, 1:] - scene.corners[:, :1]
    flat = np.cross(edges[:, 0], edges[:, 1])
    flat = np.array([vector_area(points[face]) for face in faces])[scene.document.polygons.owners]
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True) + 1e-8 * np.sin(np.arange(flat.size)).reshape(-1, 3)
    path, _ = write(scene, "b.obj", fresh(scene), np.repeat(flat[:, None], 3, axis=1).astype(np.float32))
    assert [len(face) for face in Obj(path).faces] == [len(face) for face in faces]


COMB = [(0, 0), (4, 0), (4, 2), (3, 2), (3, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)]
ARROW = [(2, 1), (0, 0), (2, -1), (1, 0)]  # as a fan around its first corner it would be a triangle
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("polygon", "bend", "counts"),
    [(ARROW, 0, [4]), (COMB, 0, [3] * 8), (SQUARE, 0, [4]), (SQUARE, 0.01, [3, 3]), (SQUARE, 1e-4, [4])],
    ids=["arrow", "comb", "square", "bent", "hardly bent"],
)
@pytest.mark.parametrize(("suffix", "made"), [(".obj", Obj), (".ply", Ply)])
def test_whoever_cuts_the_polygons_shows_the_texture_that_was_baked(save, write, suffix, made, polygon, bend, counts):
    points = np.pad(np.array(polygon, float), ((0, 0), (0, 1)))
    scene = load_scene(save("a.obj", obj_text(points, [list(range(len(points)))])))
    atlas = fresh(scene)
    atlas.uvs[(scene.corners == points[2]).all(axis=2)] += bend
    path, messages = write(scene, f"b{suffix}", atlas, smooth(scene))
    faces = [made(path).corners(number, 0) for number in range(len(counts))]
    assert [len(face) for face in faces] == counts
    as_fans = [vector_area(np.array(face)[[0, i, i + 1]])[2] for face in faces for i in range(1, len(face) - 1)]
    assert min(as_fans) > 0
    assert sum(as_fans) == pytest.approx(vector_area(points)[2])
    cut = "1 polygon is written as triangles: the texture fits no other cut"
    assert messages == ((cut,) if counts[0] == 3 else ())
    assert np.array_equal(load_scene(path).corners, scene.corners)


def test_polygons_whose_uvs_are_kept_stay_as_they_are(save, write):
    points = np.pad(np.array(ARROW, float), ((0, 0), (0, 1)))
    uvs = "vt 0 0\nvt 1 0\nvt 0.3 0.9\nvt 0 1\n"
    scene = load_scene(save("a.obj", obj_text(points, []) + uvs + "f 1/1 2/2 3/3 4/4\n"))
    path, messages = write(scene, "b.obj", kept(scene), smooth(scene))
    assert (Obj(path).faces[0][0][:2], len(Obj(path).faces), messages) == ((1, 1), 1, ())


@pytest.mark.parametrize("seed", SEEDS)
def test_a_ply_keeps_what_its_faces_and_vertices_have(save, write, tmp_path, seed):
    points, faces = polygons(seed)
    elements = "property uchar red\nproperty double heat\nproperty int texnumber\n"
    elements += "element edge 2\nproperty int vertex1\nproperty list uchar short seen\nproperty int vertex2"
    header = "comment by hand\ncomment TextureFile old.png\nobj_info scanned 2 times"
    rows = "4 0 5\n6 3 1 2 3 7\n"
    text = ply_text(points, faces, elements, rows, lambda number: f"{number} {number / 7!r} 1", header)
    scene = load_scene(save("a.ply", text))
    atlas, torn = atlas_with_seams(scene, faces, seed)
    path, warnings = write(scene, "b.ply", atlas, smooth(scene))
    made = Ply(path)
    assert [str(tmp_path / "old.png") in line for line in warnings] == [True]
    assert made.header[2:5] == ["comment by hand", "obj_info scanned 2 times", "comment TextureFile x_ao.png"]
    assert made.elements["edge"] == [
        {"vertex1": 4, "seen": [], "vertex2": 5},
        {"vertex1": 6, "seen": [1, 2, 3], "vertex2": 7},
    ]
    owners = [number for number, face in enumerate(faces) for _ in range(len(face) - 2 if torn[number] else 1)]
    assert [row["red"] for row in made.elements["face"]] == owners
    assert [row["heat"] for row in made.elements["face"]] == [number / 7 for number in owners]
    assert "texnumber" not in made.elements["face"][0]
    assert made.v[: len(points)] == points.tolist()


def test_a_ply_keeps_vertices_that_no_face_has_and_names_uvs_anew(save, write):
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty uchar red\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float texture_u\nproperty float texture_v\nproperty float nx\n"
    head += "property float ny\nproperty float nz\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
    rows = [(7, 5, 5, 5, 0.5, 0.5, 0, 1, 0), *((at, at % 2, at // 2, 0, at / 4, 0.5, 0, 0, 1) for at in range(4))]
    scene = load_scene(save("a.ply", head + "".join(f"{' '.join(map(str, row))}\n" for row in rows) + "4 1 2 4 3\n"))
    for atlas, said in ((kept(scene), 0), (fresh(scene), 1)):
        path, warnings = write(scene, "b.ply", atlas, scene.normals)
        made = Ply(path)
        assert len(warnings) == said
        assert list(made.elements["vertex"][0]) == ["red", "x", "y", "z", "nx", "ny", "nz", "s", "t"]
        assert [row["red"] for row in made.elements["vertex"]] == [7, 0, 1, 2, 3]
        assert made.elements["vertex"][0] == {"red": 7, "nx": 0, "ny": 1, "nz": 0, "s": 0, "t": 0} | dict.fromkeys(
            "xyz", 5
        )
        assert made.faces == [[1, 2, 4, 3]]
        assert np.array_equal(load_scene(path).uvs, atlas.uvs.astype(np.float32))


def test_strips_become_triangles_after_the_faces(save, write):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    elements = "property uchar red\nelement tristrips 1\nproperty list int int vertex_indices"
    scene = load_scene(save("a.ply", ply_text(points, [[0, 1, 2, 3]], elements, "4 0 1 3 2\n", lambda _: "9")))
    made = Ply(write(scene, "b.ply", fresh(scene), smooth(scene))[0])
    assert made.faces == [[0, 1, 2, 3], [0, 1, 3], [3, 1, 2]]
    assert [row["red"] for row in made.elements["face"]] == [9, 0, 0]
    assert list(made.elements) == ["vertex", "face"]


def test_a_polygon_of_more_corners_than_a_byte_counts(save, write):
    angles = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    scene = load_scene(save("a.obj", obj_text(points, [list(range(300))])))
    for suffix, made in ((".ply", Ply), (".obj", Obj)):
        assert [len(face) for face in made(write(scene, f"b{suffix}", fresh(scene), smooth(scene))[0]).faces] == [300]


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_instances_that_share_a_place_have_its_uvs(gltf_cube, write, suffix):
    gltf, primitive = gltf_cube
    mesh = gltf.mesh(primitive)
    gltf.node(mesh=mesh)
    gltf.node(mesh=mesh, translation=[5, 0, 0], scale=[-1, 1, 1])
    gltf.node(mesh=gltf.mesh(primitive), translation=[0, 9, 0], name="not baked")
    scene = assign_roles(gltf.load(), BakeOptions(exclude=("not baked",)), share=True)
    assert [part.uv_owner for part in scene.parts] == [None, 0, None]
    atlas = fresh(scene)
    atlas.uvs[12:] = 0
    path, warnings = write(scene, f"a{suffix}", atlas, scene.normals)
    back = load_scene(path)
    assert any("holds one set of UVs" in line for line in warnings)
    vertices = scene.parts[0].vertices
    by_vertex = {int(vertex): uv for vertex, uv in zip(vertices.flat, atlas.uvs[:12].reshape(-1, 2), strict=True)}
    expected = np.array([[by_vertex[int(vertex)] for vertex in face] for face in scene.parts[1].vertices])
    assert back.uvs[12:24] == pytest.approx(expected, abs=1e-6)
    if suffix == ".ply":
        assert "1 part without ambient occlusion" in warnings[0]
    else:
        assert set(Obj(path).materials[24:]) == {"plain"}
        assert back.uvs[24:] == pytest.approx(scene.uvs[24:])


def test_a_glb_made_here_leaves_alone_what_does_not_receive(painted, save, write):
    save("none.mtl", "newmtl tiles\nKd 0.5 1 1\nmap_Kd bricks.png\n")
    scene = only(load_scene(painted), "wall", "chimney")
    path, warnings = write(scene, "a.glb", atlas := fresh(scene), normals := smooth(scene))
    assert warnings == ()
    made = GltfValues(path)
    names = [node["name"] for node in made.json["nodes"]]
    assert names == ["wall", "Roof", "chimney"]
    wall, roof, chimney = (mesh["primitives"][0] for mesh in made.json["meshes"])
    materials = [made.json["materials"][primitive["material"]] for primitive in (wall, roof, chimney)]
    assert [material["name"] for material in materials] == ["paint", "tiles", "tiles_ao"]
    assert ["occlusionTexture" in material for material in materials] == [True, False, True]

    def values(primitive, name):
        return made.array(primitive["attributes"][name])[made.array(primitive["indices"])[:, 0]]

    up = (1, -1), (0, 1)
    own, new = (uvs.reshape(-1, 2) * up[0] + up[1] for uvs in (scene.uvs, atlas.uvs))
    assert set(roof["attributes"]) == {"POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0"}
    assert values(roof, "TEXCOORD_0") == pytest.approx(own[6:9], abs=1e-7)
    assert values(roof, "NORMAL") == pytest.approx(scene.normals[2])
    assert "baseColorTexture" in materials[1]["pbrMetallicRoughness"]
    # A textured receiver: its own UVs come first. One without a picture: those of the baked texture do.
    assert materials[2]["occlusionTexture"]["texCoord"] == 1
    assert "texCoord" not in materials[2]["pbrMetallicRoughness"]["baseColorTexture"]
    assert values(chimney, "TEXCOORD_0") == pytest.approx(own[9:12], abs=1e-7)
    assert values(chimney, "TEXCOORD_1") == pytest.approx(new[9:12], abs=1e-7)
    assert values(chimney, "NORMAL") == pytest.approx(normals[3])
    color = materials[0]["pbrMetallicRoughness"]["baseColorTexture"]
    assert materials[0]["occlusionTexture"] == {"texCoord": 0} | color | {"strength": 1}
    assert values(wall, "TEXCOORD_0") == pytest.approx(new[:6], abs=1e-7)
    assert values(wall, "TEXCOORD_1") == pytest.approx(own[:6], abs=1e-7)


def test_solids_of_an_stl_are_nodes(save, write):
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex 1 0 0\nvertex 0 1 {0}\nendloop\nendfacet\n"
    text = "".join(f"solid {name}\n{facet.format(at)}endsolid {name}\n" for at, name in enumerate(["a b", "c"], 2))
    scene = only(load_scene(save("a.stl", text)), "c")
    made = GltfValues(write(scene, "a.glb", fresh(scene), smooth(scene))[0])
    assert [node["name"] for node in made.json["nodes"]] == ["a b", "c"]
    silent, baked = (mesh["primitives"][0] for mesh in made.json["meshes"])
    assert set(silent["attributes"]) == {"POSITION"}
    assert set(baked["attributes"]) == {"POSITION", "NORMAL", "TEXCOORD_0"}
    assert [material["name"] for material in made.json["materials"]] == ["plain", "baked"]


def test_faces_without_area_do_not_cut_what_they_belong_to(save, write):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 2\nf 1 2\nf 2 3 4 1\n"
    scene = load_scene(save("a.obj", text))
    atlas = fresh(scene)
    mapped = np.array([True, True, False, True, True])
    atlas.uvs[~mapped] = 0
    made = Obj(write(scene, "b.obj", replace(atlas, mapped=mapped), smooth(scene))[0])
    assert [[v for v, _, _ in face] for face in made.faces] == [[1, 2, 3, 4], [1, 2, 2], [2, 3, 4, 1]]


def test_lines_of_windows_and_continued_ones(save, write):
    text = "v 0 0 0\r\nv 1 0 0\r\nv 1 1 \\\r\n0\r\nv 0 1 0\r\nf 1 2 \\\r\n3 4\r\ns 1\r\n\tf 3 2 1\r\n"
    scene = load_scene(save("a.obj", text))
    path, _ = write(scene, "b.obj", fresh(scene), smooth(scene))
    assert b"\r" not in path.read_bytes()
    assert [[v for v, _, _ in face] for face in Obj(path).faces] == [[1, 2, 3, 4], [3, 2, 1]]
    assert Obj(path).lines[-2] == "s 1"
