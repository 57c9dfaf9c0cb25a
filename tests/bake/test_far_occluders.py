"""What occludes may be any number of times larger than what receives, and any distance away."""

import re
from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.checks import form_factor
from aoprecalc.mesh import normalized_surface
from aoprecalc.mesh.normalized_surface import cut_by_distance
from aoprecalc.mesh.roles import assign_roles, baked_apart
from aoprecalc.mesh.surface import area_vectors, sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.texture_lookup import bilinear
from aoprecalc.visibility import map_error
from shapes import box, clutter, join, quad, rotation, scene_of_parts, triangle_a_cell

slow = pytest.mark.slow
backends = pytest.mark.parametrize("backend", ["gl", "ray"])
TURN = rotation(2)  # no axis of the mesh is one of the maps


def floor(width, height=0.0):
    return quad((-width / 2, -width / 2, height), (width, 0, 0), (0, width, 0))


def bake(shapes, backend, **options):
    """Only the first shape receives; all are turned."""
    own, others = len(shapes[0][1]), sum(len(faces) for _, faces in shapes[1:])
    uvs = np.concatenate([triangle_a_cell(own), np.zeros((others, 3, 2))])
    made = scene_of_parts(*((np.asarray(positions) @ TURN.T, faces) for positions, faces in shapes), uvs=uvs)
    given = {"size": 96, "directions": 512, "normals": "flat", "only": ("part 0",), "shadow_size": 512, **options}
    return bake_scene(made, BakeOptions(backend=backend, **given))


def on_surface(baked, count=2000):
    """Values at points of what receives, the points and their face normals, turned back."""
    points = sample_surface(baked.scene, baked.atlas.mapped, count, 0)
    normals = area_vectors(baked.scene.corners)[points.faces]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs), repeats=False)
    return found, points.interpolate(baked.scene.corners) @ TURN, normals @ TURN


def wall_beside(points, normals, width):
    """The ambient occlusion of the sides of the box |x|, |y| <= 1 that stands on a floor: 1 less the floor in front."""
    expected = np.ones(len(points))
    for axis in (0, 1):
        for sign in (1, -1):
            of_side = normals[:, axis] * sign > 0.9
            ends = np.array([(1, -width / 2), (width / 2, -width / 2), (width / 2, width / 2), (1, width / 2)])
            corners = np.zeros((4, 3))
            corners[:, axis], corners[:, 1 - axis] = sign * ends[:, 0], ends[:, 1]
            factor = form_factor(points[of_side], normals[of_side], corners)
            expected[of_side] -= np.abs(factor)
    return expected


@backends
@pytest.mark.parametrize("width", [10, *(pytest.param(w, marks=slow) for w in (100, 1e3)), 1e4, 1e9])
def test_a_box_on_a_floor_of_any_width(backend, width):
    baked = bake([box((-1, -1, 0), (1, 1, 1.5)), floor(width)], backend)
    found, points, normals = on_surface(baked)
    clear = (points[:, 2] > 0.02) & (normals[:, 2] > -0.5)  # beside the crease the form factor is a difference of ones
    expected = wall_beside(points[clear], normals[clear], min(width, 1e6))
    assert np.sqrt(np.mean((found[clear] - expected) ** 2)) < 0.008
    assert np.abs(found[clear] - expected).max() < 0.03


@pytest.mark.parametrize("width", [3.0, 40.0, 1e4, 1e8])
def test_a_tile_of_a_large_plane_is_one_to_the_last_bit(width):
    """The tile lies in the plane, among triangles that do not receive."""
    for shadow_size in (64, 512):
        baked = bake([floor(1), floor(width)], "gl", shadow_size=shadow_size)
        assert (baked.texture.values[baked.texture.valid] == 1).all()


