"""The shading of previews against its formula, texture look-ups against the places that pixels see."""

import numpy as np
import pytest

from aoprecalc.mesh.surface import shading_normals
from aoprecalc.render.camera import PictureFrame, frame_views, view_axes
from aoprecalc.render.shading import (
    BOUNCE,
    CLAY,
    INSIDE,
    KEY,
    SKY,
    SPHERE,
    WHITE,
    PictureMesh,
    decode,
    encode,
    irradiance,
    self_shadow,
    shade,
    shade_spheres,
)
from aoprecalc.render.shadow import AreaLight
from aoprecalc.render.visible_surface import RayDrawer, SphereDrawer, fragments
from aoprecalc.types import BaseColor, TexturedMesh
from shapes import ball, quad, quad_uvs, scene

SIZE = (64, 48)
LIGHT = AreaLight((0.48, 0.6, 0.64), 0.2)


def textured(made, ao=None, uvs=None, **more):
    """A TexturedMesh of a scene."""
    covered = np.full(len(made.faces), ao is not None)
    picture = None if ao is None else np.asarray(ao, np.float32)
    return TexturedMesh(made, shading_normals(made), uvs, picture, **{"textured": covered, **more})


def colors_of(mesh, shading="ao", azimuth=0.0, elevation=0.0, size=SIZE):
    """The linear colours of a mesh's fragments, the fragments, and the camera."""
    frame = PictureFrame.from_positions(mesh.scene.positions, "y")
    drawn = PictureMesh.from_mesh(mesh, frame)
    points = frame.points(mesh.scene.positions)
    camera = frame_views([(view_axes(azimuth, elevation), [(points, 0.9)])], *size)[0]
    corners = drawn.opaque.corners
    indices = RayDrawer(corners, corners).visible(camera.clip_matrix(points), 2 * size[0], 2 * size[1])
    seen = fragments(indices, 2)
    return shade(drawn, seen, camera, LIGHT, shading)[0], seen, camera


def card(cells=1):
    """A square that faces +z, with UVs that fill the texture."""
    return scene(*quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), cells)), quad_uvs((0, 0), (1, 1), cells)


def test_a_planes_shade_is_the_formula():
    for normal in (np.array([0, 0, 1.0]), np.array([0.48, 0.6, 0.64]), np.array([0, 1.0, 0])):
        ambient, key = irradiance(normal[None].astype(np.float32), LIGHT)
        up = (1 + normal[1]) / 2
        np.testing.assert_allclose(ambient[0], SKY * up + BOUNCE * (1 - up), rtol=1e-6)
        np.testing.assert_allclose(key[0], KEY * (normal @ LIGHT.direction), rtol=1e-6)
    made, _ = card()
    colors, _, _ = colors_of(textured(made))
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    np.testing.assert_allclose(colors, np.broadcast_to(CLAY * (ambient + key), colors.shape), rtol=1e-5)


def test_the_key_light_fades_where_its_disc_sets():
    """Of a disc that is half below the horizon half the mean cosine is left; past its radius nothing is."""
    angle = np.linspace(0, np.pi, 400)
    axis = np.cross(LIGHT.direction, (0, 0, 1.0))
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, LIGHT.direction)
    normals = np.cos(angle)[:, None] * np.array(LIGHT.direction) + np.sin(angle)[:, None] * across
    key = irradiance(normals.astype(np.float32), LIGHT)[1][:, 0] / KEY[0]
    assert (np.diff(key) <= 1e-6).all()
    assert (key[angle > np.pi / 2 + LIGHT.radius + 0.01] == 0).all()
    cosines = np.maximum(normals @ LIGHT.directions(4000).T, 0).mean(axis=1)
    assert np.abs(key - cosines).max() < 0.02


@pytest.mark.parametrize("value", [0.0, 0.25, 0.6, 1.0])
def test_a_constant_texture_scales_the_ambient_light_exactly(value):
    made, uvs = card()
    lit, _, _ = colors_of(textured(made, np.full((4, 4), value), uvs))
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    left = self_shadow(np.float32(value), np.float32(LIGHT.direction[2]))
    np.testing.assert_allclose(lit, np.broadcast_to(CLAY * (value * ambient + left * key), lit.shape), rtol=1e-5)
    clay, _, _ = colors_of(textured(made, np.full((4, 4), value), uvs), "clay")
    np.testing.assert_allclose(clay, np.broadcast_to(CLAY * (ambient + key), lit.shape), rtol=1e-5)


