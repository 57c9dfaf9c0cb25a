"""Spheres read for measuring."""

import io
import json

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io.sphere_files import read_spheres, write_sphere_set
from aoprecalc.types import SphereSet

CENTERS = np.array([[0.1, -2, 1e-7], [1 / 3, 4e20, 0]])
RADII = np.array([2 / 3, 0.0])
ROW = {"center": [1, 2, 3], "radius": 4}


def packed(**arrays):
    archive = io.BytesIO()
    np.savez(archive, **arrays)
    return archive.getvalue()


def document(**values):
    return json.dumps(values)


@pytest.mark.parametrize("name", ["a.json", "a.csv", "a.npz", "a.NPZ", "a.ply", "a.yml", "a.YAML", "a.usda"])
def test_back_as_written(tmp_path, name):
    write_sphere_set(tmp_path / name, SphereSet(CENTERS, RADII, 17, True, "lloyd", "mean", 1000, 3), {})
    centers, radii = read_spheres(tmp_path / name)
    assert np.array_equal(centers, CENTERS)
    assert np.array_equal(radii, RADII)
    assert centers.dtype == radii.dtype == np.float64


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", document(spheres=[ROW])),
        ("a.json", document(schema=1, spheres=[ROW | {"id": 1}], tool=None)),
        ("a.csv", "\ufeffx, y, z, radius\r\n1,2,3,4\r\n\r\n"),
        ("a.npz", packed(centers=np.array([[1, 2, 3]], "i2"), radii=np.array([4], ">f4"), more=np.zeros(2))),
    ],
)
def test_sets_of_other_tools(save, name, content):
    centers, radii = read_spheres(save(name, content))
    assert centers.tolist() == [[1, 2, 3]]
    assert radii.tolist() == [4]
    assert centers.dtype == radii.dtype == np.float64


ONE, HEAD = np.ones(1), "x,y,z,radius\n"
BAD = [
    ("a.json", "", "is not JSON"),
    ("a.json", "[]", "lacks 'spheres'"),
    ("a.json", document(schema=2, spheres=[ROW]), "schema 2, expected 1"),
    ("a.json", document(schema=None, spheres=[ROW]), "schema None"),
    ("a.json", document(spheres=[]), "at least one sphere"),
    ("a.json", document(spheres=[{"center": [1, 2, 3]}]), "lacks 'radius'"),
    ("a.json", document(spheres=[ROW | {"center": [1, 2]}]), "at least one sphere, each"),
    ("a.json", document(spheres=[ROW | {"center": "xyz"}]), "is not a sphere set"),
    ("a.json", document(spheres=[ROW | {"radius": 10**400}]), "is not a sphere set"),
    ("a.json", document(spheres=[ROW | {"radius": -1}]), "finite radii >= 0"),
    ("a.json", document(spheres=[ROW | {"radius": float("nan")}]), "finite radii >= 0"),
    ("a.csv", "", "expected the header x,y,z,radius"),
    ("a.csv", "1,2,3,4\n", "expected the header x,y,z,radius"),
    ("a.csv", HEAD, "at least one sphere"),
    ("a.csv", HEAD + "1,2,3\n", "a.csv:2: has 3 values"),
    ("a.csv", HEAD + "1,2,3,four\n", "not a table of numbers"),
    ("a.csv", b"\xff\xfe", "not a table of numbers"),
    ("a.csv", HEAD + "1,2,3,-4\n", "finite radii >= 0"),
    ("a.csv", HEAD + "1,inf,3,4\n", "finite centers"),
    ("a.npz", "", "not a NumPy archive"),
    ("a.npz", b"PK\x03\x04 and no more", "not a NumPy archive"),
    ("a.npz", packed(centers=np.ones((1, 3)), radii=ONE)[:-40], "not a NumPy archive"),
    ("a.npz", packed(centers=np.ones((1, 3))), "lacks an array .*radii"),
    ("a.npz", packed(centers=np.ones((1, 3)), radii=np.array([None])), "not a NumPy archive"),
    ("a.npz", packed(centers=np.ones((1, 3)), radii=np.ones(1, complex)), "complex128, expected real numbers"),
    ("a.npz", packed(centers=np.ones(3), radii=ONE), "at least one sphere"),
    ("a.npz", packed(centers=np.ones((2, 3)), radii=ONE), "at least one sphere"),
    ("a.npz", packed(centers=np.ones((1, 3)), radii=np.ones(())), "at least one sphere"),
    ("a.npz", packed(centers=np.ones((0, 3)), radii=np.ones(0)), "at least one sphere"),
    ("a.npz", packed(centers=np.ones((1, 3)), radii=-ONE), "finite radii >= 0"),
    ("a.txt", "x", r"has the extension .txt; spheres are read from .json, .csv, .npz, .ply"),
    ("a", "", "has no extension"),
]


@pytest.mark.parametrize(("name", "content", "complaint"), BAD)
def test_what_holds_no_spheres_is_refused(save, name, content, complaint):
    path = save(name, content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_spheres(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_numpy_array_alone_is_refused(save):
    array = io.BytesIO()
    np.save(array, np.ones((2, 4)))
    with pytest.raises(InputError, match="not a NumPy archive"):
        read_spheres(save("a.npz", array.getvalue()))


@pytest.mark.parametrize("name", ["none.json", "none.csv", "none.npz"])
def test_a_file_that_is_missing(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read_spheres(tmp_path / name)