@backends
@pytest.mark.parametrize("distance", [5.0, 1e3, 1e6, 1e12])
def test_a_wall_hides_half_of_the_sky_from_any_distance(backend, distance):
    reach = 1e3 * distance
    wall = quad((distance, -reach, -reach), (0, 2 * reach, 0), (0, 0, 2 * reach))
    found, _, normals = on_surface(bake([box(), wall], backend))
    assert np.abs(found[normals[:, 2] > 0.5] - 0.5).max() < 0.02
    assert found[normals[:, 0] > 0.5].max() < 0.02
    assert (found[normals[:, 0] < -0.5] == 1).all()


@backends
def test_a_distant_sky_hides_everything(backend):
    baked = bake([box(), box((-1e5, -1e5, -1e5), (1e5, 1e5, 1e5))], backend)
    assert baked.texture.values[baked.texture.valid].max() < 0.01


def surroundings(seed):
    """A floor and walls of random sizes and places, and clutter near and far, around clutter of about 3 units."""
    rng = np.random.default_rng(seed)
    shapes = [floor(10 ** rng.uniform(1, 5), -2.5)]
    for _ in range(4):
        size, away = 10 ** rng.uniform(0, 4, 2)
        right, up = rotation(int(rng.integers(1000)))[:2] * size
        middle = rng.normal(size=3)
        middle *= (4 + away) / np.linalg.norm(middle)
        shapes.append(quad(middle - (right + up) / 2, right, up))
    positions, faces = clutter(seed + 100)
    far = positions * 10 ** rng.uniform(0, 2)
    return join(*shapes, (far + (far.max() + 5, 0, 0), faces))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=slow) for seed in range(1, 8))])
def test_maps_and_rays_agree_in_surroundings_seed(seed):
    shapes = [clutter(seed, boxes=3), surroundings(seed)]
    maps, rays = (bake(shapes, backend, size=64, shadow_size=1024).texture for backend in ("gl", "ray"))
    off = (maps.values - rays.values)[maps.valid & rays.valid]
    assert rays.values[rays.valid].mean() < 0.9
    assert np.sqrt((off**2).mean()) < 0.01
    assert abs(off.mean()) < 0.002


@backends
@pytest.mark.parametrize(("scale", "shift"), [(1e-3, 0.0), (1e4, 1e8), (1.0, 1e4)], ids=str)
def test_scale_and_place_change_nothing(backend, scale, shift):
    shapes = [box((-1, -1, 0), (1, 1, 1.5)), floor(3e3)]
    moved = [(positions * scale + shift * np.array([1, -0.7, 0.4]), faces) for positions, faces in shapes]
    before, after = (bake(some, backend).texture for some in (shapes, moved))
    both = before.valid & after.valid
    assert both.mean() > 0.98 * before.valid.mean()
    off = (after.values - before.values)[both]
    assert np.sqrt((off**2).mean()) < 0.003


def test_pieces_cover_what_was_cut_and_are_small_for_their_distance(monkeypatch):
    monkeypatch.setattr(normalized_surface, "_MAX_REACH", 1e300)
    positions, faces = surroundings(5)
    whole = positions[faces] @ TURN.T / 3
    pieces = cut_by_distance(whole)
    areas = np.linalg.norm(area_vectors(pieces), axis=1)
    assert areas.sum() == pytest.approx(np.linalg.norm(area_vectors(whole), axis=1).sum(), rel=1e-9)
    sums = [area_vectors(some).sum(axis=0) for some in (whole, pieces)]
    assert sums[1] == pytest.approx(sums[0], rel=1e-9)  # and face the same way
    near = np.maximum(np.maximum(pieces.min(axis=1), -pieces.max(axis=1)).max(axis=1), 1)
    assert (np.abs(pieces).max(axis=(1, 2)) <= 16 * near * (1 + 1e-9)).all()
    assert len(whole) < len(pieces) < 40 * len(whole)


def test_what_is_near_or_small_is_not_cut():
    positions, faces = clutter(0)
    near, far = positions[faces] / 2, positions[faces] + (500, 0, 0)
    for triangles in (near, far):
        assert cut_by_distance(triangles).tobytes() == triangles.tobytes()


