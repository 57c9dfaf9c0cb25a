"""Every format of sphere sets, read back by a program that it is for."""

import csv
import json
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
import yourdfpy
from click.testing import CliRunner
from pxr import Usd, UsdGeom

from aoprecalc.cli import main
from aoprecalc.errors import OutputError, UsageError
from aoprecalc.io import load_scene
from aoprecalc.io.sphere_files import (
    SPHERE_EXTENSIONS,
    check_sphere_extension,
    read_spheres,
    sphere_document,
    write_sphere_set,
)
from aoprecalc.types import SphereSet

# Digits that only all 17 give back, exponents of both signs without a point in them, and a sphere of no size.
CENTERS = np.array([[0.1, -2, 1e-7], [1 / 3, 4e5, -0.0], [0, 2e20, 7], [3, 1, 2]])
RADII = np.array([0.5, 2 / 3, 1e-05, 0.0])
SPHERES = SphereSet(CENTERS, RADII, 17, True, "lloyd", "mean", 1000, 3)
NAMES = [f"sphere_{number}" for number in range(len(RADII))]
ODD_NAME = "12 <né> \"&'\\: \U0001f430"


@pytest.fixture
def write(tmp_path):
    """write(kind, spheres, scene) -> the path of the set."""

    def write_set(kind, spheres=SPHERES, scene=None):
        path = tmp_path / f"set{kind}"
        write_sphere_set(path, spheres, {"coverage": 0.25}, scene)
        return path

    return write_set


@pytest.fixture
def scene(cube_obj):
    return load_scene(cube_obj)


def named(scene, stem):
    return replace(scene, path=Path("folder") / f"{stem}.obj")


def spheres_around(values):
    """(centers, radii) of (n, vertices, 3) balls, from their vertices."""
    centers = (values.min(axis=1) + values.max(axis=1)) / 2
    return centers, np.linalg.norm(values - centers[:, None], axis=2)


def test_csv(write):
    path = write(".csv")
    assert path.read_bytes().startswith(b"x,y,z,radius\n0.1,-2.0,1e-07,0.5\n")
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["x", "y", "z", "radius"]
    assert np.array_equal(np.array(rows, np.float64), np.column_stack([CENTERS, RADII]))


