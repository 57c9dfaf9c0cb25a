"""Visibility vectors, bent normals and spherical harmonics, against closed forms and against slow sums."""

from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.bent_normals import TexelSurface, _nearest, bent_normals, encoded, spherical_harmonics
from aoprecalc.options import BakeOptions
from aoprecalc.raster.padding import find_padding, pad
from aoprecalc.types import REVERSED_WINDING
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.integrand import Integrand
from gltf_kit.gltf_animated import flat_primitive, open_box, turn
from gltf_kit.gltf_maker import GltfMaker
from shapes import ball, box, join, quad, quad_uvs, rotation, scene, scene_of_parts, spun, triangle_a_cell

BACKENDS = ["gl", "ray"]


def baked(made, **options):
    """Bake a scene with its bent normals; returns them, the harmonics, and the bake."""
    options = BakeOptions(**{"size": 64, "directions": 1024, "normals": "flat", "bent_normals": True, **options})
    found = bake_scene(made, options)
    return bent_normals(found, options), spherical_harmonics(found, options), found


def normals_at(found):
    """The shading normals of the texels."""
    surface, image = TexelSurface.of(found), np.zeros((*found.texture.valid.shape, 3))
    image.reshape(-1, 3)[surface.index] = surface.normals()
    return image


def degrees(one, other):
    return np.degrees(np.arccos(np.clip((np.asarray(one) * other).sum(axis=-1), -1, 1)))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("weight", "share", "within"), [("cosine", 2 / 3, 0.002), ("uniform", 1 / 2, 0.01)])
def test_an_open_plane_has_its_normal_and_two_thirds_of_it(backend, weight, share, within):
    """The mean of w over the hemisphere: 2/3 n by the cosine, 1/2 n if all weigh the same.

    The latter is less exact: the weight jumps at the horizon.
    """
    bent, sh, _ = baked(
        scene(*quad((0, 0, 0), (3, 1, 0), (-1, 2, 2)), quad_uvs((0, 0), (1, 1))), weight=weight, backend=backend
    )
    normal = np.cross((3, 1, 0), (-1, 2, 2)) / np.linalg.norm(np.cross((3, 1, 0), (-1, 2, 2)))
    assert (sh[..., 0] == 1).all()
    assert sh[8:-8, 8:-8, 1:] == pytest.approx(np.broadcast_to(share * normal, (48, 48, 3)), abs=within)
    assert degrees(bent, normal)[8:-8, 8:-8].max() < np.degrees(2 * within / share)


def corner(depth=4.0, height=2000.0, length=4000.0):
    """A floor, x from 0 to `depth`, and a wall of `height` along its side x = 0."""
    floor = quad((0, -length / 2, 0), (depth, 0, 0), (0, length, 0))
    wall = quad((0, -length / 2, 0), (0, length, 0), (0, 0, height))
    return scene(*join(floor, wall), np.concatenate([quad_uvs((0, 0), (0.5, 1)), quad_uvs((0.6, 0), (1, 1))]))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_floor_at_an_endless_wall(backend):
    """Half of the directions are left, those with x > 0: the vector is their mean by the cosine.

    Over w = (sin t cos p, sin t sin p, cos t) with the density cos t / pi, |p| < pi/2:
        C = 1/pi (integral of sin^2 t cos t dt * 2, 0, pi * integral of sin t cos^2 t dt) = (2 / (3 pi), 0, 1/3)
    """
    bent, sh, _ = baked(corner(), size=(64, 8), backend=backend, shadow_size=2048)
    expected = np.array([2 / (3 * np.pi), 0, 1 / 3])
    middle = slice(4, 24)
    assert sh[4, middle, 0] == pytest.approx(0.5, abs=0.01)
    assert sh[4, middle, 1:] == pytest.approx(np.broadcast_to(expected, (20, 3)), abs=0.01)
    assert degrees(bent[4, middle], expected / np.linalg.norm(expected)).max() < 1.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_bottom_of_a_cup_looks_up(backend):
    """On the axis of a cylinder of radius R and depth H what is visible is a cone of sin^2 = R^2 / (R^2 + H^2) = AO.

    The vector is 2/3 (1 - cos^3) along the axis.
    """
    radius, depth = 1.0, 1.5
    bottom = quad((-0.05, -0.05, 0), (0.1, 0, 0), (0, 0.1, 0))
    wall, faces = spun(np.array([(radius, 0), (radius, depth)]), sections=192)
    uvs = np.concatenate([quad_uvs((0, 0), (0.5, 1)), 0.4 * triangle_a_cell(len(faces)) + (0.6, 0)])
    bent, sh, _ = baked(
        scene(*join(bottom, (wall, faces[:, ::-1])), uvs), size=(64, 32), directions=4096, backend=backend
    )
    cosine = depth / np.hypot(radius, depth)
    assert sh[16, 16, 0] == pytest.approx(1 - cosine**2, abs=0.01)
    assert sh[16, 16, 1:] == pytest.approx((0, 0, 2 / 3 * (1 - cosine**3)), abs=0.01)
    assert degrees(bent[16, 16], (0, 0, 1)) < 1.0