def stools_apart(distance, count=2):
    """Blocks on a floor, at equal distances, and the floor."""
    stands = [box((-1 + distance * n, -1, 0.1), (1 + distance * n, 1, 1.5)) for n in range(count)]
    return [*stands, floor(4 * distance * count)]


@backends
def test_what_is_small_and_far_apart_has_the_values_that_each_has_alone(backend):
    """The same block at both ends of a floor; only the horizon differs."""
    shapes = stools_apart(1e4)
    own = len(shapes[0][1])
    uvs = np.concatenate([triangle_a_cell(2 * own), np.zeros((2, 3, 2))])
    made = scene_of_parts(*((positions @ TURN.T, faces) for positions, faces in shapes), uvs=uvs)
    options = BakeOptions(
        size=96,
        directions=512,
        normals="flat",
        shadow_size=512,
        backend=backend,
        exclude=(),
        occluders_only=("part 2",),
    )
    found = on_surface(bake_scene(made, options))
    alone = [on_surface(bake_scene(made, replace(options, only=(name,)))) for name in ("part 0", "part 1")]
    for values, points, normals in (found, *alone):
        sides = np.abs(normals[:, 2]) < 0.5
        assert values[sides].mean() == pytest.approx(0.5, abs=0.005)
        assert values[normals[:, 2] > 0.5] == pytest.approx(1)
        below = normals[:, 2] < -0.5
        assert values[below].max() < 0.2
        assert points[:, 2].min() > 0


@pytest.mark.parametrize(
    ("distance", "count", "passes"),
    [(1e4, 2, 2), (1e3, 5, 5), (1e3, 17, 1), (10.0, 2, 1), (20.0, 3, 1), (100.0, 4, 4)],
)
def test_groups_are_baked_apart_where_they_are_small_few_and_far_apart(distance, count, passes):
    made = scene_of_parts(*stools_apart(distance, count))
    roles = baked_apart(assign_roles(made, BakeOptions(occluders_only=(f"part {count}",))))
    assert len(roles) == passes
    receivers = sum(shown.receives.astype(int) for shown in roles)
    assert (receivers == np.repeat([1, 0], [12 * count, 2])).all()
    assert all(shown.occludes.all() for shown in roles)
    assert len(baked_apart(assign_roles(made, BakeOptions()))) == 1  # the floor reaches to all


def one_part_apart(distance):
    """Two blocks that are one part, and a floor: nothing tells them apart."""
    first, second, ground = stools_apart(distance)
    return [join(first, second), ground]


def test_maps_that_are_too_coarse_are_told_with_the_error_that_they_add():
    shapes = one_part_apart(3e3)
    maps, rays = (bake(shapes, backend, shadow_size=512, size=128) for backend in ("gl", "ray"))
    both = maps.texture.valid & rays.texture.valid
    error = np.sqrt(np.mean((maps.texture.values - rays.texture.values)[both] ** 2))
    assert error > 0.02
    (told,) = (re.search(r"add an estimated error of (\S+): .* (\d+) times", line) for line in maps.warnings)
    assert float(told[1]) == pytest.approx(error, rel=0.35)
    assert int(told[2]) > 50
    assert not rays.warnings


def test_without_rays_the_error_is_said_to_be_unknown(monkeypatch):
    monkeypatch.setattr(map_error, "embreex_problem", lambda: "not installed")
    baked = bake(one_part_apart(3e3), "gl", shadow_size=512)
    assert any("the depth maps add an error of unknown size" in line for line in baked.warnings)


@pytest.mark.parametrize("width", [10, 1e4])
def test_maps_that_are_fine_enough_are_not_told(width):
    baked = bake([box((-1, -1, 0.1), (1, 1, 1.5)), floor(width)], "gl", shadow_size=None)
    assert not any("depth maps" in line for line in baked.warnings)
