"""Interleaved directions: neighbours share what they see where it is smooth, and nowhere else."""

import numpy as np
import pytest

from aoprecalc.api import bake_scene as api_bake_scene
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.checks import form_factor
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.options.bake import AUTO_DIRECTIONS
from aoprecalc.raster.layout import order_in_blocks
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Texels
from aoprecalc.visibility import gather, interleaving, plan
from aoprecalc.visibility.directions import GROUP_SIZE, texel_offset
from aoprecalc.visibility.interleaving import GROUPS, MEAN_OFFSET, group_of_texels, share_sums
from shapes import clutter, join, quad, scene, torus

UP = np.array((0, 0, 1), np.float32)


def grid(width, height, covered=None):
    index = np.arange(width * height, dtype=np.int32)
    return Texels(width, height, index if covered is None else index[covered.ravel()])


def shared(texels, values, normals=None):
    """Share sums whose quotients are values, (k,); return where, and the quotients of what was stored."""
    groups, halves = group_of_texels(texels), np.zeros((2, len(texels), 2), np.float32)
    totals = 10.0 + groups
    own = np.stack([values * totals, totals], axis=1).astype(np.float32)
    normals = np.broadcast_to(UP, (len(texels), 3)) if normals is None else normals
    smooth = share_sums(texels, groups, own, normals, halves)
    assert not halves[:, ~smooth].any()
    return smooth, halves


def quotients(halves):
    visible, total = halves.sum(axis=0).T
    return visible / total


def positions_of(texels):
    """Where the samples of texels lie, at the offsets of their groups, in texels."""
    row, column = np.divmod(texels.index, texels.width)
    return np.stack([column, row], axis=1) + [texel_offset(group) for group in group_of_texels(texels)]