def test_self_shadow_grows_with_the_ao_and_the_cosine():
    steps = np.linspace(0, 1, 41, dtype=np.float32)
    occlusion, cosine = np.meshgrid(steps, np.concatenate([-steps[:0:-1], steps]))
    seen = self_shadow(occlusion, cosine)
    assert (np.diff(seen, axis=0) >= 0).all()
    assert (np.diff(seen, axis=1) >= 0).all()
    assert (seen[occlusion == 1] == 1).all()
    assert (seen[occlusion == 0] == 0).all()


@pytest.mark.parametrize("rise", [47, 52])
def test_ambient_occlusion_can_be_read_and_white_does_not_clip(rise):
    """On surfaces of any orientation, in the light of previews."""
    positions = np.array(ball(4)[0])
    normals = (positions / np.linalg.norm(positions, axis=1, keepdims=True)).astype(np.float32)
    light = AreaLight((0.0, float(np.sin(np.radians(rise))), float(np.cos(np.radians(rise)))), 0.2)
    ambient, key = irradiance(normals, light)
    opened = ambient + key
    for occlusion in (0.0, 0.1, 0.3, 0.5, 0.9):
        left = self_shadow(np.float32(occlusion), normals @ np.array(light.direction, np.float32))
        dimmed = occlusion * ambient + left[:, None] * key
        assert (dimmed <= (occlusion + 1e-6) * opened).all()
    assert 0.95 < (WHITE * opened).max() <= 1
    assert 0.8 < (CLAY * opened).max() < 0.95
    assert opened.max() > 3 * opened.min()  # an open mesh has a shape


@pytest.mark.parametrize("azimuth", [0, 50, -65])
def test_the_texture_is_read_where_the_rays_meet_the_surface(azimuth):
    """A texture that rises linearly along u gives the place at which each fragment's ray meets the plane z = 0."""
    made, uvs = card(3)
    size = 256
    ramp = np.broadcast_to((np.arange(size) + 0.5) / size, (size, size))
    colors, seen, camera = colors_of(textured(made, ramp, uvs), azimuth=azimuth)
    rays = camera.rays(seen.x, seen.y).astype(float)
    at = camera.eye + rays * (-camera.eye[2] / rays[:, 2])[:, None]
    u = at[:, 0] * np.sqrt(2) / 2 + 0.5
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    left = self_shadow(u.astype(np.float32), np.float32(LIGHT.direction[2]))
    expected = CLAY * (u[:, None] * ambient + left[:, None] * key)
    inside = np.abs(u - 0.5) < 0.44  # beyond, the bilinear filter reads the other side of the texture
    assert inside.mean() > 0.8
    assert np.abs(colors - expected)[inside].max() < 0.01


@pytest.mark.parametrize("cells", [1, 5])
def test_fine_textures_do_not_alias(cells):
    """A chequerboard of single texels, far smaller than pixels, is its mean."""
    made, uvs = card(cells)
    chequer = np.indices((512, 512)).sum(axis=0) % 2
    colors, _, _ = colors_of(textured(made, chequer, uvs), size=(40, 30))
    mean, _, _ = colors_of(textured(made, np.full((2, 2), 0.5), uvs), size=(40, 30))
    np.testing.assert_allclose(colors, mean, atol=1e-3)


def test_faces_without_a_texture_are_open_clay():
    made, uvs = card()
    mesh = textured(made, np.zeros((4, 4)), uvs, textured=np.array([True, False]))
    colors, seen, _ = colors_of(mesh)
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    np.testing.assert_allclose(
        colors[seen.index == 1], np.broadcast_to(CLAY * (ambient + key), (sum(seen.index == 1), 3)), rtol=1e-5
    )
    assert (colors[seen.index == 0] < CLAY * (ambient + key)).all()


def test_backs_are_lit_from_their_own_side_and_tinted():
    made, _ = card()
    back, _, _ = colors_of(textured(made), azimuth=180)
    ambient, key = irradiance(np.array([[0, 0, -1]], np.float32), LIGHT)
    np.testing.assert_allclose(back, np.broadcast_to(CLAY * INSIDE * (ambient + key), back.shape), rtol=1e-5)
    # A file whose normals oppose the winding says which side is the front.
    turned = scene(made.positions, made.faces, normals=np.broadcast_to([0, 0, -1], (2, 3, 3)))
    front, _, _ = colors_of(textured(turned), azimuth=180)
    np.testing.assert_allclose(front, back / INSIDE, rtol=1e-5)


