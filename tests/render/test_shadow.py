"""Soft shadows on the ground, against the solid angles that a sphere hides."""

from contextlib import ExitStack

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from aoprecalc.gl.context import TriangleDrawer, open_renderer
from aoprecalc.render.camera import frame_views, view_axes
from aoprecalc.render.shadow import (
    AreaLight,
    GroundShadow,
    cast_shadow,
    shadow_points,
    shadow_window,
    simplified,
    sky_directions,
)
from aoprecalc.render.visible_surface import RayDrawer, SphereDrawer
from shapes import ball, clutter, disc

CENTER, RADIUS, GROUND = np.array([0.1, 0.0, -0.2]), 0.4, -0.9
LIGHT = AreaLight(tuple(view_axes(-30, 55)[2].tolist()), np.radians(14))
BOX = CENTER + RADIUS * (2 * np.array(list(np.ndindex(2, 2, 2))) - 1)
WINDOW = shadow_window(BOX, GROUND, [LIGHT])


@pytest.fixture(params=["gl", "ray", "analytic"])
def sphere(request):
    """What draws the sphere."""
    positions, faces = ball(4)
    corners = (CENTER + RADIUS * positions)[faces].astype(np.float32)
    with ExitStack() as stack:
        if request.param == "analytic":
            yield SphereDrawer(CENTER[None], np.array([RADIUS]))
        elif request.param == "ray":
            yield RayDrawer(corners, corners)
        else:
            yield TriangleDrawer(stack.enter_context(open_renderer()), corners, corners)


def ground_points(size):
    """The points of the map, (size, size, 3)."""
    x, z = (WINDOW[k] + (np.arange(size) + 0.5) * WINDOW[2] / size for k in (0, 1))
    return np.stack(np.broadcast_arrays(x, np.float64(GROUND), z[:, None]), axis=-1)


def test_the_light_is_a_disc_of_directions():
    directions = LIGHT.directions(1000)
    angle = np.arccos(directions @ LIGHT.direction)
    assert angle.max() <= LIGHT.radius
    # Even spread: within half the radius lies about a quarter.
    assert (angle < LIGHT.radius / 2).mean() == pytest.approx(0.25, abs=0.01)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    mean = directions.mean(axis=0)
    np.testing.assert_allclose(mean / np.linalg.norm(mean), LIGHT.direction, atol=0.01)


def test_umbra_penumbra_and_light(sphere):
    key = cast_shadow(sphere, LIGHT.directions(), GROUND, WINDOW)
    towards = CENTER - ground_points(len(key))
    distance = np.linalg.norm(towards, axis=2)
    angle = np.arccos(towards @ np.array(LIGHT.direction) / distance)
    sphere_angle = np.arcsin(RADIUS / distance)
    blur = 0.12  # radians that the filter of the map may reach
    assert key[angle + LIGHT.radius < sphere_angle - blur].min(initial=1) > 0.999
    assert key[angle - LIGHT.radius > sphere_angle + blur].max() < 1e-3
    # In between: the share of the light's disc that the sphere covers, as random points of it find.
    rng = np.random.default_rng(1)
    offset = LIGHT.radius * np.sqrt(rng.random(4000)), 2 * np.pi * rng.random(4000)
    x, y = offset[0] * np.cos(offset[1]), offset[0] * np.sin(offset[1])
    picked = rng.integers(0, len(key), (300, 2))
    for row, column in picked:
        hidden = (np.hypot(x - angle[row, column], y) < sphere_angle[row, column]).mean()
        assert key[row, column] == pytest.approx(hidden, abs=0.06)


def test_the_sky_is_hidden_by_the_form_factor_of_the_sphere(sphere):
    sky = cast_shadow(sphere, sky_directions(), GROUND, WINDOW)
    towards = CENTER - ground_points(len(sky))
    squared = (towards**2).sum(axis=2)
    expected = RADIUS**2 / squared * towards[..., 1] / np.sqrt(squared)
    assert np.abs(sky - expected).max() < 0.03
    assert np.abs(sky - expected).mean() < 0.006
    assert sky.max() == pytest.approx((RADIUS / (CENTER[1] - GROUND)) ** 2, abs=0.02)


@pytest.mark.parametrize("size", [96, 384])
def test_the_edge_of_what_lies_on_the_ground_has_no_steps(size):
    positions, faces = disc(RADIUS, 0.0)
    corners = (positions[:, [0, 2, 1]] + (0, GROUND, 0))[faces].astype(np.float32)
    window = np.array([-0.8, -0.8, 1.6])
    blocked = cast_shadow(RayDrawer(corners, corners), np.array([[0.0, 1.0, 0.0]]), GROUND, window, size)
    turn = np.linspace(0, 2 * np.pi, 500)
    rim = (RADIUS * np.stack([np.sin(turn), np.cos(turn)]) + 0.8) * size / 1.6 - 0.5
    assert np.ptp(map_coordinates(blocked, rim, order=1)) < 0.25


