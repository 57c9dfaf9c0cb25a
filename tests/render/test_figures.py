"""The figures of a bake against closed forms: depths of spheres and boxes, light on planes, sums of directions."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.render.comparison import PAGE, grey_picture
from aoprecalc.render.figures import BACKGROUND, bake_figures, figure_sheet, trace_direction
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.gather import gather
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import LocalVisibility, gather_one_direction
from shapes import ball, box, clutter, disc, join, quad, quad_uvs, rotation, scene, triangle_a_cell

BACKENDS = ["gl", "ray"]
UP = np.array([0.0, 1.0, 0.0])
SIZE = 128


def unit(*vector):
    return np.array(vector, float) / np.linalg.norm(vector)


def passed(scene, direction, backend, up=UP, **more):
    """A small bake of a scene, and what is measured along one direction."""
    settings = {"width": 32, "height": 32, "directions": 2, "shadow_size": SIZE, "backend": backend, "normals": "flat"}
    options = BakeOptions(**{**settings, **more})
    baked = bake_scene(scene, options)
    return trace_direction(baked, options, direction, up), baked, options


def pixel_points(traced, center, up=UP):
    """The points of the plane through `center` that the pixels show, (s, s, 3), and the picture's axes."""
    right = unit(*np.cross(up, traced.direction))
    top = np.cross(traced.direction, right)
    along = (np.arange(SIZE) + 0.5 - SIZE / 2) * traced.pixel
    return center + along[None, :, None] * right - along[:, None, None] * top, along


@pytest.mark.parametrize("backend", BACKENDS)
def test_depths_of_a_sphere(backend):
    """c.w + sqrt(r^2 - d^2) and c.w - sqrt(r^2 - d^2) at distance d from the centre."""
    center, radius, direction = np.array([30.0, -7.0, 2.0]), 5.0, unit(0.3, -0.5, 0.8)
    positions, faces = ball(4, radius)
    traced = passed(scene(positions + center, faces, triangle_a_cell(len(faces))), direction, backend)[0]
    along = pixel_points(traced, center)[1]
    aside = np.hypot(along[None], along[:, None])
    flat = radius - np.linalg.norm(positions[faces].mean(axis=1), axis=1).min()  # depth of the middles of the faces
    inside = aside < 0.95 * radius
    rise = np.sqrt(radius**2 - aside[inside] ** 2)
    steep = radius / np.sqrt(1 - 0.95**2)
    for depths, sign in zip(traced.depths, (1, -1), strict=True):
        assert np.abs(depths[inside] - (center @ direction + sign * rise)).max() < flat * steep
        assert np.isnan(depths[aside > radius + 2 * traced.pixel]).all()
    assert np.isfinite(traced.depths[:, aside < radius - 2 * traced.pixel]).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 1, 0), (0.4, 0.3, 0.5), (-3, 1, -2)])