def test_a_ball_looks_along_its_normals():
    bent, sh, found = baked(scene(*ball(3)), normals="smooth", directions=512)
    valid = found.texture.valid
    assert np.median(degrees(bent[valid], normals_at(found)[valid])) < 0.5
    assert np.median(np.linalg.norm(sh[valid][:, 1:], axis=1)) == pytest.approx(2 / 3, abs=0.01)


def test_inside_a_closed_ball_they_are_the_shading_normals():
    positions, faces = ball(2)
    bent, sh, found = baked(scene(positions, faces[:, ::-1]), backend="ray", normals="smooth", directions=64)
    valid = found.texture.valid
    assert np.abs(sh[valid]).max() < 1e-6
    assert degrees(bent[valid], normals_at(found)[valid]).max() < 0.1


def test_the_light_of_a_linear_sky_is_the_sum_over_its_directions():
    """AO L0 + C.L1 is the sum of the light from each direction that is visible, over the same directions: exactly."""
    from aoprecalc.visibility.integrand import Integrand

    rng = np.random.default_rng(0)
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normal, seen, light = np.array([0, 0.6, 0.8]), rng.random(500) < 0.6, np.array([0.3, -0.2, 0.5])
    weights = np.maximum(directions @ normal, 0)
    sums = np.array([[(weights * seen).sum(), weights.sum(), *((weights * seen)[:, None] * directions).sum(axis=0)]])
    estimates, measured = Integrand(vectors=True).estimates(sums.astype(np.float32), 500)
    expected = (weights * seen * (1.5 + directions @ light)).sum() / weights.sum()
    assert measured.all()
    assert estimates[0, 0] * 1.5 + estimates[0, 1:] @ light == pytest.approx(expected, abs=1e-6)


def test_maps_and_rays_agree():
    made = scene(*join(box((-1, -1, -1), (1, 1, 0)), box((-0.4, -0.4, 0.3), (0.4, 0.4, 0.6))))
    (maps, sh, found), (rays, traced, _) = (baked(made, backend=backend, size=96) for backend in BACKENDS)
    valid = found.texture.valid & (sh[..., 0] > 0.1)
    assert np.sqrt(((sh - traced)[valid] ** 2).mean()) < 0.015
    assert np.median(degrees(maps, rays)[valid]) < 0.5


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_ao_is_that_without_them(backend):
    made = scene(*join(box(), box((0.5, 0.5, 0.5), (2, 2, 2))))
    options = BakeOptions(size=64, directions=200, backend=backend)
    with_them = bake_scene(made, ao.BakeOptions(size=64, directions=200, backend=backend, bent_normals=True))
    assert (bake_scene(made, options).texture.values == with_them.texture.values).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_below_the_ground_they_are_the_shading_normals(backend):
    wall = scene(*quad((0, -1, 0), (0, 2, 0), (0, 0, 2)), quad_uvs((0, 0), (1, 1)))
    bent, sh, _ = baked(wall, ground=True, up="z", ground_height=1, backend=backend)
    assert np.abs(sh[36:]).max() < 0.01
    assert degrees(bent, (1, 0, 0))[36:].max() < 0.1
    assert degrees(bent, np.array([np.pi / 2, 0, 1]) / np.hypot(np.pi / 2, 1))[:28].max() < 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_they_lean_to_the_light_of_an_overcast_sky(backend):
    """Of an upright wall: the sum over all directions of f L w."""
    wall = scene(*quad((0, -1, 0), (0, 2, 0), (0, 0, 2)), quad_uvs((0, 0), (1, 1)))
    _, sh, found = baked(wall, sky="overcast", up="z", backend=backend)
    axes = light_axes(200_000)
    light = np.concatenate([axes, -axes])
    weights = Integrand.from_options(found.options, found.scene).radiance(light) * np.maximum(light[:, 0], 0)
    assert (sh[..., 0] == 1).all()
    expected = (weights[:, None] * light).sum(axis=0) / weights.sum()
    assert sh[8:-8, 8:-8, 1:] == pytest.approx(np.broadcast_to(expected, (48, 48, 3)), abs=0.01)
    assert expected[2] > 0.05


def test_occluders_beyond_the_maximum_distance_do_not_bend():
    bent, sh, _ = baked(corner(height=1.0), size=(64, 8), max_distance=1.0)
    assert sh[4, 20:30, 1:] == pytest.approx(np.broadcast_to((0, 0, 2 / 3), (10, 3)), abs=0.003)
    assert degrees(bent[4, 2], (0, 0, 1)) > 20


def test_the_lighter_side_has_the_vector():
    """A sheet under a roof, two-sided: the side away from the roof counts."""
    roof = box((-9, -9, 0.01), (9, 9, 1))
    uvs = np.concatenate([quad_uvs((0, 0), (0.5, 1)), 0.4 * triangle_a_cell(len(roof[1])) + (0.6, 0)])
    made = scene(*join(quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), roof), uvs)
    bent, _, _ = baked(made, two_sided=True, size=(64, 32))
    assert degrees(bent[10:20, 10:20], (0, 0, -1)).max() < 1
    bent, _, _ = baked(made, size=(64, 32))
    assert degrees(bent[10:20, 10:20], (0, 0, -1)).min() > 60