def test_npz(write):
    path = write(".npz")
    with np.load(path) as archive:
        assert set(archive) == {"centers", "radii"}
        assert np.array_equal(archive["centers"], CENTERS)
        assert np.array_equal(archive["radii"], RADII)
        assert archive["centers"].dtype == archive["radii"].dtype == np.float64
    with zipfile.ZipFile(path) as members:
        assert {member.date_time for member in members.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_ply(write):
    cloud = trimesh.load(write(".ply"))
    assert isinstance(cloud, trimesh.PointCloud)
    assert np.array_equal(cloud.vertices, CENTERS)
    assert np.array_equal(cloud.metadata["_ply_raw"]["vertex"]["data"]["radius"].ravel(), RADII)


def test_obj(write):
    near = replace(SPHERES, centers=np.array([[0.1, -2, 1e-7], [1 / 3, 400, 0], [-7, 2, 7], [3, 1, 2]]))
    path = write(".obj", near)
    assert [line[2:] for line in path.read_text().splitlines() if line.startswith("o ")] == NAMES
    mesh = trimesh.load(path, process=False, maintain_order=True)
    balls = mesh.triangles.reshape(len(RADII), -1, 3)
    centers, distances = spheres_around(balls)
    assert centers == pytest.approx(near.centers, abs=1e-12)
    assert distances == pytest.approx(np.broadcast_to(RADII[:, None], distances.shape), abs=1e-12)
    # Nearly as much as the spheres hold, and positive: outside out.
    a, b, c = np.moveaxis(balls.reshape(len(RADII), -1, 3, 3) - centers[:, None, None], 2, 0)
    volumes = np.einsum("nfi,nfi->n", a, np.cross(b, c)) / 6
    assert volumes == pytest.approx(4 / 3 * np.pi * RADII**3, rel=0.02)
    first = mesh.vertices[mesh.faces][: len(balls[0]) // 3].reshape(-1, 3) - near.centers[0]
    normals = mesh.vertex_normals[mesh.faces][: len(balls[0]) // 3].reshape(-1, 3)
    assert normals == pytest.approx(first / RADII[0], abs=1e-9)


def test_glb(write, scene, normals_of):
    scene = replace(scene, normals=normals_of(scene))
    theirs = trimesh.load_scene(write(".glb", scene=named(scene, "12 odd")), process=False)
    assert set(theirs.graph.nodes_geometry) == {*NAMES, "12 odd"}
    assert set(theirs.geometry) == {"12 odd", "sphere"}
    matrix, geometry = theirs.graph["12 odd"]
    assert np.array_equal(matrix, np.eye(4))
    mesh = theirs.geometry[geometry]
    assert np.array_equal(mesh.triangles, scene.corners)
    assert mesh.vertex_normals[mesh.faces] == pytest.approx(scene.normals, abs=1e-6)

    ball = theirs.geometry["sphere"]
    assert np.linalg.norm(ball.vertices, axis=1) == pytest.approx(1)
    assert ball.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    assert ball.vertex_normals == pytest.approx(ball.vertices, abs=1e-6)
    assert ball.visual.material.alphaMode == "BLEND"
    for name, center, radius in zip(NAMES, CENTERS, RADII, strict=True):
        matrix, geometry = theirs.graph[name]
        assert geometry == "sphere"
        assert np.array_equal(matrix[:3, 3], center)
        assert np.array_equal(matrix[:3, :3], radius * np.eye(3))


def test_glb_is_instanced_and_holds_triangles_alone_without_a_mesh(write, scene):
    many = replace(SPHERES, centers=np.tile(CENTERS, (250, 1)), radii=np.tile(RADII, 250))
    assert write(".glb", many).stat().st_size < 200 * 1000
    theirs = trimesh.load_scene(write(".glb"), process=False)
    assert set(theirs.graph.nodes_geometry) == set(NAMES)
    bare = trimesh.load_scene(write(".glb", scene=replace(scene, normals=None)), process=False)
    assert bare.geometry["cube"].volume == pytest.approx(8)


def test_glb_is_read_by_ourselves(write, scene):
    back = load_scene(write(".glb", replace(SPHERES, centers=CENTERS.clip(-9, 9)), scene))
    assert [part.name for part in back.parts] == ["cube", *NAMES]


@pytest.mark.parametrize("kind", [".yml", ".yaml"])
@pytest.mark.parametrize("stem", ["no", "12", "1e5", ODD_NAME])
def test_yaml(write, scene, kind, stem):
    document = yaml.safe_load(write(kind, scene=named(scene, stem)).read_text(encoding="utf-8"))
    assert list(document) == ["collision_spheres"]
    assert list(document["collision_spheres"]) == [stem]
    entries = document["collision_spheres"][stem]
    assert [entry["center"] for entry in entries] == CENTERS.tolist()
    assert [entry["radius"] for entry in entries] == RADII.tolist()


def test_urdf(write, scene):
    path = write(".urdf", scene=named(scene, ODD_NAME))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of trimesh, at how it is called
        robot = yourdfpy.URDF.load(path, build_collision_scene_graph=True)
    assert robot.validate()
    for drawn in (robot.scene, robot.collision_scene):
        assert drawn.extents.max() == pytest.approx(2e20)
    assert robot.robot.name == ODD_NAME
    (link,) = robot.robot.links
    assert link.name == ODD_NAME
    solid = RADII > 0
    for elements in (link.collisions, link.visuals):
        assert [element.name for element in elements] == NAMES[:3]
        assert [element.geometry.sphere.radius for element in elements] == RADII[solid].tolist()
        for element, center in zip(elements, CENTERS[solid], strict=True):
            assert np.array_equal(element.origin, trimesh.transformations.translation_matrix(center))
    assert {visual.material.name for visual in link.visuals} == {"spheres"}
    assert robot.robot.materials[0].color.rgba[3] < 1


def test_usda(write, scene):
    stage = Usd.Stage.Open(str(write(".usda", scene=named(scene, "12 né"))))
    root = stage.GetDefaultPrim()
    assert root.GetName() == "_12_n_"
    assert root.IsA(UsdGeom.Xform)
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert [prim.GetName() for prim in root.GetChildren()] == NAMES
    for prim, center, radius in zip(root.GetChildren(), CENTERS, RADII, strict=True):
        sphere = UsdGeom.Sphere(prim)
        assert sphere.GetRadiusAttr().Get() == radius
        extent = np.array(sphere.GetExtentAttr().Get())
        assert np.array_equal(extent, np.float32([[-radius] * 3, [radius] * 3]))
        placed = np.array(sphere.ComputeLocalToWorldTransform(Usd.TimeCode.Default()))
        assert np.array_equal(placed, trimesh.transformations.translation_matrix(center).T)


def test_a_usda_has_the_frame_of_its_mesh(write, scene, monkeypatch):
    monkeypatch.setattr("aoprecalc.io.sphere_files.scenes.find_spec", lambda name: None)
    path = write(".usda", scene=replace(scene, up="z", unit=0.0254))
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.0254
    assert np.array_equal(read_spheres(path)[0], CENTERS)


@pytest.mark.parametrize("kind", SPHERE_EXTENSIONS)
def test_the_same_set_gives_the_same_bytes_wherever_it_is_written(tmp_path, scene, kind):
    contents = []
    for name in ("a", ".0f3a.b"):
        write_sphere_set(tmp_path / f"{name}{kind}", SPHERES, {"coverage": 0.25}, scene)
        contents.append((tmp_path / f"{name}{kind}").read_bytes())
    assert contents[0] == contents[1]


@pytest.mark.parametrize("kind", SPHERE_EXTENSIONS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(tmp_path, write, kind, value):
    for spheres in (replace(SPHERES, radii=RADII + value), replace(SPHERES, centers=CENTERS - value)):
        with pytest.raises(OutputError, match="not a finite number"):
            write(kind, spheres)
    with pytest.raises(OutputError, match="not a finite number"):
        write_sphere_set(tmp_path / f"set{kind}", SPHERES, {"coverage": value})
    assert not list(tmp_path.glob("set*"))


def test_a_mesh_beyond_float32_is_refused_as_glb(tmp_path, write, scene):
    with pytest.raises(OutputError, match="not a finite number"):
        write(".glb", scene=replace(scene, positions=scene.positions * 1e39))
    assert not list(tmp_path.glob("set*"))


def test_all_kinds_are_accepted_and_named(tmp_path):
    kinds = [".json", ".csv", ".npz", ".ply", ".obj", ".glb", ".yml", ".yaml", ".urdf", ".usda"]
    for kind in kinds:
        check_sphere_extension(tmp_path / f"a{kind.upper()}")
    with pytest.raises(UsageError) as caught:
        check_sphere_extension(tmp_path / "a.txt")
    assert ", ".join(kinds) in str(caught.value)


def test_the_command_writes_a_kind_and_prints_json(cube_obj, tmp_path):
    options = ["-n", "4", "-s", "100", "-q", "--json"]
    texts = []
    for kind in (".glb", ".json"):
        path = tmp_path / f"out{kind}"
        done = CliRunner().invoke(main, ["spheres", str(cube_obj), "-o", str(path), *options])
        assert done.exit_code == 0, done.output
        texts.append(done.stdout)
    assert texts[0] == texts[1] == path.read_text()
    assert len(json.loads(texts[0])["spheres"]) == 4
    nodes = trimesh.load_scene(tmp_path / "out.glb").graph.nodes_geometry
    assert set(nodes) == {"cube", *NAMES}


def test_the_document_needs_finite_numbers():
    with pytest.raises(ValueError, match="JSON"):
        sphere_document(SPHERES, {"coverage": float("nan")})