def test_depths_of_a_box(backend, direction):
    """Where the line of a pixel enters and leaves the slabs between opposite faces."""
    low, high, direction = np.array([-1.0, -2, -3]), np.array([1.0, 2, 5]), unit(*direction)
    up = UP if direction[1] < 0.99 else np.array([0.0, 0, 1])
    traced = passed(scene(*box(low, high)), direction, backend, up)[0]
    points = pixel_points(traced, (low + high) / 2, up)[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(low - points) / direction, (high - points) / direction]), axis=0)
    enter, leave = np.nanmax(ends[0], axis=-1), np.nanmin(ends[1], axis=-1)
    chord = leave - enter
    base = points @ direction
    near, far = traced.depths
    sure = chord > 6 * traced.pixel / np.abs(direction[direction != 0]).min()  # not at an edge of the silhouette
    assert sure.sum() > 500
    for found, expected in ((near, base + leave), (far, base + enter)):
        assert np.abs(found - expected)[sure].max() < 1e-2 * traced.pixel + 1e-4
    assert np.isnan(near[chord < -6 * traced.pixel / np.abs(direction[direction != 0]).min()]).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_depth_maps_are_upright(backend):
    """A ball on a pole: seen from any side the ball is at the top, and one to its right is at the right."""
    pole = box((-0.1, -1, -0.1), (0.1, 1, 0.1))
    top, right = ((0.3 * ball(2)[0] + at, ball(2)[1]) for at in ((0, 1, 0), (0.8, -0.7, 0)))
    near = passed(scene(*join(pole, top, right)), unit(0.1, 0.2, 1), backend)[0].depths[0]
    rows, columns = np.nonzero(np.isfinite(near))
    width_at = [np.ptp(columns[rows == row]) for row in (rows.min() + 10, (rows.min() + rows.max()) // 2)]
    assert width_at[0] > 2 * width_at[1]
    assert rows[columns == columns.max()].min() > rows.mean()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("degrees", [0, 30, 60, 85, 95, 180])
def test_a_plane_lit_at_an_angle_has_its_cosine_everywhere(backend, degrees):
    turn = rotation(degrees)
    plane, faces = quad((0, 0, 0), (3, 0, 0), (0, 2, 0), 3)
    direction = turn @ (np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees)))
    values = passed(scene(plane @ turn.T, faces), direction, backend)[0].visibility.values
    assert np.abs(values - max(0.0, np.cos(np.radians(degrees)))).max() < 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_two_sided_plane_is_lit_from_both_sides(backend):
    shape = scene(*quad((0, 0, 0), (3, 0, 0), (0, 2, 0), 3))
    for z in (1, -1):
        values = passed(shape, unit(1, 0, z), backend, two_sided=True)[0].visibility.values
        assert np.abs(values - 0.5**0.5).max() < 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_shadow_of_a_disc_on_a_floor(backend):
    """A disc of radius R at height H above the floor: R about the point where the light through its middle falls."""
    radius, height, direction = 0.7, 0.5, unit(0.4, -0.3, 1.0)
    floor = quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))
    lid, lid_faces = disc(radius, height)
    uvs = np.concatenate([quad_uvs((0, 0), (0.8, 0.8)), triangle_a_cell(128) * 0.15 + 0.85])
    shape = scene(*join(floor, (lid, lid_faces)), uvs)
    options = {"width": 160, "height": 160, "unwrap": "keep", "shadow_size": 1024}
    values = passed(shape, direction, backend, **options)[0].visibility.values[-128:, :128]
    across = (np.arange(128) + 0.5) / 128 * 4 - 2
    light = height * direction[:2] / direction[2]  # from the disc to its shadow, backwards
    aside = np.hypot(across[None] + light[0], across[::-1, None] + light[1])
    assert np.abs(values[aside > radius + 0.05] - direction[2]).max() < 1e-4
    assert (values[aside < radius - 0.05] == 0).all()