def test_base_colors_are_factor_times_texture():
    made, uvs = card()
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[:] = (188, 0, 255)
    factor = (0.5, 1.0, 0.25)
    mesh = textured(made, base_colors=(BaseColor(factor, picture, 3 * uvs - 1),))
    colors, _, _ = colors_of(mesh, "material")
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    expected = WHITE * np.array(factor) * decode(picture[0, 0]) * (ambient + key)
    np.testing.assert_allclose(colors, np.broadcast_to(expected, colors.shape), rtol=1e-4, atol=1e-6)


def test_fine_base_textures_do_not_alias():
    made, uvs = card(4)
    picture = np.repeat((255 * (np.indices((512, 512)).sum(axis=0) % 2)).astype(np.uint8)[..., None], 3, axis=2)
    colors, _, _ = colors_of(
        textured(made, base_colors=(BaseColor((1, 1, 1), picture, uvs),)), "material", size=(40, 30)
    )
    ambient, key = irradiance(np.array([[0, 0, 1]], np.float32), LIGHT)
    np.testing.assert_allclose(colors, np.broadcast_to(0.5 * WHITE * (ambient + key), colors.shape), rtol=1e-3)


def test_spheres_are_shaded_by_the_normal_where_rays_meet_them():
    center, radius = np.array([[0.2, 0.1, -0.1]]), np.array([0.7])
    points = ball(2)[0]
    camera = frame_views([(view_axes(24, 20), [(points, 0.9)])], *SIZE)[0]
    indices = SphereDrawer(center, radius).visible(camera.clip_matrix(points), 2 * SIZE[0], 2 * SIZE[1])
    seen = fragments(indices, 2)
    colors, depth, facing = shade_spheres(center, radius, seen, camera, LIGHT)
    rays = camera.rays(seen.x, seen.y).astype(float)
    at = camera.eye + depth[:, None] * rays
    inner = facing > 0.2
    assert inner.mean() > 0.8
    np.testing.assert_allclose(np.linalg.norm(at - center, axis=1)[inner], radius[0], rtol=1e-3)
    normals = (at - center) / radius
    expected = SPHERE * sum(irradiance(normals.astype(np.float32), LIGHT))
    np.testing.assert_allclose(colors[inner], expected[inner], rtol=0.01)


def test_srgb_is_that_of_the_standard():
    values = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(encode(decode(values)), values)
    linear = np.linspace(0, 1, 5001, dtype=np.float32)
    exact = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    assert np.abs(encode(linear) - 255 * exact).max() < 0.6
    assert encode(np.array([-1, 2], np.float32)).tolist() == [0, 255]


@pytest.mark.parametrize(("azimuth", "ao"), [(0.0, 0.25), (180.0, 1.0)])
def test_of_a_sheet_with_two_faces_the_front_is_shown(azimuth, ao):
    """Each triangle twice, wound both ways, in random order: which of the two is nearest is chance."""
    positions, faces = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 6)
    order = np.random.default_rng(0).permutation(2 * len(faces))
    both = np.concatenate([faces, faces[:, [1, 0, 2]]])[order]
    is_first = (order < len(faces))[:, None, None]
    normals = np.where(is_first, 1.0, -1.0) * np.array([0, 0, 1.0]) * np.ones((1, 3, 1))
    uvs = np.where(is_first, 0.25, 0.75) * np.array([1.0, 0]) * np.ones((1, 3, 1))
    texture = np.array([[0.25, 1.0]], np.float32)
    sheet = TexturedMesh(scene(positions, both), normals, uvs, texture, np.ones(len(both), bool))
    front = scene(positions, faces if azimuth == 0 else faces[:, [1, 0, 2]])
    alone = textured(front, np.full((1, 1), ao), np.zeros((len(faces), 3, 2)))
    expected, shown = (colors_of(mesh, azimuth=azimuth)[0] for mesh in (alone, sheet))
    np.testing.assert_allclose(shown, expected, rtol=1e-4)


def test_colors_of_vertices_are_interpolated():
    made, _ = card()
    red, green = np.array([1, 0.5, 0], np.float32), np.array([0, 0.5, 1], np.float32)
    share = (made.corners[..., :1] + 1) / 2
    colors = tuple(
        BaseColor(corners=(red + (green - red) * share[part.faces]).astype(np.float32)) for part in made.parts
    )
    shown, seen, _ = colors_of(textured(made, base_colors=colors), "material")
    plain, _, _ = colors_of(textured(made, base_colors=(BaseColor(),) * len(made.parts)), "material")
    ratio = shown / plain
    np.testing.assert_allclose(ratio.sum(axis=1), 1.5, rtol=1e-4)
    np.testing.assert_allclose(ratio[:, 1], 0.5, rtol=1e-4)
    order = np.argsort(seen.x)
    assert (np.diff(ratio[order, 0][:: len(order) // 8]) < 0).all()
