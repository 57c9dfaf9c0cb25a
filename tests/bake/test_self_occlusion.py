"""Parts that only their own faces occlude, against closed forms, by depth maps and by rays."""

from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.verify import measure_texture
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from gltf_kit.gltf_documents import corner
from gltf_kit.gltf_maker import GltfMaker
from shapes import box, quad, quad_uvs, scene_of_parts, triangle_a_cell

BACKENDS = pytest.mark.parametrize("backend", ["gl", "ray"])
OPTIONS = {"size": 64, "directions": 256}


def values_of(baked, number):
    """The values of the texels of a part."""
    part = baked.scene.parts[number]
    middles = baked.atlas.uvs[part.faces].mean(axis=1)
    height, width = baked.texture.values.shape
    return baked.texture.values[height - 1 - (middles[:, 1] * height).astype(int), (middles[:, 0] * width).astype(int)]


def corner_shape(offset=0.0):
    """A floor and a wall of one unit that meet at a right angle, as one shape, and the UVs of a corner."""
    floor, wall = quad((0, 0, offset), (1, 0, 0), (0, 1, 0)), quad((0, 1, offset), (1, 0, 0), (0, 0, 1))
    return np.concatenate([floor[0], wall[0]]), np.concatenate([floor[1], wall[1] + len(floor[0])])


@BACKENDS
def test_touching_boxes_do_not_darken_each_other(backend):
    made = scene_of_parts(box(), box((1, -1, -1), (3, 1, 1)))
    apart = bake_scene(made, BakeOptions(**OPTIONS, self_occlusion="part", backend=backend))
    assert apart.texture.values.min() == 1
    together = bake_scene(made, BakeOptions(**OPTIONS, backend=backend))
    assert together.texture.values.min() < 0.5


@BACKENDS
def test_a_part_keeps_its_own_shadow(backend):
    """Two corners, one in front of the other, have the values that each has alone."""
    shapes = [corner_shape(), corner_shape(0.3)]
    uvs = triangle_a_cell(8)
    options = {**OPTIONS, "unwrap": "keep", "backend": backend, "directions": 1000}
    apart = bake_scene(scene_of_parts(*shapes, uvs=uvs), BakeOptions(**options, self_occlusion="part"))
    for number, shape in enumerate(shapes):
        alone = bake_scene(scene_of_parts(shape, uvs=uvs[4 * number : 4 * number + 4]), BakeOptions(**options))
        np.testing.assert_allclose(values_of(apart, number), values_of(alone, 0), atol=0.01)
    together = bake_scene(scene_of_parts(*shapes, uvs=uvs), BakeOptions(**options))
    assert values_of(together, 0).mean() < values_of(apart, 0).mean() - 0.05


def test_depth_maps_agree_with_rays_and_verify():
    made = scene_of_parts(corner_shape(), corner_shape(0.3), box((0.2, 0.2, 0.1), (0.4, 0.4, 0.9)))
    found = {}
    for backend in ("gl", "ray"):
        options = BakeOptions(size=128, directions=512, backend=backend, self_occlusion="part", normals="flat")
        found[backend] = baked = bake_scene(made, options)
        how = VerifyOptions(points=400, rays=256)
        prepared = PreparedScene(baked.scene, baked.normals)
        errors = measure_texture(prepared, baked.atlas, baked.texture.values, how, Progress(), value=baked.options)
        assert errors.levels[0].rmse < 0.04
    valid = found["gl"].texture.valid & found["ray"].texture.valid
    difference = (found["gl"].texture.values - found["ray"].texture.values)[valid]
    assert np.sqrt(np.mean(difference**2)) < 0.015


