"""Positions of maps (UTM: millions of metres, millimetre detail) were rounded to float32, to half a metre, in a GLB."""

import json
import struct

import numpy as np
import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.api.documents import PointError, position_texts
from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.io.images import read_pixels
from aoprecalc.mesh.surface import local_origin
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import issues, needs_validator
from shapes import box, join

FAR = np.array([500012.345, 4649776.125, 120.5])
OPTIONS = ao.BakeOptions(size=64, directions=64, unwrap="uvunwrap")
STOOL = join(box((-1, -1, 1), (1, 1, 1.3)), box((-0.4, -0.4, 0), (0.4, 0.4, 1.001)))


def write_obj(path, away):
    positions, faces = STOOL
    positions = np.round(positions, 3) + away
    lines = [*("v {!r} {!r} {!r}".format(*point) for point in positions.tolist())]
    for name, chosen in (("seat", faces[: len(faces) // 2]), ("leg", faces[len(faces) // 2 :])):
        lines += [f"o {name}", *("f {} {} {}".format(*face) for face in (chosen + 1).tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def stool(tmp_path_factory):
    """The stool far away: the path, and its folder with stool_ao.glb, .gltf, .ply and .obj."""
    folder = tmp_path_factory.mktemp("far")
    path = write_obj(folder / "stool.obj", FAR)
    result = ao.bake(path, OPTIONS)
    for extension in ("glb", "gltf", "ply", "obj"):
        (folder / extension).mkdir()
        result.save(folder / extension / f"stool_ao.{extension}")
    return path


def written(stool, extension):
    return stool.parent / extension / f"stool_ao.{extension}"


@pytest.mark.parametrize("extension", ["glb", "gltf"])
def test_a_node_moves_what_is_stored_about_a_local_origin(stool, extension):
    path = written(stool, extension)
    scene = load_scene(path)
    assert np.abs(scene.corners - load_scene(stool).corners).max() < 1e-6
    assert len(scene.positions) == len(load_scene(stool).positions)  # parts that touch still do
    theirs = trimesh.load_scene(path, process=False)
    assert np.abs(theirs.bounds - [scene.positions.min(0), scene.positions.max(0)]).max() < 1e-6
    assert [part.name for part in scene.parts] == ["seat", "leg"]
    text = path.read_bytes()
    document = json.loads(text if extension == "gltf" else text[20 : 20 + struct.unpack_from("<I", text, 12)[0]])
    positions = [document["accessors"][m["primitives"][0]["attributes"]["POSITION"]] for m in document["meshes"]]
    assert all(np.abs(accessor[bound]).max() < 4 for accessor in positions for bound in ("min", "max"))
    (root,) = document["scenes"][0]["nodes"]
    assert document["nodes"][root]["children"] == [0, 1]


@needs_validator
def test_the_validator_finds_nothing(stool):
    assert issues(written(stool, "glb"), written(stool, "gltf")) == [[], []]


@pytest.mark.parametrize("extension", ["ply", "obj"])
def test_ply_and_obj_keep_every_digit(stool, extension):
    assert np.array_equal(load_scene(written(stool, extension)).corners, load_scene(stool).corners)


def test_the_texture_is_that_of_the_mesh_at_the_origin(tmp_path, stool):
    near = write_obj(tmp_path / "stool.obj", 0)
    textures = []
    for path in (near, stool):
        ao.bake(path, OPTIONS).save(tmp_path / f"{len(textures)}.png")
        textures.append(read_pixels(tmp_path / f"{len(textures)}.png")[:, :, 0])
    assert textures[0].std() > 0.1
    assert np.abs(textures[0] - textures[1]).max() <= 1 / 255


@pytest.mark.parametrize("extension", ["ply", "obj", "glb"])
def test_a_gltf_whose_node_has_the_offset_keeps_its_digits(tmp_path, extension):
    maker = GltfMaker(tmp_path)
    positions, faces = STOOL
    points = positions.astype("<f4")
    accessors = {"POSITION": maker.accessor(points, min=points.min(0).tolist(), max=points.max(0).tolist())}
    primitive = {"attributes": accessors, "indices": maker.accessor(faces.astype("<u2").reshape(-1))}
    maker.node(mesh=maker.mesh(primitive), translation=FAR.tolist())
    scene = maker.load()
    path = tmp_path / "out" / f"stool_ao.{extension}"
    path.parent.mkdir()
    ao.bake(scene.path, OPTIONS).save(path)
    assert np.array_equal(load_scene(path).corners, scene.corners)
    assert np.abs(scene.corners - FAR - STOOL[0][STOOL[1]]).max() < 1e-6


@pytest.mark.parametrize("extension", ["json", "csv", "npz", "ply", "obj", "glb", "yml", "urdf", "usda"])
def test_spheres_keep_their_digits(stool, tmp_path, extension):
    fitted = ao.fit_spheres(stool, ao.SphereOptions(spheres=4, samples=500))
    path = tmp_path / f"stool.{extension}"
    fitted.save(path)
    centers, radii = ao.load_spheres(path)
    assert np.abs(centers - fitted.centers).max() < 1e-6
    assert np.abs(radii - fitted.radii).max() < 1e-6
    if extension == "glb":
        scene = load_scene(path)
        mesh = scene.corners[scene.parts[0].faces]
        assert np.abs(mesh - load_scene(stool).corners).max() < 1e-6


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_near_the_origin_there_is_none(scale):
    positions = STOOL[0] * scale
    assert not local_origin(positions).any()
    assert not local_origin(positions + 7 * scale).any()
    moved = positions + 1e4 * scale
    origin = local_origin(moved)
    assert np.abs(moved - origin).max() <= 2 * np.ptp(moved, axis=0).max()
    assert np.array_equal(moved - origin + origin, moved)


def test_a_binary_stl_far_away_is_told_to_be_coarse(tmp_path):
    for away, warned in ((0, False), (FAR, True)):
        path = tmp_path / "stool.stl"
        trimesh.Trimesh(STOOL[0] + away, STOOL[1], process=False).export(path)
        warnings = load_scene(path).warnings
        assert any("float32" in line and "0.5 units" in line for line in warnings) == warned


@pytest.mark.parametrize("far", [0.0, 500_000.0, -4.6e6, 1e9])
def test_points_are_named_in_digits_that_tell_them_apart(far):
    places = np.random.default_rng(0).random((10, 3))
    points = [PointError(tuple((place + far).tolist()), (0.0, 0.0), 0.0, 0.0, 0.0) for place in places]
    named = np.array(position_texts(points), float) - far
    assert np.abs(named - places).max() < 1e-3
    (alone,) = np.array(position_texts(points[:1]), float) - far
    assert np.abs(alone - places[0]).max() < 1e-2


def test_short_numbers_stay_short():
    points = [PointError(place, (0.0, 0.0), 0.0, 0.0, 0.0) for place in ((0.0, 1 / 3, 1.0), (2.0, 0.5, 0.0))]
    assert position_texts(points) == [("0", "0.3333", "1"), ("2", "0.5", "0")]
    assert position_texts([]) == []


def test_a_position_that_is_not_finite_is_named_in_full(tmp_path):
    (tmp_path / "a.obj").write_text("v 500000.125 4600000.25 nan\nv 0 0 0\nv 1 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"such as \(500000\.125, 4600000\.25, nan\)"):
        load_scene(tmp_path / "a.obj")
