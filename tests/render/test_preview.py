"""The picture of a mesh and its spheres, against what must be true of any such picture."""

import numpy as np
import pytest

import shapes
from aoprecalc.render.rasterizer import (
    LIGHT_DIRECTION,
    Camera,
    ground_shadow,
    light_directions,
    mesh_caster,
    preview_image,
    preview_panels,
    rasterize_mesh,
    rasterize_spheres,
    shade,
    sphere_caster,
)
from aoprecalc.types import Scene

SIZE = (320, 160)
ONE = np.zeros((1, 3)), np.ones(1)  # the sphere that is the ball


@pytest.fixture(scope="module")
def ball() -> Scene:
    return shapes.scene(*shapes.ball(4))


@pytest.fixture(scope="module")
def both(ball) -> np.ndarray:
    """Mesh and sphere, (2, 160, 160, 3), as numbers."""
    picture = preview_image(ball, *ONE, size=SIZE).astype(int)
    return np.stack([picture[:, :160], picture[:, 160:]])


def camera_about(level: float = -1.0) -> Camera:
    """A camera that sees the plane y = level around the origin."""
    x, z = np.meshgrid([-4.0, 4.0], [-4.0, 4.0])
    return Camera.framing(np.stack([x.ravel(), np.full(4, level), z.ravel()], axis=1), 200, 200)


def test_a_ball_and_its_sphere_look_alike(both):
    grey = both.mean(axis=3)  # they have colours of their own
    paper = grey.max()
    object_or_shadow = np.abs(grey - paper) > 2
    assert (object_or_shadow[0] != object_or_shadow[1]).mean() < 0.005
    object_ = np.abs(both[..., 0] - both[..., 2])  # stone is warm, the spheres are cold, the paper is neither
    assert ((object_[0] > 20) != (object_[1] > 20))[:60].mean() < 0.02
    same = (object_ < 12).all(axis=0)  # ground in both
    assert same.mean() > 0.5
    assert np.abs(both[0] - both[1])[same].mean() < 1


def test_both_cast_the_same_shadow():
    camera = camera_about()
    mesh = ground_shadow(mesh_caster(*shapes.ball(4)), 1.0, -1.0, camera)
    sphere = ground_shadow(sphere_caster(*ONE), 1.0, -1.0, camera)
    assert np.abs(mesh - sphere).max() < 0.05
    assert np.abs(mesh - sphere).mean() < 0.001


def test_shadow_falls_away_from_the_light_and_is_darkest_at_contact():
    camera = camera_about()
    shadow = ground_shadow(sphere_caster(*ONE), 1.0, -1.0, camera).astype(float)
    ground = camera.unproject(camera.ground_view_z(-1.0))
    np.testing.assert_allclose(ground[..., 1], -1.0, atol=1e-9)
    away = ground @ -np.array([LIGHT_DIRECTION[0], 0, LIGHT_DIRECTION[2]])
    assert (away * shadow).sum() > 0
    assert shadow[away < -0.8].max() < 0.01
    darkest = ground[np.unravel_index(shadow.argmax(), shadow.shape)]
    touched = np.linalg.norm(ground[..., [0, 2]], axis=-1) < 0.1
    assert shadow[touched].min() == pytest.approx(1.0, abs=0.01)
    assert np.linalg.norm(darkest - (0, -1, 0)) < 1  # beneath the ball, and not out where its middle is cast
    assert shadow[0, 0] == shadow[-1, -1] == 0


def test_shadow_is_softer_the_higher_what_casts_it():
    camera = camera_about()
    softness = []
    for height in (0.4, 1.0, 2.0):
        shadow = ground_shadow(sphere_caster(np.array([[0, -1 + height, 0]]), np.array([0.3])), 3.0, -1.0, camera)
        softness.append(((shadow > 0.02) & (shadow < 0.98)).sum())
    assert softness == sorted(softness)
    assert softness[2] > 2 * softness[0]


def test_light_is_a_cone_of_unit_vectors_above_the_ground():
    light = light_directions()
    np.testing.assert_allclose(np.linalg.norm(light, axis=1), 1, atol=1e-12)
    assert 32 <= len(light) <= 64
    assert light[:, 1].min() > 0.3
    np.testing.assert_allclose(light.mean(axis=0) / np.linalg.norm(light.mean(axis=0)), LIGHT_DIRECTION, atol=0.02)


def test_shading_is_bounded_and_continuous():
    normals = shapes.ball(5)[0]
    bright = shade(normals)
    assert 0.05 < bright.min() < bright.max() < 1.3
    towards = normals @ LIGHT_DIRECTION
    assert np.corrcoef(bright, towards)[0, 1] > 0.9
    order = np.argsort(normals[:, 1])
    assert np.isfinite(bright[order]).all()