def one_group(backend, **more):
    """A bake of a cluttered scene with 128 directions, which make one group: all sample the texels at their centres."""
    options = BakeOptions(size=56, directions=128, normals="flat", padding=0, fill="none", backend=backend, **more)
    positions, faces = clutter(3)
    return bake_scene(scene(positions, faces, triangle_a_cell(len(faces))), options), options


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_mean_of_all_directions_is_the_texture(backend):
    """4/N times the sum of figure 1.2 over the N directions of a bake is its figure 1.3 (equation 1.1.1.1).

    It is what the bake has measured, exactly; to that the texture is fitted, so that look-ups between texels are right.
    """
    baked, options = one_group(backend, estimator="mean")
    axes = light_axes(128)
    total = np.zeros((56, 56))
    with open_backend(options, Progress()) as opened:
        setup = BakeSetup(opened, BakeInputs(baked.scene, baked.atlas, baked.normals, options))
        (side,) = setup.sides
        tester = opened.tester(
            side.surface, setup.integrand, len(side.texels), baked.shadow_size or 512, len(side.texels)
        )
        for direction in np.concatenate([axes, -axes]):
            total += gather_one_direction(setup, side, tester, direction, 1 << 20).values
        local = LocalVisibility(setup, side, baked.shadow_size or 512, 1 << 20, Progress())
        measured = gather(setup, side, local, 1 << 20)
    mean = np.minimum(4 / 128 * total, 1)
    np.testing.assert_allclose(mean.ravel()[side.texels.index], measured.values, atol=1e-5)
    difference = (mean - baked.texture.values)[baked.texture.valid]
    assert np.sqrt((difference**2).mean()) < 0.02


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sample_of_directions_estimates_the_texture(backend):
    """Both estimators come from figure 1.2 by the error that so many random directions leave."""
    options = BakeOptions(size=32, directions=512, normals="flat", unwrap="keep", backend=backend)
    plain, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 4)
    wall = quad((0, 0, 0), (0, 1, 0), (0, 0, 0.5), 4)
    uvs = np.concatenate([quad_uvs((0, 0), (1, 0.6), 4), quad_uvs((0, 0.7), (1, 1), 4)])
    baked = bake_scene(scene(*join((plain, faces), wall), uvs), options)
    random = np.random.default_rng(1).normal(size=(200, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    total = np.zeros((32, 32))
    with open_backend(options, Progress()) as opened:
        setup = BakeSetup(opened, BakeInputs(baked.scene, baked.atlas, baked.normals, options))
        (side,) = setup.sides
        tester = opened.tester(
            side.surface, setup.integrand, len(side.texels), baked.shadow_size or 512, len(side.texels)
        )
        for direction in random:
            total += gather_one_direction(setup, side, tester, direction, 1 << 20).values
    difference = (4 / 200 * total - baked.texture.values)[baked.texture.valid]
    # The variance of 4 max(0, n.w) visible with w uniform on the sphere is at most 16/6 - 1 = 1.7.
    assert np.sqrt((difference**2).mean()) < 3 * np.sqrt(1.7 / 200)


def test_gl_and_rays_agree():
    shape, direction = scene(*clutter(5)), unit(0.3, 0.5, -0.6)
    (gl, *_), (ray, *_) = (
        passed(shape, direction, backend, width=128, height=128, shadow_size=512) for backend in BACKENDS
    )
    both = np.isfinite(gl.depths) & np.isfinite(ray.depths)
    assert (np.isfinite(gl.depths) == np.isfinite(ray.depths)).mean() > 0.998
    apart = np.abs(gl.depths - ray.depths)[both]
    assert np.median(apart) < 1e-5
    assert (apart < 2 * gl.pixel).mean() > 0.995
    valid = gl.visibility.valid & ray.visibility.valid
    assert (np.abs(gl.visibility.values - ray.visibility.values)[valid] < 1 / 255).mean() > 0.97


def test_figures_show_what_was_measured():
    traced, baked, options = passed(scene(*clutter(1)), unit(1, 2, 3), "ray", width=64, height=64)
    clay, rendered = (np.full((40, 50, 3), value, np.uint8) for value in (90, 60))
    figures = {figure.name: figure for figure in bake_figures(baked, options, traced, clay, rendered)}
    assert list(figures) == ["1_1_near", "1_1_far", "1_2", "1_3", "1_4_without", "1_4"]
    np.testing.assert_array_equal(figures["1_3"].picture, grey_picture(baked.texture.values))
    np.testing.assert_array_equal(figures["1_2"].picture, grey_picture(traced.visibility.values))
    for depths, name in zip(traced.depths, ("1_1_near", "1_1_far"), strict=True):
        picture, there = figures[name].picture, np.isfinite(depths)
        assert (picture[~there] == BACKGROUND).all()
        assert (np.ptp(picture[there].astype(int), axis=1) == 0).all()  # grey, which the background is not
        order = np.argsort(-depths[there])
        assert (np.diff(picture[there][order][:, 0].astype(int)) <= 0).all()  # darker with distance
        assert np.ptp(picture[there][:, 0].astype(int)) > 150
    sheet = figure_sheet(list(figures.values()), 3, "clutter")
    assert sheet.tobytes() == figure_sheet(list(figures.values()), 3, "clutter").tobytes()
    assert (sheet[0] == PAGE).all()


def test_depth_maps_without_a_pixel():
    """Of a mesh that no pixel's centre meets, as of an edge-on plane: all background, and numbers on the scale."""
    flat = scene(*quad((0, 0, 0), (1, 0, 0), (0, 0.001, 1)))
    traced, baked, options = passed(flat, unit(0, 1, 0.001), "ray")
    empty = replace(traced, depths=np.full_like(traced.depths, np.nan))
    picture = np.zeros((8, 8, 3), np.uint8)
    near = bake_figures(baked, options, empty, picture, picture)[0]
    assert (near.picture == BACKGROUND).all()
    assert [words for _, words in near.scale[1]] == ["0"] * 5