@pytest.mark.parametrize("turn", [rotation(4), rotation(5) * (1, 1, -1)], ids=["turned", "mirrored"])
def test_instances_that_share_texels_see_as_the_first_does(turn):
    """A corner and its turned copy, far away from it, each with a cover of its own: both see the same."""
    floor = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    (positions, faces), (cover, lid) = floor, box((0.2, -1, 0.3), (3, 3, 0.5))
    order = REVERSED_WINDING if np.linalg.det(turn) < 0 else [0, 1, 2]
    shapes = floor, (positions @ turn.T + 50, faces[:, order]), (cover, lid), (cover @ turn.T + 50, lid)
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), np.zeros((2 + 24, 3, 2))])
    made = scene_of_parts(*shapes, uvs=uvs)
    copy = replace(made.parts[1], vertices=made.parts[0].vertices[:, order], instance_of=0, duplicate_of=0)
    made = replace(made, parts=(made.parts[0], copy, *made.parts[2:]))
    settings = {"size": 32, "backend": "ray", "occluders_only": ("part 2", "part 3")}
    _, shared, _ = baked(made, instances="share", **settings)
    _, alone, _ = baked(made, exclude=("part 1",), **settings)
    assert np.sqrt(((shared - alone) ** 2).mean()) < 0.015


@pytest.mark.parametrize("backend", BACKENDS)
def test_in_object_space_those_of_a_skin_are_as_its_vertices_are_stored(tmp_path, backend):
    """Two open boxes far apart, each on a joint that stands turned at rest: each sees as much as unturned."""
    first, other = open_box()[0], open_box()[0]
    boxes = join(first, (np.asarray(other[0]) + (300, 0, 0), other[1]))
    uvs = triangle_a_cell(len(boxes[1]))

    def found(folder, *turns):
        folder.mkdir()
        maker = GltfMaker(folder)
        primitive = flat_primitive(maker, boxes, uvs)
        if turns:
            joints, weights = np.zeros((3 * len(uvs), 4), "<u1"), np.zeros((3 * len(uvs), 4), "<f4")
            joints[len(joints) // 2 :, 0], weights[:, 0] = 1, 1
            primitive["attributes"] |= {"JOINTS_0": maker.vertices(joints), "WEIGHTS_0": maker.vertices(weights)}
            maker.add("skins", {"joints": [maker.node(rotation=one) for one in turns]})
        maker.node(mesh=maker.mesh(primitive), **({"skin": 0} if turns else {}))
        options = BakeOptions(size=64, directions=1024, unwrap="keep", backend=backend, bent_normals=True)
        bake = bake_scene(maker.load(), options)
        return bake.texture.known, *(bent_normals(bake, options, space) for space in ("object", "world"))

    known, stored, _ = found(tmp_path / "plain")
    of_skin, in_object, in_world = found(tmp_path / "skin", turn((0.6, 0, 0.8), 70), turn((0, 1, 0), -120))
    both = known & of_skin
    assert both.sum() > 1000
    assert np.median(degrees(in_object, stored)[both]) < 2
    assert np.median(degrees(in_world, stored)[both]) > 20


def test_padding_repeats_the_nearest_texel():
    bent, sh, found = baked(scene(*ball(2)), directions=64, padding=4)
    for image in (bent, sh):
        again = pad(image * found.texture.known[..., None], found.texture.known, 4)
        known = pad(found.texture.known, found.texture.known, 4)
        assert image[known] == pytest.approx(again[known], abs=1e-6)


@pytest.mark.parametrize("repeats", [False, True])
def test_a_texel_that_nothing_covers_takes_the_surface_of_the_texel_that_would_pad_it(repeats):
    covered = np.random.default_rng(2).random((24, 31)) > 0.95
    numbers = np.where(covered, np.arange(covered.size, dtype=np.int32).reshape(covered.shape), np.int32(-1))
    padding = find_padding(covered, 3, repeats=repeats)
    bare = np.flatnonzero(~covered).astype(np.int32)
    found = _nearest(numbers, bare, repeats=repeats)
    assert (found >= 0).sum() == len(padding.texels) > 300
    assert (found[np.isin(bare, padding.texels)] == padding.sources[np.argsort(padding.texels)]).all()


def test_arrays_from_python():
    result = ao.bake(ao.Mesh(*ball(2)), ao.BakeOptions(size=64, directions=64, bent_normals=True))
    assert result.bent_normals.shape == (64, 64, 3)
    assert result.bent_normals.dtype == result.sh.dtype == np.float32
    assert np.linalg.norm(result.bent_normals[result.valid], axis=1) == pytest.approx(1, abs=1e-5)
    assert (result.sh[..., 0] == result.ao).all()
    assert result.sh is result.sh
    assert ao.bake(ao.Mesh(*ball(2)), ao.BakeOptions(size=64, directions=64)).sh is None


def test_pictures_hold_half_of_a_vector_and_a_half():
    assert encoded(np.float32([[1, -1, 0]])).tolist() == [[1, 0, 0.5]]
