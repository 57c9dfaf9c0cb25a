"""Spheres read back from every format that is written, and from files of other programs."""

import numpy as np
import pytest
import trimesh
from pxr import Gf, Usd, UsdGeom

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS, read_spheres, write_sphere_set
from aoprecalc.types import SphereSet

RNG = np.random.default_rng(3)
CENTERS = RNG.uniform(-2, 2, (12, 3)) * [1, 100, 1e-3]  # beyond ten, where names no longer sort as numbers
RADII = RNG.uniform(0.01, 2, 12)
RADII[5] = 0.0

# How exactly a format keeps a number: as float64, or with the float32 points of an icosphere, or with its triangles.
EXACT = {".json", ".csv", ".npz", ".ply", ".yml", ".yaml", ".usda", ".urdf"}


def as_sets(centers, radii):
    return SphereSet(centers, radii, 17, True, "lloyd", "mean", 1000, 3)


@pytest.mark.parametrize("kind", SPHERE_EXTENSIONS)
def test_every_format_comes_back(kind, tmp_path, cube_obj):
    path = tmp_path / f"set{kind}"
    write_sphere_set(path, as_sets(CENTERS, RADII), {}, load_scene(cube_obj))
    centers, radii = read_spheres(path)
    there = RADII > 0 if kind == ".urdf" else RADII >= 0  # URDF leaves out spheres of radius 0
    tolerance = 0 if kind in EXACT else 1e-6
    np.testing.assert_allclose(centers, CENTERS[there], rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(radii, RADII[there], rtol=tolerance)
    assert centers.dtype == radii.dtype == np.float64


@pytest.mark.parametrize("stem", ["sphere_3", "sphere", "ball"])
def test_a_mesh_that_is_a_sphere_is_none_of_its_spheres(stem, tmp_path):
    mesh = tmp_path / f"{stem}.ply"
    trimesh.creation.icosphere(subdivisions=2, radius=5).export(mesh)
    write_sphere_set(tmp_path / "set.glb", as_sets(CENTERS[:3], RADII[:3]), {}, load_scene(mesh))
    centers, radii = read_spheres(tmp_path / "set.glb")
    np.testing.assert_allclose(centers, CENTERS[:3], atol=1e-6)
    np.testing.assert_allclose(radii, RADII[:3], rtol=1e-6)


@pytest.mark.parametrize("kind", [".obj", ".glb"])
def test_balls_of_other_programs_are_found_among_objects(kind, tmp_path):
    """Coarse and fine balls, a box, a dome, a cone: only what is a whole sphere counts."""
    scene = trimesh.Scene()
    ball = trimesh.creation.uv_sphere(radius=0.5, count=[16, 16])
    for name, shape, place in (
        ("left", ball, [-3, 1, 0]),
        ("right", trimesh.creation.icosphere(subdivisions=1, radius=2), [4, 0, 9]),
        ("box", trimesh.creation.box(), [0, 0, 0]),
        ("dome", ball.slice_plane([0, 0, 0], [0, 0, 1]), [0, 3, 0]),
        ("cone", trimesh.creation.cone(1, 2), [0, 6, 0]),
    ):
        scene.add_geometry(
            shape, node_name=name, geom_name=name, transform=trimesh.transformations.translation_matrix(place)
        )
    path = tmp_path / f"scene{kind}"
    scene.export(path)
    centers, radii = read_spheres(path)
    np.testing.assert_allclose(centers, [[-3, 1, 0], [4, 0, 9]], atol=1e-5)
    np.testing.assert_allclose(radii, [0.5, 2], rtol=1e-5)


def test_a_mesh_without_balls_is_refused(cube_obj):
    with pytest.raises(InputError, match="2 objects found, but no sphere"):
        read_spheres(cube_obj)


ROBOT = """<robot name="arm">
  <link name="base">
    <collision><origin xyz="1 2 3"/><geometry><sphere radius="0.5"/></geometry></collision>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
    <visual><geometry><sphere radius="9"/></geometry></visual>
  </link>
  <link name="arm">
    <collision><origin xyz="1 0 0" rpy="0 0 1"/><geometry><sphere radius="0.25"/></geometry></collision>
  </link>
  <link name="hand"><collision><geometry><sphere radius="0.125"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 10" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/></joint>
  <joint name="grip" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="2 0 0"/></joint>
</robot>
"""


def test_the_links_of_a_robot_are_where_its_joints_put_them(save):
    """The arm is turned by a quarter about z, so that its x axis is the robot's y axis."""
    centers, radii = read_spheres(save("arm.urdf", ROBOT))
    np.testing.assert_allclose(centers, [[1, 2, 3], [0, 1, 10], [0, 2, 10]], atol=1e-12)
    assert radii.tolist() == [0.5, 0.25, 0.125]


def test_the_frames_are_those_of_yourdfpy(save):
    import yourdfpy

    turned = ROBOT.replace('rpy="0 0 1.5707963267948966"', 'rpy="0.3 -0.7 2"')
    turned = turned.replace('<origin xyz="2 0 0"/>', '<origin xyz="2 0 0" rpy="-1 0.2 0.4"/>')
    path = save("arm.urdf", turned.replace('hand"><collision>', 'hand"><collision><origin xyz="0.5 6 7"/>'))
    robot = yourdfpy.URDF.load(path)
    centers, _ = read_spheres(path)
    at = [robot.get_transform("arm", "base") @ [1, 0, 0, 1], robot.get_transform("hand", "base") @ [0.5, 6, 7, 1]]
    np.testing.assert_allclose(centers[1:], np.array(at)[:, :3], atol=1e-12)


CUROBO = "{collision_spheres: {hand: [{center: [1, 2, 3], radius: 1e-2}, {center: [0, 0, .5], radius: 2}], foot: []}}"


@pytest.mark.parametrize(
    "text", [CUROBO, f"robot_cfg: {{kinematics: {CUROBO}}}", f"kinematics: {CUROBO}", f"# spheres\n{CUROBO}"]
)
def test_spheres_of_curobo(text, save):
    centers, radii = read_spheres(save("franka.yml", text))
    assert centers.tolist() == [[1, 2, 3], [0, 0, 0.5]]
    assert radii.tolist() == [0.01, 2]


def test_usd_stages_of_other_programs(tmp_path):
    path = tmp_path / "stage.usda"
    stage = Usd.Stage.CreateNew(str(path))
    group = UsdGeom.Xform.Define(stage, "/world/group")
    group.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    group.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    ball = UsdGeom.Sphere.Define(stage, "/world/group/ball")
    ball.GetRadiusAttr().Set(0.5)
    ball.AddTranslateOp().Set(Gf.Vec3d(0, 0, 10))
    UsdGeom.Cube.Define(stage, "/world/box")
    UsdGeom.Sphere.Define(stage, "/world/default")  # of radius 1
    stage.Save()
    centers, radii = read_spheres(path)
    assert centers.tolist() == [[1, 2, 23], [0, 0, 0]]
    assert radii.tolist() == [1, 1]


def test_our_stages_need_no_usd(tmp_path, monkeypatch):
    monkeypatch.setattr("aoprecalc.io.sphere_files.scenes.find_spec", lambda name: None)
    path = tmp_path / "set.usda"
    write_sphere_set(path, as_sets(CENTERS, RADII), {}, None)
    assert np.array_equal(read_spheres(path)[0], CENTERS)
    path.write_text(path.read_text().replace("sphere_0", "ball"))
    with pytest.raises(InputError, match="is not a stage that aoprecalc wrote; `pip install usd-core`"):
        read_spheres(path)


STRETCHED = """#usda 1.0
def Sphere "a" {
    float3 xformOp:scale = (1, 2, 1)
    uniform token[] xformOpOrder = ["xformOp:scale"]
}
"""
SPHERE = "<collision><geometry><sphere radius='1'/></geometry></collision>"
PAIR = "<origin xyz='1 2'/>"
LOOP = "".join(f"<joint><parent link='{a}'/><child link='{b}'/></joint>" for a, b in ("ab", "ba"))
PLY = "ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n1 2 3 4\n"
XYZ = "".join(f"property float {name}\n" for name in "xyz")
BAD = [
    ("a.ply", "", "PLY header"),
    ("a.ply", PLY.format(XYZ), "lack radius; expected x, y, z, radius"),
    ("a.ply", PLY.format(XYZ + "property float radius\n").replace("1 2 3 4", "1 2 3"), "promises 1 of 'vertex'"),
    ("a.ply", PLY.format(XYZ + "property float radius\n").replace("3 4", "3 -4"), "finite radii >= 0"),
    ("a.yml", "a: [", "cannot be read as YAML"),
    ("a.yml", "a: &a [1]\nb: *a", "has an alias"),
    ("a.yml", "[" * 2000, "cannot be read as YAML"),
    *[("a.yml", f"a: !!{value}", "cannot be read as YAML") for value in ("bool foo", 'int ""', "timestamp foo")],
    ("a.yml", "{}", "holds no collision_spheres"),
    ("a.yml", "collision_spheres: spheres/franka.yml", "holds no collision_spheres"),
    ("a.yml", "collision_spheres: {}", "at least one sphere"),
    ("a.yml", "collision_spheres: {a: [{center: [1, 2, 3]}]}", "no center .* and radius .'radius'"),
    ("a.yml", "collision_spheres: {a: [{center: [1, 2], radius: 1}]}", "at least one sphere"),
    ("a.yml", "collision_spheres: {a: 1}", "no center"),
    ("a.yml", "collision_spheres: {a: [{center: [1, 2, x], radius: 1}]}", "no center"),
    (
        "a.yml",
        CUROBO.replace("foot: []", "foot: [{center: [0, 0, 0], radius: 1}]"),
        "2 links have spheres .'hand', 'foot'",
    ),
    ("a.urdf", "<robot>", "cannot be read as URDF"),
    ("a.urdf", "<sdf/>", "its root is 'sdf', robot was expected"),
    ("a.urdf", "<robot/>", "at least one sphere"),
    ("a.urdf", '<!DOCTYPE robot [<!ENTITY a "aaaa">]><robot>&a;</robot>', "document type or entities"),
    ("a.urdf", f"<robot><link name='a'>{SPHERE}</link><link name='b'/>{LOOP}</robot>", "joints form a circle"),
    ("a.urdf", f"<robot><link>{SPHERE.replace('1', 'one')}</link></robot>", "could not convert"),
    ("a.urdf", f"<robot><link>{SPHERE.replace('radius', 'size')}</link></robot>", "a sphere has no radius"),
    (
        "a.urdf",
        f"<robot><link>{SPHERE.replace('<geo', PAIR + '<geo')}</link></robot>",
        "three numbers",
    ),
    ("a.usda", "", "cannot be read as USD"),
    ("a.usda", "#usda 1.0\n(\n", "cannot be read as USD"),
    ("a.usda", '#usda 1.0\ndef Cube "a" {}\n', "at least one sphere"),
    ("a.usda", STRETCHED, "/a is stretched"),
    ("a.usda", '#usda 1.0\ndef Sphere "a" (references = @./b.usda@</b>) {}\n', "refers to other files"),
    ("a.obj", "v 1 2 3\n", "no faces"),
    ("a.glb", "glTF", "a.glb"),
]


def test_a_document_type_in_another_encoding_is_refused(tmp_path):
    robot = f'<!DOCTYPE r [<!ENTITY a "1">]><robot><link>{SPHERE}</link></robot>'
    for encoding in ("utf-16", "utf-16-le"):
        (tmp_path / "a.urdf").write_bytes(robot.encode(encoding))
        with pytest.raises(InputError, match="cannot be read as URDF"):
            read_spheres(tmp_path / "a.urdf")


@pytest.mark.parametrize(("name", "content", "message"), BAD)
def test_damaged_files_are_refused_in_one_line(save, name, content, message):
    with pytest.raises(InputError, match=message) as error:
        read_spheres(save(name, content))
    assert "\n" not in str(error.value)


LINES = {".csv", ".yml", ".yaml", ".obj"}  # formats whose lines stand for themselves


@pytest.mark.parametrize("kind", [kind for kind in SPHERE_EXTENSIONS if kind not in LINES])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_cut_files_are_refused(kind, share, tmp_path):
    path = tmp_path / f"set{kind}"
    write_sphere_set(path, as_sets(CENTERS, RADII), {}, None)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError) as error:
        read_spheres(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", SPHERE_EXTENSIONS)
def test_what_is_no_regular_file_is_not_waited_for(kind, tmp_path):
    (tmp_path / f"folder{kind}").mkdir()
    with pytest.raises(InputError, match="folder"):
        read_spheres(tmp_path / f"folder{kind}")