def test_many_spheres_are_their_union():
    rng = np.random.default_rng(2)
    centers, radii = rng.uniform(-0.5, 0.5, (30, 3)), rng.uniform(0.02, 0.2, 30)
    positions, faces = ball(4)
    corners = (centers[:, None] + radii[:, None, None] * positions)[:, faces].reshape(-1, 3, 3).astype(np.float32)
    directions = LIGHT.directions()
    exact = SphereDrawer(centers, radii).count_shadows(directions, GROUND, WINDOW, 128)
    traced = RayDrawer(corners, corners).count_shadows(directions, GROUND, WINDOW, 128)
    assert np.abs(exact - traced).mean() < 0.004 * len(directions)


@pytest.mark.parametrize("height", [-0.3, 0.0, 0.25, 0.5])
@pytest.mark.parametrize("elevation", [10, 45, 90])
def test_what_is_under_the_ground_casts_no_shadow(height, elevation):
    size, radius, center = 96, 0.5, np.array([0.1, height, -0.2])
    window = np.array([-2.0, -2.0, 4.0])
    at = -2 + (np.arange(size) + 0.5) * 4 / size
    points = np.stack(np.broadcast_arrays(at, 0.0, at[:, None]), axis=-1)
    for azimuth in (0, 70, 200):
        light = view_axes(azimuth, elevation)[2]
        found = SphereDrawer(center[None], np.array([radius])).count_shadows(light[None], 0.0, window, size)
        towards = center - points
        middle = towards @ light
        gap = radius**2 - (towards**2).sum(axis=-1) + middle**2  # half the chord, squared
        expected = (gap >= 0) & (middle + np.sqrt(np.maximum(gap, 0)) >= 0)  # its far end is above the ground
        np.testing.assert_array_equal(found > 0, expected)


def test_gl_and_rays_cast_the_same_shadow(renderer):
    positions, faces = clutter(5)
    corners = (positions / np.linalg.norm(positions, axis=1).max())[faces].astype(np.float32)
    directions = np.concatenate([LIGHT.directions(24), sky_directions(24)])
    drawn, traced = (
        drawer.count_shadows(directions, -1.0, np.array([-2.0, -2.0, 4.0]), 100)
        for drawer in (TriangleDrawer(renderer, corners, corners), RayDrawer(corners, corners))
    )
    assert drawn.max() > 20
    assert np.abs(drawn - traced).mean() < 0.1
    assert np.abs(drawn - traced).max() <= 4


def test_simplified_triangles_cast_the_same_shadow(monkeypatch):
    monkeypatch.setattr("aoprecalc.render.shadow._MANY_TRIANGLES", 10)
    positions, faces = ball(6)
    corners = (CENTER + RADIUS * positions)[faces].astype(np.float32)
    few = simplified(corners)
    assert len(few) < 0.6 * len(corners)
    directions = LIGHT.directions()
    full, less = (RayDrawer(some, some).count_shadows(directions, GROUND, WINDOW, 128) for some in (corners, few))
    assert np.abs(full - less).mean() < 0.01 * len(directions)
    assert np.isfinite(simplified(np.zeros((20, 3, 3), np.float32))).all()


def test_the_picture_shows_the_map_where_the_ground_is():
    size = 128
    at = (np.arange(size) + 0.5) / size
    key = np.broadcast_to(at, (size, size)).astype(np.float32)
    shadow = GroundShadow(GROUND, np.array([-1.0, -1.0, 2.0]), key, np.zeros_like(key))
    points = np.array([[-1, GROUND, -1], [1, GROUND, 1], [1, GROUND, -1], [-1, GROUND, 1], [0, 0, 0]])
    camera = frame_views([(view_axes(20, 30), [(points, 0.9)])], 120, 90)[0]
    light = shadow.light(camera, 0.5, 0.5)
    columns, rows = np.meshgrid(np.arange(120) + 0.5, np.arange(90) + 0.5)
    rays = camera.rays(columns, rows).astype(np.float64)
    place = camera.eye + (GROUND - camera.eye[1]) / rays[..., 1:2] * rays
    inside = np.abs(place[..., [0, 2]]).max(axis=-1) < 1 - 2 / size
    share = np.clip((1 - np.hypot(place[..., 0], place[..., 2])) / 0.3, 0, 1)  # of the shadow near the map's edge
    expected = 1 - share**2 * (3 - 2 * share) * 0.5 * (place[..., 0] + 1) / 2
    assert np.count_nonzero(inside) > 2000
    np.testing.assert_allclose(light[inside], expected[inside], atol=3e-3)
    bands = [shadow.light(band, 0.5, 0.5) for band in camera.bands(25)]
    np.testing.assert_allclose(np.concatenate(bands), light, atol=1e-6)
    from_below = frame_views([(view_axes(20, -30), [(points, 0.9)])], 120, 90)[0]
    assert shadow.light(from_below, 0.5, 0.5).shape == (90, 120)


def test_shadow_points_lie_on_the_ground_along_the_light():
    points = np.random.default_rng(3).normal(size=(20, 3))
    cast = shadow_points(points, -2.0, LIGHT)
    np.testing.assert_allclose(cast[:, 1], -2)
    np.testing.assert_allclose(np.cross(points - cast, LIGHT.direction), 0, atol=1e-12)
