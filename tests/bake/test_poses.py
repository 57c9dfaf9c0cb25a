"""Bakes in poses of an animation, against bakes of meshes that stand so, and against rays."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import with_poses
from aoprecalc.errors import ArgumentError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, build_layout
from aoprecalc.types import Texels
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.gather import gather
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import LocalVisibility
from gltf_kit.baked_by_hand import make_atlas
from gltf_kit.gltf_animated import (
    HINGE,
    box_with_lid,
    box_with_still_lid,
    clip,
    flat_primitive,
    open_box,
    strip_over_a_joint,
    turn,
)
from gltf_kit.gltf_maker import GltfMaker
from shapes import triangle_a_cell

backends = pytest.mark.parametrize("backend", ["gl", "ray"])


@pytest.fixture
def gltf(tmp_path):
    return GltfMaker(tmp_path)


def bake(scene, backend="ray", **options):
    return bake_scene(
        scene, BakeOptions(**{"size": 64, "directions": 256, "unwrap": "keep", "backend": backend, **options})
    )


def values(scene, *pose, **options):
    return bake(scene, pose=pose, **options).texture.values


def measured(scene, backend, **options):
    """What is measured of each texel before an image is fitted to it."""
    options = BakeOptions(size=64, directions=256, backend=backend, **options)
    scene = with_poses(assign_roles(scene, options, share=options.instances == "share"), options)
    with open_backend(options, Progress()) as opened:
        atlas = make_atlas(scene, "keep")
        setup = BakeSetup(opened, BakeInputs(scene, atlas, scene.normals, options))
        visibility = LocalVisibility(setup, setup.sides[0], 512, len(setup.texels), Progress())
        return gather(setup, setup.sides[0], visibility, len(setup.texels))


@pytest.fixture
def lidded(tmp_path):
    """The box whose lid opens within a second, and the same box that stands as it does at 0 and at 1 second."""
    for name in ("moving", "closed", "open"):
        (tmp_path / name).mkdir()
    moving = box_with_lid(GltfMaker(tmp_path / "moving")).load()
    return moving, *(box_with_still_lid(GltfMaker(tmp_path / name), angle).load() for name, angle in
                     (("closed", 0), ("open", 90)))  # fmt: skip


@backends
@pytest.mark.parametrize("ground", [False, True])
def test_a_pose_is_the_mesh_that_stands_so(lidded, backend, ground):
    moving, *still = lidded
    closed, opened = (values(moving, pose, backend=backend, ground=ground) for pose in ("open@0", "open@1"))
    for found, mesh in zip((closed, opened), still, strict=True):
        assert np.array_equal(found, values(mesh, backend=backend, ground=ground))
    assert np.abs(opened - closed).max() > 0.3


def test_no_pose_is_the_rest_pose(lidded):
    moving = lidded[0]
    assert np.array_equal(values(moving), values(moving, "open@0"))


@backends
@pytest.mark.parametrize("estimator", ["ratio", "mean"])
def test_two_poses_are_the_mean_of_both_where_nothing_turns(tmp_path, backend, estimator):
    """A lid that rises: in both poses the same directions lie in front of every face."""
    maker = box_with_lid(GltfMaker(tmp_path))
    clip(maker, "lift", (1, "translation", [0, 1], [HINGE + (0, 0.2, 0), HINGE + (0, 1, 0)]))
    scene, how = maker.load(), {"backend": backend, "estimator": estimator}
    both, low, high = (
        measured(scene, pose=pose, **how).values for pose in (("lift@0", "lift@1"), ("lift@0",), ("lift@1",))
    )
    assert np.abs(both - (low + high) / 2).max() < 1e-6
    assert np.abs(low - high).max() > 0.2


@backends
@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1)], ids=["turned", "mirrored"])
def test_bent_normals_are_those_of_the_rest_pose_where_all_turns(tmp_path, backend, scale):
    maker = box_with_lid(GltfMaker(tmp_path))
    maker.json["nodes"][1]["translation"] = (HINGE + (0, 0.6, 0)).tolist()
    root = maker.node(children=[0, 1])
    aside = turn((0.6, 0, 0.8), 70)
    clip(maker, "fall", (root, "rotation", [0], [aside]), (root, "scale", [0], [scale]))
    scene, how = maker.load(), {"backend": backend, "bent_normals": True}
    rest, fallen, both = (measured(scene, pose=pose, **how) for pose in ((), ("fall@0",), ("fall@0", "open@0")))
    for posed in (fallen, both):
        cosines = np.einsum("kx,kx->k", rest.vectors, posed.vectors)
        cosines /= np.linalg.norm(rest.vectors, axis=1) * np.linalg.norm(posed.vectors, axis=1)
        assert np.median(np.degrees(np.arccos(cosines.clip(-1, 1)))) < 2


@backends
def test_bent_normals_of_instances_are_those_of_the_first_where_another_turns(tmp_path, backend):
    """Two open boxes far apart, which see as much wherever they stand."""
    maker = GltfMaker(tmp_path)
    walls = open_box()[0]
    mesh = maker.mesh(flat_primitive(maker, walls, triangle_a_cell(len(walls[1]))))
    maker.node(name="still", mesh=mesh)
    rolls = maker.node(name="rolls", mesh=mesh, translation=[200, 0, 0])
    clip(maker, "roll", (rolls, "rotation", [0], [turn((1, 0, 0), 90)]))
    scene, how = maker.load(), {"backend": backend, "bent_normals": True, "instances": "share"}
    rest, rolled = (measured(scene, pose=pose, **how) for pose in ((), ("roll@0",)))
    cosines = np.einsum("kx,kx->k", rest.vectors, rolled.vectors)
    cosines /= np.linalg.norm(rest.vectors, axis=1) * np.linalg.norm(rolled.vectors, axis=1)
    assert np.median(np.degrees(np.arccos(cosines.clip(-1, 1)))) < 5


def test_a_time_has_one_spelling():
    assert ValueOptions(pose=("walk@1.0", "walk@1", "walk@01", "a@b@.50")).pose == ("walk@1", "a@b@0.5")


def test_the_order_of_poses_does_not_matter_nor_does_a_pose_twice(lidded):
    poses = ("open@0", "open@0.3", "open@1")
    one = values(lidded[0], *poses)
    assert np.array_equal(one, values(lidded[0], *poses[::-1]))
    assert np.array_equal(one, values(lidded[0], *poses, "open@0.3"))


def test_a_strip_that_bends_by_a_right_angle_sees_three_quarters_of_the_light_at_most(gltf):
    """Beside the fold of two long half planes a point sees half of its cosine-weighted light, (1 + cos 90) / 2."""
    scene = strip_over_a_joint(gltf).load()
    assert (values(scene)[bake(scene).texture.valid] == 1).all()
    bent = bake(scene, pose=("bend@1",), two_sided=False)
    assert 0.45 < bent.texture.values[bent.texture.valid].min() < 0.75
    twice = bake(scene, pose=("bend@0", "bend@1"))
    expected = (1 + bent.texture.values) / 2
    assert np.abs(twice.texture.values - expected)[bent.texture.valid].max() < 0.02


def test_a_part_that_a_pose_hides_counts_in_the_others_alone(lidded, tmp_path):
    maker = box_with_lid(GltfMaker(tmp_path))
    clip(maker, "hide", (1, "scale", [0, 1], [[1, 1, 1], [0, 0, 0]]))
    scene = maker.load()
    shown, both = bake(scene, pose=("hide@0",)), bake(scene, pose=("hide@0", "hide@1"))
    texels = np.flatnonzero(shown.texture.valid).astype(np.int32)
    layout = build_layout(scene, shown.atlas, 64, 64)
    faces = CPURasterizer(layout).samples(Texels(64, 64, texels), CENTER).faces
    lid = faces >= scene.parts[1].start
    change = (both.texture.values - shown.texture.values)[shown.texture.valid]
    assert (shown.texture.values[shown.texture.valid][lid] == 1).all()
    assert np.abs(change[lid]).max() < 1e-6
    assert change[(faces >= 0) & ~lid].mean() > 0.1


def test_new_uvs_are_those_of_the_rest_pose(lidded):
    plain, posed = (bake(lidded[0], unwrap="xatlas", pose=pose) for pose in ((), ("open@1",)))
    assert np.array_equal(plain.atlas.uvs, posed.atlas.uvs)
    assert np.array_equal(plain.normals, posed.normals)
    assert np.array_equal(plain.scene.positions, posed.scene.positions)


@pytest.mark.parametrize("poses", [("open@1",), ("open@0", "open@0.5", "open@1")])
def test_verify_casts_its_rays_in_the_same_poses(lidded, tmp_path, poses):
    path = tmp_path / "made.glb"
    result = ao.bake(str(tmp_path / "moving" / "made.glb"), BakeOptions(size=256, directions=1000, pose=poses))
    result.save(path)
    few = ao.VerifyOptions(points=1500, rays=576)
    assert ao.verify(path, options=few).error < 0.03
    assert ao.verify(path, options=few).options.pose == poses
    assert ao.verify(result.mesh, options=few).error < 0.03
    assert ao.verify(path, options=replace(few, pose=("open@0",))).error > 0.1


def test_what_is_written_keeps_its_rest_pose_and_its_animation(lidded, tmp_path):
    source = tmp_path / "moving" / "made.glb"
    ao.bake(str(source), BakeOptions(size=32, directions=64, unwrap="keep", pose="open@1")).save(tmp_path / "a.glb")
    ao.bake(str(source), BakeOptions(size=32, directions=64, unwrap="keep")).save(tmp_path / "b.glb")
    posed, plain = (ao.load(tmp_path / name)._scene for name in ("a.glb", "b.glb"))
    assert np.array_equal(posed.corners, plain.corners)
    assert np.array_equal(posed.normals, plain.normals)
    opened = [with_poses(scene, ValueOptions(pose=("open@1",))).poses["open@1"] for scene in (posed, plain)]
    assert np.array_equal(opened[0].corners, opened[1].corners)
    assert not np.array_equal(opened[0].corners, posed.corners)


def test_poses_go_along_to_other_processes(lidded):
    """As on a cluster: pickled inputs without the document give the same texture."""

    class Elsewhere(LocalVisibility):
        def __init__(self, setup, side, *rest):
            inputs = replace(setup.inputs, scene=replace(setup.inputs.scene, document=None))
            there = BakeSetup(setup.backend, pickle.loads(pickle.dumps(inputs)))
            super().__init__(there, there.sides[setup.sides.index(side)], *rest)

    options = BakeOptions(size=64, directions=64, unwrap="keep", backend="ray", pose=("open@0.5", "open@1"))
    here, there = (bake_scene(lidded[0], options, make_visibility=made) for made in (LocalVisibility, Elsewhere))
    assert np.array_equal(here.texture.values, there.texture.values)


def test_pictures_show_a_pose(lidded, tmp_path):
    """The picture of the mesh in a pose is that of the mesh that stands so with the same texture."""
    options = BakeOptions(size=32, directions=64, unwrap="keep")
    moving, still = (ao.bake(str(tmp_path / name / "made.glb"), options) for name in ("moving", "open"))
    look = ao.PreviewOptions(size=(80, 60), backend="ray", shading="clay")
    expected = still.preview(look)
    assert not np.array_equal(moving.preview(look), expected)
    opened = replace(look, pose="open@1")
    assert np.array_equal(moving.preview(opened), expected)
    moving.save(tmp_path / "out.glb")
    assert np.abs(ao.preview(tmp_path / "out.glb", opened).image.astype(int) - expected).max() <= 2
    with pytest.raises(ArgumentError, match="is no animation"):
        ao.preview(tmp_path / "out.glb", replace(look, pose="shut@1"))
    with pytest.raises(ArgumentError, match="an animation and seconds"):
        replace(look, pose="open")


@pytest.mark.parametrize("pose", ["open", "open@", "@1", "open@-1", "open@nan", "open@1e3", ""])
def test_what_is_no_pose_is_refused(pose):
    with pytest.raises(ArgumentError, match=r"an animation and seconds such as 'walk@0.5' were expected"):
        BakeOptions(pose=pose)


def test_a_detailed_mesh_has_no_pose():
    with pytest.raises(ArgumentError, match="pose is of the mesh, but light is measured on the one of high; omit one"):
        BakeOptions(pose="open@1", high=("detailed.glb",))


def test_the_command_says_what_is_wrong(lidded, tmp_path, command):
    source, output = tmp_path / "moving" / "made.glb", tmp_path / "out.glb"
    for pose, words in (
        ("openn@1", "--pose has 'openn@1', but 'openn' is no animation (did you mean 'open'?)"),
        ("open@2", "lasts from 0 to 1 seconds"),
        ("open", "--pose has 'open'; an animation and seconds such as 'walk@0.5' were expected"),
    ):
        done = command("bake", source, "--pose", pose, "-o", output)
        assert done.returncode == 2
        assert words in done.stderr
        assert done.stderr.count("\n") == 1
    assert not output.exists()
