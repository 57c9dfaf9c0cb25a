"""What occludes may be any number of times larger than what receives, and any distance away."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.checks import form_factor
from aoprecalc.mesh import surface
from aoprecalc.mesh.surface import area_vectors, cut_by_distance, sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.texture_lookup import bilinear
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
    monkeypatch.setattr(surface, "_MAX_REACH", 1e300)
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
