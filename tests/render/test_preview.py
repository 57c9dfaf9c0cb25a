"""Whole previews: what must be true of the picture of any mesh."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import PreviewOptions
from aoprecalc.progress import Progress
from aoprecalc.render.preview import preview_pictures
from aoprecalc.types import AlphaMask, Material, TexturedMesh
from shapes import (
    ball,
    box,
    cap,
    clutter,
    dented,
    quad,
    quad_uvs,
    rotation,
    scene,
    scene_of_parts,
    torus,
    triangle_a_cell,
)

SIZE = (160, 120)
BALL = ball(4)
ONE = np.zeros((1, 3)), np.ones(1)  # the sphere that is the ball


def textured(made, seed=None):
    """A mesh to draw; with a seed, its texture is random blotches."""
    uvs = ao = None
    if seed is not None:
        uvs = triangle_a_cell(len(made.faces))
        ao = np.kron(np.random.default_rng(seed).random((16, 16)), np.ones((8, 8))).astype(np.float32)
    return TexturedMesh(made, shading_normals(made), uvs, ao, np.full(len(made.faces), ao is not None))


def draw(made, spheres=None, seed=None, **options):
    """The pictures of a scene, as signed numbers."""
    options = {"size": SIZE, **options}
    mesh = made if isinstance(made, TexturedMesh) else textured(made, seed)
    return [picture.astype(int) for picture in preview_pictures(mesh, spheres, PreviewOptions(**options), Progress())]


def difference(first, second):
    """How much two pictures differ: the share of pixels that differ visibly, and the mean."""
    distance = np.abs(first - second).max(axis=-1)
    return (distance > 8).mean(), distance.mean()


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_the_same_input_gives_the_same_bytes(backend):
    made = scene(*dented(1))
    first = draw(made, seed=2, backend=backend)[0]
    for threads in (1, 2):
        np.testing.assert_array_equal(draw(made, seed=2, backend=backend, threads=threads)[0], first)


@pytest.mark.gl
@pytest.mark.parametrize("made", [scene(*torus()), scene(*clutter(2)), scene(*cap())])
@pytest.mark.parametrize("options", [{}, {"ground": True, "elevation": 5}, {"elevation": -30, "shading": "clay"}])
def test_gl_and_rays_draw_nearly_the_same(made, options):
    drawn, traced = (draw(made, seed=3, backend=backend, **options)[0] for backend in ("gl", "ray"))
    far, mean = difference(drawn, traced)
    assert far < 0.001
    assert mean < 0.05


@pytest.mark.parametrize(("moved", "scale"), [((1e6, -1e6, 1e6), 1), ((0, 0, 0), 1e-4), ((0, 0, 0), 1e7)])
def test_moving_and_scaling_leave_the_picture(moved, scale):
    positions, faces = torus()
    where = scale * positions + np.array(moved)
    spheres = np.zeros((1, 3)), np.full(1, 0.5)
    there = moved + scale * spheres[0], scale * spheres[1]
    far, mean = difference(draw(scene(positions, faces), spheres)[0], draw(scene(where, faces), there)[0])
    assert far < 0.001
    assert mean < 0.02


TURNS = {"x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}


@pytest.mark.parametrize("up", TURNS)
def test_the_upward_axis_turns_the_mesh(up):
    positions, faces = clutter(4)
    upright = draw(scene(positions, faces))[0]
    turned = textured(scene(positions @ np.array(TURNS[up]).T, faces))
    far, mean = difference(draw(turned, up=up)[0], upright)
    assert far < 0.001
    assert mean < 0.02
    assert difference(draw(turned)[0], upright)[0] > 0.05
    of_stl = replace(turned, scene=replace(turned.scene, format="stl"))
    assert (difference(draw(of_stl)[0], upright)[0] < 0.001) == (up == "z")


DEGENERATE = {
    "a triangle": ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "a point": ([[5, 5, 5]] * 3, [[0, 1, 2]]),
    "a line": ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]]),
    "a sheet": quad((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    "a sheet seen edge on": quad((0, 0, 0), (0, 1, 0), (0, 0, 1)),
    "a needle": box((-1, -1e-4, -1e-4), (1, 1e-4, 1e-4)),
    "a needle seen from its tip": box((-1e-3, -1e-3, -1), (1e-3, 1e-3, 1)),
    "a face without area beside one with": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 1, 2], [0, 1, 3]]),
    "a mesh far away": (np.array(BALL[0]) + 1e9, BALL[1]),
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_degenerate_meshes_are_drawn(name, backend):
    made = scene(*DEGENERATE[name])
    for options in ({}, {"azimuth": 0, "elevation": 0}, {"elevation": 90}):
        picture = draw(made, backend=backend, **options)[0]
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        # There is a backdrop, and what is drawn does not touch the picture's edge.
        edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert edge.min() > 150


def test_a_ball_is_a_disc_of_the_size_that_the_camera_says():
    picture = draw(scene(*BALL), shading="clay", elevation=-40, size=(240, 240))[0]
    background = draw(scene([[0, 0, 0], [0, 0, 0], [0, 0, 0]], [[0, 1, 2]]), elevation=-40, size=(240, 240))[0]
    covered = np.abs(picture - background).max(axis=2) > 3
    rows, columns = np.nonzero(covered)
    # Framed in 0.84 of the picture by the bounding points of the ball: up to its facets the disc is as wide.
    assert np.ptp(rows) == pytest.approx(0.84 * 240, abs=4)
    assert covered.sum() == pytest.approx(np.pi / 4 * np.ptp(rows) * np.ptp(columns), rel=0.02)


def test_views_turn_around_the_mesh():
    made = scene(*BALL)
    pictures = draw(made, views=4, azimuth=10)
    assert len(pictures) == 4
    for picture in pictures[1:]:  # a ball looks the same from all around
        assert difference(picture, pictures[0])[1] < 1
    frames = draw(scene(*clutter(6)), turntable=True, frames=3)
    assert len(frames) == 3
    assert min(difference(frames[0], frame)[0] for frame in frames[1:]) > 0.02


@pytest.mark.parametrize("width", [160, 161])
@pytest.mark.parametrize("ground", [False, True])
def test_a_ball_and_its_sphere_look_alike_beside_each_other(width, ground):
    picture = draw(scene(*BALL), ONE, size=(width, 120), shading="clay", ground=ground)[0]
    assert picture.shape == (120, width, 3)
    half = width // 2
    mesh, sphere = picture[:, :half], picture[:, -half:]
    blue = [(panel[..., 2] - panel[..., 0]) for panel in (mesh, sphere)]
    assert blue[0].max() < 15 < blue[1].max()
    # Where neither is drawn, the backdrops and both shadows are the same.
    free = (blue[1] < 15) & (blue[0] > -6)
    assert free.mean() > 0.4
    assert np.abs(mesh - sphere)[free].mean() < 2


def test_spheres_over_the_mesh_let_it_through():
    made = scene(*box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)))
    plain = draw(made)[0]
    over = draw(made, (np.zeros((1, 3)), np.full(1, 0.6)), spheres_view="over")[0]
    assert over.shape == plain.shape
    bluer = (over[..., 2] - over[..., 0]) - (plain[..., 2] - plain[..., 0])
    middle = over[50:70, 70:90]
    assert 10 < bluer[50:70, 70:90].mean() < 80
    assert np.ptp(middle.sum(axis=2)) > 10  # the edges of the box are seen through the sphere


@pytest.mark.parametrize(("height", "radius"), [(0.0, 0.05), (-1.4, 0.2)], ids=["inside the mesh", "under the ground"])
def test_spheres_are_hidden_by_what_is_before_them(height, radius):
    made = scene(*BALL)
    hidden = np.array([[0.0, height, 0.0]]), np.array([radius])
    np.testing.assert_array_equal(draw(made, hidden, spheres_view="over")[0], draw(made)[0])


def test_ground_compares_the_shadows_of_mesh_and_spheres():
    made = scene(*torus())
    far_off = np.array([[0.0, 0.6, 0.0]]), np.array([0.2])
    picture = draw(made, far_off, spheres_view="over", ground=True, size=(320, 120))[0]
    same = draw(made, far_off, spheres_view="over", ground=True, size=(320, 120))[0]
    np.testing.assert_array_equal(picture, same)
    left, right = picture[:, :160], picture[:, 160:]
    ring = np.abs(left - right).max(axis=2)
    assert (ring > 8).mean() > 0.02  # the shadows differ
    assert (ring == 0).mean() > 0.3  # the mesh does not


def test_holes_of_alpha_masks_show_what_is_behind():
    size = 64
    at = np.hypot(*np.meshgrid(*[(np.arange(size) + 0.5) / size - 0.5] * 2))
    uvs = quad_uvs((0, 0), (1, 1))
    made = scene(*quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)))
    mask = AlphaMask((at > 0.25).astype(np.float32), uvs, np.ones((2, 3)), 0.5)
    holed = replace(made, parts=(replace(made.parts[0], material=Material(alpha_mask=mask)),))
    options = {"azimuth": 0, "elevation": 0, "size": (200, 200), "shading": "clay"}
    solid, pierced = draw(made, **options)[0], draw(holed, **options)[0]
    open_ = np.abs(solid - pierced).max(axis=2) > 8
    side = 0.84 * 200  # pixels, of the square
    assert open_.sum() == pytest.approx(np.pi * (0.25 * side) ** 2, rel=0.05)


def test_glass_lets_what_is_behind_it_through():
    inner, outer = box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)), box((-0.6, -0.6, -0.6), (0.6, 0.6, 0.6))
    both = scene_of_parts(inner, outer)
    glass = replace(both, parts=(both.parts[0], replace(both.parts[1], material=Material(transparent=True))))
    solid, clear = draw(both)[0], draw(glass)[0]
    behind = scene_of_parts(outer, inner)
    hidden = replace(behind, parts=(behind.parts[0], replace(behind.parts[1], material=Material(transparent=True))))
    changed = np.abs(solid - clear).max(axis=2) > 8
    assert changed[50:70, 70:90].mean() > 0.5
    np.testing.assert_array_equal(draw(hidden)[0], draw(scene(*outer))[0])  # glass inside a solid box
    only = replace(both, parts=tuple(replace(part, material=Material(transparent=True)) for part in both.parts))
    np.testing.assert_array_equal(draw(only)[0], solid)


def test_a_picture_beyond_what_is_drawn_at_once_is_drawn_in_bands(monkeypatch):
    made = scene(*clutter(7))
    whole = draw(made)[0]
    monkeypatch.setattr("aoprecalc.render.preview._MAX_SAMPLES", 160 * 16 * 25)
    far, mean = difference(draw(made)[0], whole)
    assert far < 0.001
    assert mean < 0.05


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_touches_the_edge_of_the_picture(seed):
    rng = np.random.default_rng(seed)
    positions, faces = clutter(seed)
    made = scene(positions * rng.uniform(0.1, 2, 3) @ rotation(seed), faces)
    for options in ({"views": 2}, {"elevation": 70}, {"size": (60, 200)}):
        for picture in draw(made, shading="clay", **options):
            edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
            assert edge.min() > 150
