"""What samples see, by OpenGL, rays and the closed form of spheres; and the fragments that join them."""

from contextlib import ExitStack

import numpy as np
import pytest

from aoprecalc.gl.context import TriangleDrawer, open_renderer
from aoprecalc.render.camera import frame_views, view_axes
from aoprecalc.render.visible_surface import RayDrawer, SphereDrawer, fragments
from shapes import ball, clutter, quad, torus

WIDTH, HEIGHT = 240, 180


def drawer_of(kind, corners, stack):
    corners = np.asarray(corners, np.float32)
    if kind == "ray":
        return RayDrawer(corners, corners)
    return TriangleDrawer(stack.enter_context(open_renderer()), corners, corners)


@pytest.fixture
def stack():
    """What a test opens and leaves open."""
    with ExitStack() as stack:
        yield stack


def camera_on(points, azimuth=24.0, elevation=20.0, width=WIDTH, height=HEIGHT):
    return frame_views([(view_axes(azimuth, elevation), [(points, 0.8)])], width, height)[0]


def scaled(shape):
    positions, faces = shape
    return (positions / np.linalg.norm(positions, axis=1).max())[faces]


def cap(camera, center, radius):
    """How far each sample's ray is inside the cone around a sphere, in radians."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = camera.rays(columns, rows).astype(float)
    towards = center - camera.eye
    distance = np.linalg.norm(towards)
    cosine = rays @ towards / np.linalg.norm(rays, axis=-1) / distance
    return np.arcsin(radius / distance) - np.arccos(cosine)


@pytest.mark.parametrize("kind", ["gl", "ray", "analytic"])
@pytest.mark.parametrize(("center", "radius"), [((0, 0, 0), 1.0), ((0.5, 0.3, -0.2), 0.4), ((-0.4, -0.6, 0.5), 0.05)])
def test_a_spheres_outline_is_a_cone_of_rays(kind, center, radius, stack):
    camera = camera_on(ball(2)[0])
    center = np.array(center)
    inside = cap(camera, center, radius)
    if kind == "analytic":
        drawer, slack = SphereDrawer(center[None], np.array([radius])), 1e-6
    else:
        positions, faces = ball(5)
        drawer, slack = drawer_of(kind, center + radius * positions[faces], stack), 1e-3 * radius
    seen = drawer.visible(camera.clip_matrix(ball(2)[0] * 1.1), WIDTH, HEIGHT) >= 0
    assert seen[inside > slack].all()
    assert not seen[inside < -1e-6].any()
    # The solid angle of the cone, as the sum of what the samples that see it fill.
    area = np.prod(2 * camera.tangents) / seen.size
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    solid = (area / np.linalg.norm(camera.rays(columns, rows), axis=-1) ** 3)[seen].sum()
    sine = radius / np.linalg.norm(center - camera.eye)
    assert solid == pytest.approx(2 * np.pi * (1 - np.sqrt(1 - sine**2)), rel=0.01 + 0.0025 / radius)


@pytest.mark.parametrize(
    ("ahead", "aside", "radius"),
    [(1.0, 1.4, 1.2), (0.0, 3.0, 2.9), (-2.0, 0.0, 0.4), (0.0, 0.0, 50.0)],
    ids=["ahead", "beside", "behind", "around"],
)
def test_spheres_that_reach_behind_the_eye_are_seen_where_rays_forward_enter_them(ahead, aside, radius):
    camera = camera_on(ball(2)[0])
    center = camera.eye - ahead * camera.axes[2] + aside * camera.axes[0]
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays, away = camera.rays(columns, rows).astype(np.float64), camera.eye - center
    a, b, c = (rays**2).sum(axis=-1), rays @ away, away @ away - radius**2
    enters = (b * b > a * c) & (b < 0) & (c > 0)  # both roots of a t^2 + 2 b t + c are positive
    seen = SphereDrawer(center[None], np.array([radius])).visible(camera.clip_matrix(ball(2)[0]), WIDTH, HEIGHT) >= 0
    assert np.count_nonzero(seen != enters) <= 2  # samples on the outline


def test_bands_of_a_picture_of_spheres_make_it_whole():
    camera = camera_on(ball(2)[0])
    rng = np.random.default_rng(3)
    drawer, box = SphereDrawer(rng.uniform(-0.8, 0.8, (20, 3)), rng.uniform(0.02, 0.3, 20)), ball(2)[0]
    bands = [drawer.visible(band.clip_matrix(box), WIDTH, band.shape[0]) for band in camera.bands(50)]
    whole = drawer.visible(camera.clip_matrix(box), WIDTH, HEIGHT)
    assert (np.concatenate(bands) != whole).mean() < 1e-3  # samples on outlines, where numbers are rounded


@pytest.mark.parametrize("kind", ["gl", "ray", "analytic"])
def test_the_nearer_one_hides_the_farther(kind, stack):
    axes = view_axes(24, 20)
    centers = np.stack([-0.5 * axes[2], 0.5 * axes[2], 0 * axes[2]])
    camera = camera_on(ball(2)[0])
    radii = np.array([0.45, 0.2, 0.3])
    if kind == "analytic":
        drawer, each = SphereDrawer(centers, radii), 1
    else:
        positions, faces = ball(3)
        each = len(faces)
        drawer = drawer_of(
            kind, (centers[:, None] + radii[:, None, None] * positions)[:, faces].reshape(-1, 3, 3), stack
        )
    seen = drawer.visible(camera.clip_matrix(ball(2)[0] * 1.1), WIDTH, HEIGHT)
    column, row = camera.project(np.zeros(3))[:2].astype(int)
    assert seen[row, column] // each == 1
    assert set(np.unique(seen[seen >= 0] // each)) == {0, 1, 2}


@pytest.mark.parametrize("shape", [torus(), clutter(3), quad((-1, 0, -1), (2, 0, 0), (0, 0, 2), 8)])
@pytest.mark.parametrize("elevation", [20, 0, -50])
def test_gl_and_rays_see_the_same_but_at_edges(renderer, shape, elevation):
    corners = scaled(shape).astype(np.float32)
    camera = camera_on(corners.reshape(-1, 3).astype(float), elevation=elevation)
    matrix = camera.clip_matrix(corners.reshape(-1, 3))
    drawn = TriangleDrawer(renderer, corners, corners).visible(matrix, WIDTH, HEIGHT)
    traced = RayDrawer(corners, corners).visible(matrix, WIDTH, HEIGHT)
    other = drawn != traced
    assert other.mean() < 0.002
    # Where they differ, a neighbour sees something else: it is an edge.
    padded = np.pad(drawn, 1, mode="edge")
    at_edge = np.zeros(drawn.shape, bool)
    for row, column in np.ndindex(3, 3):
        at_edge |= padded[row : row + HEIGHT, column : column + WIDTH] != drawn
    assert at_edge[other].all()


def test_bands_are_parts_of_the_picture(renderer):
    corners = scaled(clutter(1)).astype(np.float32)
    drawer = TriangleDrawer(renderer, corners, corners)
    camera = camera_on(corners.reshape(-1, 3).astype(float))
    whole = drawer.visible(camera.clip_matrix(corners.reshape(-1, 3)), WIDTH, HEIGHT)
    bands = [
        drawer.visible(band.clip_matrix(corners.reshape(-1, 3)), WIDTH, band.shape[0]) for band in camera.bands(50)
    ]
    assert (np.concatenate(bands) != whole).mean() < 0.001


@pytest.mark.parametrize("samples", [1, 2, 4])
def test_fragments_join_the_samples_of_a_pixel(samples):
    rows, columns = 5, 7
    rng = np.random.default_rng(samples)
    indices = rng.integers(-1, 3, (rows * samples, columns * samples)).astype(np.int32)
    indices[: 2 * samples, : 3 * samples] = np.repeat(np.repeat([[0, -1, 2], [1, 1, -1]], samples, 0), samples, 1)
    expected = {}
    for row, column in np.ndindex(indices.shape):
        if indices[row, column] >= 0:
            key = (row // samples * columns + column // samples, indices[row, column])
            expected.setdefault(key, []).append(((column + 0.5) / samples, (row + 0.5) / samples))
    found = fragments(indices, samples)
    assert (np.diff(found.pixel) >= 0).all()
    assert len(found.pixel) == len(expected)
    for pixel, index, x, y, weight in zip(*(getattr(found, name) for name in vars(found)), strict=True):
        places = np.array(expected[pixel, index])
        np.testing.assert_allclose((x, y), places.mean(axis=0), atol=1e-5)
        assert weight == pytest.approx(len(places) / samples**2)


def test_nothing_seen_is_no_fragment():
    assert len(fragments(np.full((8, 12), -1, np.int32), 4).pixel) == 0