def test_mesh_and_sphere_have_the_same_nearness_and_normals():
    positions, faces = shapes.ball(5)
    camera = Camera.framing(positions, 120, 120)
    mesh = rasterize_mesh(positions[faces], positions[faces], camera)
    sphere = rasterize_spheres(*ONE, camera)
    common = mesh.mask & sphere.mask
    assert common.sum() > 0.99 * sphere.mask.sum()
    assert np.abs(mesh.view_z[common] - sphere.view_z[common]).mean() < 2e-3
    assert (mesh.normals * sphere.normals).sum(axis=2)[common].min() > 0.97
    inside_out = rasterize_mesh(positions[faces[:, ::-1]], -positions[faces[:, ::-1]], camera)
    np.testing.assert_allclose(inside_out.normals, mesh.normals, atol=1e-6)


def test_the_nearer_one_hides_the_farther():
    camera = camera_about()
    towards = camera.axes[2]
    centers = np.stack([towards, -towards, 0 * towards])
    seen = rasterize_spheres(centers, np.array([0.5, 0.5, 0.4]), camera)
    middle = camera.project(np.zeros(3))[:2].astype(int)
    assert seen.view_z[middle[1], middle[0]] == pytest.approx(1.5, abs=0.01)
    square = np.array([[-1, -1], [1, -1], [0, 1]]) @ camera.axes[:2]
    corners = np.stack([square - 0.5 * towards, square + 0.5 * towards, square])
    seen = rasterize_mesh(corners, np.broadcast_to(towards, corners.shape), camera)
    np.testing.assert_allclose(seen.view_z[seen.mask], 0.5)


def test_points_and_places_are_each_others_inverse():
    camera = camera_about()
    points = camera.unproject(camera.ground_view_z(-1.0))
    rows, columns = np.indices((camera.height, camera.width))
    np.testing.assert_allclose(camera.project(points)[..., :2], np.stack([columns, rows], axis=-1) + 0.5, atol=1e-9)


def test_nothing_is_cut_off(ball):
    far = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0]])
    for picture in (preview_image(ball, *ONE, size=SIZE), preview_image(ball, far, np.full(3, 0.7), size=SIZE)):
        for half in (picture[:, :160], picture[:, 160:]):
            border = np.concatenate([half[0], half[-1], half[:, 0], half[:, -1]]).astype(int)
            assert np.ptp(border, axis=0).max() <= 6


def test_what_lies_below_the_ground_is_hidden(ball):
    sunk = preview_panels(ball, [(np.array([[0.0, -1, 0]]), np.array([0.5]))], size=(160, 160))[1]
    whole = preview_panels(ball, [(np.array([[0.0, -0.4, 0]]), np.array([0.5]))], size=(160, 160))[1]
    cold = [(picture[..., 2].astype(int) - picture[..., 0] > 20).sum() for picture in (sunk, whole)]
    assert 0.3 * cold[1] < cold[0] < 0.8 * cold[1]


@pytest.mark.parametrize("size", [(320, 160), (301, 97), (2, 1)])
def test_size(ball, size):
    picture = preview_image(ball, *ONE, size=size)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8


def test_same_input_same_picture(ball, both):
    again = preview_image(ball, *ONE, size=SIZE)
    np.testing.assert_array_equal(again, np.concatenate(list(both), axis=1))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scale_and_place_do_not_matter(ball, both, scale):
    moved = shapes.scene(ball.positions * scale + 5 * scale, ball.faces)
    picture = preview_image(moved, ONE[0] + 5 * scale, ONE[1] * scale, size=SIZE).astype(int)
    apart = np.abs(picture - np.concatenate(list(both), axis=1))
    assert (apart > 2).mean() < 0.002


def test_up_axis_turns_the_scene():
    tall = shapes.ball(3)[0] * (0.4, 1, 0.5), shapes.ball(3)[1]
    turned = tall[0][:, [0, 2, 1]] * (1, -1, 1), tall[1]  # z is up where y was
    centers, radii = np.array([[0.0, 0.5, 0]]), np.array([0.4])
    upright = preview_image(shapes.scene(*tall), centers, radii, size=SIZE)
    lying = preview_image(shapes.scene(*turned), centers[:, [0, 2, 1]] * (1, -1, 1), radii, size=SIZE, up="z")
    np.testing.assert_array_equal(upright, lying)


@pytest.mark.parametrize("right_up", [((1, 0, 0), (0, 1, 0)), ((1, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1))])
def test_flat_meshes(right_up):
    flat = shapes.scene(*shapes.quad((0, 0, 0), *right_up))
    picture = preview_image(flat, np.array([[0.5, 0, 0.5]]), np.array([0.1]), size=SIZE)
    assert np.ptp(picture[:, :160].astype(int)) > 20


def test_degenerate_faces_and_spheres_of_no_size():
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]], float)
    scene = shapes.scene(positions, [[0, 1, 2], [0, 1, 3], [0, 0, 0]])
    picture = preview_image(scene, np.array([[0.2, 0.2, 0], [9, 9, 9]]), np.zeros(2), size=SIZE)
    assert picture.shape == (160, 320, 3)