@BACKENDS
def test_only_its_own_material_occludes_a_face(backend):
    shapes = [box(), box((1, -1, -1), (3, 1, 1)), box((-3, -1, -1), (-1, 1, 1))]
    made = scene_of_parts(*shapes)
    parts = tuple(replace(part, file_material=number) for part, number in zip(made.parts, (0, 1, 0), strict=True))
    options = BakeOptions(**OPTIONS, self_occlusion="material", backend=backend)
    baked = bake_scene(replace(made, parts=parts), options)
    assert values_of(baked, 1).min() == 1
    assert values_of(baked, 0).min() < 0.1
    assert values_of(baked, 2).min() < 0.1


@BACKENDS
def test_what_is_an_occluder_only_and_the_ground_occlude_every_part(backend):
    roof = quad((-9, -9, 1.5), (0, 18, 0), (18, 0, 0))
    made = scene_of_parts(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 0.5), (1, 0, 0), (0, 1, 0)), roof)
    options = {**OPTIONS, "self_occlusion": "part", "backend": backend, "directions": 1000}
    roofed = bake_scene(made, BakeOptions(**options, occluders_only="part 2"))
    assert values_of(roofed, 0).max() < 0.1
    assert values_of(roofed, 1).max() < 0.1
    wall = quad((0, 0, 0), (1, 0, 0), (0, 0, 1))
    upright = scene_of_parts(wall, quad((0, 3, 4), (1, 0, 0), (0, 0, 1)))
    stood = bake_scene(upright, BakeOptions(**options, ground=True, up="z"))
    np.testing.assert_allclose(stood.texture.values[stood.texture.valid], 0.5, atol=0.01)


def test_the_ground_of_every_part_is_that_of_the_scene():
    """A face that faces down, over ground that only another part touches: (h / D)^2 is open, as under a plate."""
    uvs = np.concatenate([quad_uvs((0, 0), (0.45, 1)), quad_uvs((0.55, 0), (1, 1))])
    down, low = quad((0, 0, 1), (0, 0.02, 0), (0.02, 0, 0)), quad((5, 5, 0.5), (0.1, 0, 0), (0, 0.1, 0))
    options = {"unwrap": "keep", "ground": True, "up": "z", "max_distance": 1.25, "self_occlusion": "part"}
    baked = bake_scene(scene_of_parts(down, low, uvs=uvs), BakeOptions(size=32, directions=2000, **options))
    np.testing.assert_allclose(values_of(baked, 0), 0.4**2, atol=5e-3)


def test_the_primitives_of_a_node_are_one_object(tmp_path):
    maker = GltfMaker(tmp_path)
    materials = [maker.add("materials", {"name": name}) for name in ("wood", "iron")]
    mesh = maker.mesh(*(corner(maker, material=material) for material in materials))
    maker.node(mesh=mesh)
    maker.node(mesh=mesh, translation=[3, 0, 0])
    parts = maker.load().parts
    assert [part.file_object for part in parts] == [0, 0, 1, 1]
    assert [part.file_material for part in parts] == [0, 1, 0, 1]


def test_the_groups_of_an_obj_object_are_one(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    text += "o jaw\ng teeth\nusemtl bone\nf 1 2 3\ng gum\nusemtl skin\nf 1 2 4\no skull\nusemtl bone\nf 2 3 4\n"
    (tmp_path / "head.obj").write_text(text)
    parts = load_scene(tmp_path / "head.obj").parts
    assert [part.file_object for part in parts] == [0, 0, 1]
    assert [part.file_material for part in parts] == [0, 1, 0]


def test_verify_takes_it_from_the_texture(tmp_path):
    maker = GltfMaker(tmp_path)
    mesh = maker.mesh(corner(maker))
    maker.node(mesh=mesh)
    maker.node(mesh=mesh, translation=[0, 0.2, 0])
    options = ao.BakeOptions(size=64, directions=256, self_occlusion="part", backend="ray")
    files = ao.bake(maker.save(), options).save(tmp_path / "out.glb")
    report = ao.verify(files.mesh, options=ao.VerifyOptions(points=200, rays=64))
    assert report.options.self_occlusion == "part"
    other = ao.verify(files.mesh, options=ao.VerifyOptions(points=200, rays=64, self_occlusion="all"))
    assert report.error < other.error