def test_a_linear_field_is_that_at_the_mean_offset():
    texels = grid(40, 30)
    x, y = positions_of(texels).T
    groups = group_of_texels(texels)
    smooth, halves = shared(texels, 0.2 + 0.004 * x + 0.003 * y)
    row, column = np.divmod(texels.index, 40)
    inner = (row > 0) & (row < 29) & (column > 0) & (column < 39)
    assert (smooth == inner).all()
    # The sums weigh the groups by their totals.
    weights = 10.0 + np.arange(GROUPS)
    right, down = np.average([texel_offset(group) for group in range(GROUPS)], axis=0, weights=weights)
    for group in range(GROUPS):
        around = np.array([(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
        here = np.array((group % 3, group // 3))
        of_neighbours = (here + around) % 3 @ (1, 3)
        shift_x, shift_y = np.average(around, axis=0, weights=weights[of_neighbours])
        chosen = smooth & (groups == group)
        expected = 0.2 + 0.004 * (column + right + shift_x) + 0.003 * (row + down + shift_y)
        assert np.abs(quotients(halves[:, chosen]) - expected[chosen]).max() < 1e-6


def test_errors_of_the_groups_that_add_up_to_nothing_vanish():
    texels, rng = grid(30, 30), np.random.default_rng(0)
    errors = rng.normal(0, 0.1, GROUPS)
    errors -= np.average(errors, weights=10.0 + np.arange(GROUPS))
    smooth, halves = shared(texels, 0.5 + errors[group_of_texels(texels)])
    assert smooth.sum() == 28 * 28
    assert np.abs(quotients(halves[:, smooth]) - 0.5).max() < 1e-6


def test_even_and_odd_groups_are_kept_apart():
    texels = grid(9, 9)
    smooth, halves = shared(texels, np.where(group_of_texels(texels) % 2, 0.25, 0.75))
    even, odd = (half[smooth] for half in halves)
    assert np.allclose(even[:, 0], 0.75 * even[:, 1])
    assert np.allclose(odd[:, 0], 0.25 * odd[:, 1])
    assert np.allclose(even[:, 1] + odd[:, 1], sum(10.0 + np.arange(GROUPS)))


def test_nothing_is_shared_across_an_edge_of_light():
    texels = grid(60, 20)
    column = texels.index % 60
    smooth, _ = shared(texels, np.where(column < 31, 0.9, 0.6))
    assert not smooth[np.abs(column - 30.5) < 2].any()
    assert smooth[(np.abs(column - 30.5) > 10) & (column > 0) & (column < 59)].any()


def test_nothing_is_shared_across_a_bend():
    texels = grid(30, 30)
    column = texels.index % 30
    normals = np.where((column < 15)[:, None], UP, np.array((np.sin(0.5), 0, np.cos(0.5)), np.float32))
    smooth, _ = shared(texels, np.full(len(texels), 0.7), normals)
    assert not smooth[(column == 14) | (column == 15)].any()
    assert smooth[(column == 13) | (column == 16)].any()


def test_sixteen_texels_in_order_are_a_square_of_all_and_of_each_group():
    order = order_in_blocks(np.arange(24 * 36), 24)
    assert sorted(order) == list(range(24 * 36))
    groups = group_of_texels(Texels(24, 36, order.astype(np.int32)))
    for chosen, side in ((order, 4), *((order[groups == group], 10) for group in range(GROUPS))):
        places = np.stack(np.divmod(chosen, 24)).reshape(2, -1, 16)
        assert (np.ptp(places, axis=2) == side - 1).all()


def test_in_the_widest_texture_too():
    width, rows = 32768, 12
    order = order_in_blocks(np.arange(rows * width), width)
    places = np.stack(np.divmod(order, width)).reshape(2, -1, 16)
    assert np.ptp(places[1], axis=1).max() < 12


def test_without_a_texel_nothing_is_shared():
    nothing, none = Texels(8, 8, np.zeros(0, np.int32)), np.zeros((0, 2), np.float32)
    normals = np.zeros((0, 3), np.float32)
    assert len(share_sums(nothing, group_of_texels(nothing), none, normals, np.zeros((2, 0, 2), np.float32))) == 0


def slowly(texels, values):
    """What `share_sums` decides, texel by texel."""
    at = {int(index): number for number, index in enumerate(texels.index)}
    totals, width = 10.0 + group_of_texels(texels), texels.width

    def number(row, column):
        return at.get(row * width + column) if 0 <= column < width and 0 <= row < texels.height else None

    difference = {}
    for row, column in np.ndindex(texels.height, width):
        around = [number(row + down, column + right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
        if None not in around:
            mean = (values * totals)[around].sum() / totals[around].sum()
            difference[row, column] = mean - values[number(row, column)]
    changes = {}
    for (row, column), own in difference.items():
        for other in ((row + 3, column), (row, column + 3)):
            if other in difference:
                for place in ((row, column), other):
                    changes.setdefault(place, []).append((difference[other] - own) ** 2)
    smooth = np.zeros(len(texels), bool)
    for row, column in difference:
        places = [(row + down, column + right) for down in range(-2, 3) for right in range(-2, 3)]
        squares = [square for place in places for square in changes.get(place, [])]
        smooth[number(row, column)] = bool(squares) and np.mean(squares) <= interleaving._MAX_CHANGE**2
    return smooth


@pytest.mark.parametrize("seed", range(3))
def test_bands_decide_as_texel_by_texel(seed, monkeypatch):
    monkeypatch.setattr(interleaving, "_BAND_TEXELS", 7 * 26)
    rng = np.random.default_rng(seed)
    covered = rng.random((31, 26)) > 0.004
    texels = grid(26, 31, covered)
    x, y = positions_of(texels).T
    values = (
        0.5 + 0.3 * np.sin(x * x / 90) * np.cos(y / 4 + seed) + 0.03 * rng.normal(size=GROUPS)[group_of_texels(texels)]
    )
    order = rng.permutation(len(texels))
    smooth, _ = shared(Texels(26, 31, texels.index[order]), values[order])
    expected = slowly(texels, values)
    assert 0.1 < expected.mean() < 0.6
    assert (smooth == expected[order]).all()


# Whole bakes.


def wall_and_floor(height):
    """A floor of 1 x 1 under a wall at its side y = 0, twice as wide, which takes no texels."""
    floor = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    wall = quad((-0.5, 0, 0), (2, 0, 0), (0, 0, height))
    uvs = np.zeros((4, 3, 2))
    uvs[:2] = floor[0][floor[1]][..., :2] * 0.9 + 0.05
    uvs[2:] = wall[0][wall[1]][..., ::2] * 0.01
    return scene(*join(floor, wall), uvs=uvs)


def errors_beside_the_wall(height, directions):
    """Errors against the closed form at points of the floor, and their distances from the wall in texels."""
    options = BakeOptions(size=256, backend="ray", normals="flat", unwrap="keep", directions=directions)
    baked = bake_scene(wall_and_floor(height), options)
    points = sample_surface(baked.scene, np.arange(4) < 2, 20_000, seed=0)
    positions = points.interpolate(baked.scene.corners)
    wall = np.array([(-0.5, 0, 0), (-0.5, 0, height), (1.5, 0, height), (1.5, 0, 0)])
    distance = positions[:, 1]
    off = distance > 1e-3
    expected = 1 - np.abs(form_factor(positions[off], np.tile((0.0, 0.0, 1.0), (off.sum(), 1)), wall))
    found = bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs)[off], repeats=False)
    return found - expected, distance[off] * 0.9 * 256


def rms(errors):
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.parametrize("height", [0.02, 0.1])
def test_up_to_a_wall_it_is_as_right_as_with_all_directions_at_every_texel(height):
    (auto, distance), (all_taken, _) = (errors_beside_the_wall(height, each) for each in (None, AUTO_DIRECTIONS))
    for near in (3, 10, 30):
        chosen = distance < near
        assert rms(auto[chosen]) < 1.1 * rms(all_taken[chosen]) + 0.001


def test_sharing_everywhere_would_blur_the_contact_shadow(monkeypatch):
    """Of a wall that is 4.6 texels high."""
    auto, distance = errors_beside_the_wall(0.02, None)
    monkeypatch.setattr(interleaving, "_MAX_CHANGE", 10.0)
    blurred, _ = errors_beside_the_wall(0.02, None)
    assert rms(blurred[distance < 10]) > 1.5 * rms(auto[distance < 10])


def test_where_nothing_is_shared_it_is_a_bake_with_as_many_directions(monkeypatch):
    monkeypatch.setattr(interleaving, "_MIN_COSINE", 2.0)
    monkeypatch.setattr(api_bake_scene, "enough_directions", lambda setup: setup.directions)
    made = scene(*clutter(0))
    auto, fixed = (
        bake_scene(made, BakeOptions(size=64, backend="ray", directions=directions))
        for directions in (None, AUTO_DIRECTIONS)
    )
    assert auto.directions_per_texel == fixed.directions_per_texel == AUTO_DIRECTIONS
    assert np.abs(auto.texture.values - fixed.texture.values).max() < 1e-5
    assert auto.sampling_error == pytest.approx(fixed.sampling_error, rel=1e-5)


def test_smooth_shapes_share_and_keep_their_error():
    made = scene(*torus(around=96, across=48))
    auto, fixed = (
        bake_scene(made, BakeOptions(size=256, backend="ray", directions=directions))
        for directions in (None, AUTO_DIRECTIONS)
    )
    assert auto.directions_per_texel < 0.5 * AUTO_DIRECTIONS
    assert auto.directions == fixed.directions == AUTO_DIRECTIONS
    difference = (auto.texture.values - fixed.texture.values)[auto.texture.valid]
    assert np.sqrt(np.mean(difference**2)) < 0.003


def test_an_open_surface_is_exactly_one():
    baked = bake_scene(scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=3)), BakeOptions(size=64, backend="ray"))
    assert baked.directions_per_texel < 0.5 * AUTO_DIRECTIONS
    assert (baked.texture.values == 1).all()


def test_chunks_threads_and_bands_change_no_bit(monkeypatch):
    made = scene(*torus())
    monkeypatch.setattr(plan, "FIT_CHUNK", 1000)
    monkeypatch.setattr(gather, "FIT_CHUNK", 1000)
    pictures = []
    for chunks, threads, rows in ((100, 1, 256), (3, 2, 256), (1, 1, 11)):
        monkeypatch.setattr(plan, "_MAX_FIT_CHUNKS", chunks)
        monkeypatch.setattr(interleaving, "_BAND_TEXELS", rows * 96)
        baked = bake_scene(made, BakeOptions(size=96, backend="ray", threads=threads, bent_normals=True))
        pictures.append(baked.texture.values.tobytes() + baked.texture.vectors.tobytes())
    assert pictures[0] == pictures[1] == pictures[2]


def test_bent_normals_change_no_value():
    made = scene(*clutter(1))
    with_vectors, without = (
        bake_scene(made, BakeOptions(size=96, backend="ray", bent_normals=wanted)) for wanted in (True, False)
    )
    assert with_vectors.texture.values.tobytes() == without.texture.values.tobytes()


@pytest.mark.parametrize("options", [{"backend": "gl"}, {"backend": "ray", "target_error": 0.0001}])
def test_depth_maps_and_a_target_take_all_directions_at_all_texels(options):
    made = scene(*torus(around=12, across=8))
    auto, fixed = (
        bake_scene(made, BakeOptions(size=48, directions=directions, **options))
        for directions in (None, AUTO_DIRECTIONS)
    )
    assert auto.directions_per_texel == AUTO_DIRECTIONS
    assert auto.texture.values.tobytes() == fixed.texture.values.tobytes()


def test_the_groups_are_those_of_the_default_number_of_directions():
    assert AUTO_DIRECTIONS == 2 * GROUPS * GROUP_SIZE
    assert np.allclose(MEAN_OFFSET, 0.5, atol=0.15)
