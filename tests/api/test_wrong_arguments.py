"""What is wrong with an argument is said in Python's words: its name, what was found, what was expected."""

import numpy as np
import pytest

import aoprecalc as ao

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
UVS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], float)


def with_value(array, index, value):
    changed = np.array(array)
    changed[index] = value
    return changed


def tetrahedron(**changed):
    return ao.Mesh(**{"vertices": POINTS, "faces": FACES} | changed)


# argument, what the message holds besides its name, and the call
WRONG = [
    ("vertices", "shape (4, 2), (V, 3) was expected", lambda: tetrahedron(vertices=POINTS[:, :2])),
    ("vertices", "shape (12,), (V, 3) was expected", lambda: tetrahedron(vertices=POINTS.ravel())),
    ("vertices", "dtype <U1, real numbers", lambda: tetrahedron(vertices=np.full((4, 3), "x"))),
    ("vertices", "dtype complex128, real numbers", lambda: tetrahedron(vertices=POINTS * 1j)),
    ("vertices", "dtype object, real numbers", lambda: tetrahedron(vertices=np.full((4, 3), None))),
    ("vertices", "is not an array", lambda: tetrahedron(vertices=[[0, 0, 0], [1, 0]])),
    ("vertices", "nan at [2, 1], finite numbers", lambda: tetrahedron(vertices=with_value(POINTS, (2, 1), np.nan))),
    ("vertices", "inf at [0, 0], finite numbers", lambda: tetrahedron(vertices=with_value(POINTS, (0, 0), np.inf))),
    ("vertices", "usable size", lambda: tetrahedron(vertices=POINTS * 1e200)),
    ("vertices", "has any area", lambda: tetrahedron(vertices=np.zeros((4, 3)))),
    ("vertices", "of type NoneType, the shape (V, 3) was expected", lambda: tetrahedron(vertices=None)),
    ("faces", "shape (4, 2), (F, 3) was expected", lambda: tetrahedron(faces=FACES[:, :2])),
    ("faces", "shape (0,), (F, 3) was expected", lambda: tetrahedron(faces=[])),
    ("faces", "no faces", lambda: tetrahedron(faces=np.zeros((0, 3), int))),
    ("faces", "dtype float64, integers", lambda: tetrahedron(faces=FACES.astype(float))),
    ("faces", "dtype bool, integers", lambda: tetrahedron(faces=FACES > 1)),
    ("faces", "vertex 4, indices from 0 to 3", lambda: tetrahedron(faces=with_value(FACES, (3, 2), 4))),
    ("faces", "vertex -1, indices from 0 to 3", lambda: tetrahedron(faces=with_value(FACES, (0, 0), -1))),
    ("faces", "has any area", lambda: tetrahedron(faces=[[0, 0, 1], [2, 2, 2]])),
    ("normals", "shape (3, 3), (4, 3) or (4, 3, 3) was expected", lambda: tetrahedron(normals=POINTS[:3])),
    ("normals", "nan at [1, 1], finite", lambda: tetrahedron(normals=with_value(POINTS, (1, 1), np.nan))),
    ("uvs", "shape (4, 3), (4, 2) or (4, 3, 2) was expected", lambda: tetrahedron(uvs=POINTS)),
    ("uvs", "shape (3, 3, 2)", lambda: tetrahedron(uvs=np.zeros((3, 3, 2)))),
    ("uvs", "inf at [0, 0], finite", lambda: tetrahedron(uvs=with_value(UVS, (0, 0), np.inf))),
    ("name", "'a/b', a file name", lambda: tetrahedron(name="a/b")),
    ("mesh", "of type ndarray, a Mesh, a path", lambda: ao.bake(POINTS)),
    ("mesh", "of type NoneType, a Mesh, a path", lambda: ao.fit_spheres(None)),
    ("mesh", "of type list, a trimesh.Trimesh", lambda: ao.Mesh.from_trimesh([POINTS, FACES])),
    ("path", "of type list, the path", lambda: ao.load([])),
    ("path", "of type int, the path", lambda: ao.load_spheres(4)),
    ("texture", "is None", lambda: ao.verify(tetrahedron(uvs=UVS))),
    ("texture", "shape (4,), (H, W) or (H, W, 1)", lambda: ao.verify(tetrahedron(uvs=UVS), np.ones(4))),
    ("texture", "shape (0, 4), at least one texel", lambda: ao.verify(tetrahedron(uvs=UVS), np.ones((0, 4)))),
    ("texture", "from 0 to 255, 0 to 1", lambda: ao.verify(tetrahedron(uvs=UVS), np.eye(4) * 255)),
    ("texture", "nan at [0, 1], finite", lambda: ao.verify(tetrahedron(uvs=UVS), [[0.5, np.nan]])),
    ("ao", "needs UVs", lambda: tetrahedron().to_trimesh(np.ones((4, 4)))),
    ("ao", "shape (4, 4, 3), (H, W)", lambda: tetrahedron(uvs=UVS).to_trimesh(np.ones((4, 4, 3)))),
    ("centers", "shape (3,), (n, 3)", lambda: ao.measure_spheres(tetrahedron(), np.zeros(3), [1.0])),
    ("centers", "no rows, at least one", lambda: ao.measure_spheres(tetrahedron(), np.zeros((0, 3)), [])),
    ("centers", "nan at [0, 2], finite", lambda: ao.measure_spheres(tetrahedron(), [[0, 0, np.nan]], [1.0])),
    ("centers", "too far", lambda: ao.measure_spheres(tetrahedron(), [[1e300, 0, 0]], [1.0])),
    ("radii", "shape (2,), (1,) was expected", lambda: ao.measure_spheres(tetrahedron(), np.zeros((1, 3)), [1, 2])),
    ("radii", "value -1, numbers >= 0", lambda: ao.measure_spheres(tetrahedron(), np.zeros((1, 3)), [-1])),
    ("options", "of type str, BakeOptions", lambda: ao.bake(tetrahedron(), "build/")),
    ("options", "of type BakeOptions, SphereOptions", lambda: ao.fit_spheres(tetrahedron(), ao.BakeOptions())),
    ("options", "of type dict, VerifyOptions", lambda: ao.verify(tetrahedron(uvs=UVS), np.ones((2, 2)), {})),
    ("options", "of type float, CompareOptions", lambda: ao.compare("a.png", "b.png", 0.1)),
    ("a", "of type ndarray, the path", lambda: ao.compare(POINTS, "b.png")),
]


@pytest.mark.parametrize(("argument", "expected", "call"), WRONG, ids=[f"{row[0]}: {row[1]}" for row in WRONG])
def test_the_message_names_the_argument(argument, expected, call):
    with pytest.raises((ao.ArgumentError, ao.InputError)) as raised:
        call()
    message = str(raised.value)
    assert message.replace("vertices, faces", argument).startswith(argument)
    assert expected in message
    assert "--" not in message


def test_unused_vertices_may_be_anything_finite():
    assert len(tetrahedron(vertices=[*POINTS, (1e30, 0, 0)]).vertices) == 5
