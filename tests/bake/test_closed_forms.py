"""Scenes whose ambient occlusion has a closed form."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from shapes import ball, box, disc, hull, join, quad, quad_uvs, scene, triangle_a_cell

ONE_STEP = 1 / 255


def values(scene, **options):
    """All measured texels of a small bake."""
    texture = bake_scene(scene, BakeOptions(**{"width": 128, "height": 128, "directions": 256, **options})).texture
    return texture.values[texture.valid]


def test_an_open_plane_is_one():
    assert (values(scene(*quad((0, 0, 0), (3, 1, 0), (-1, 2, 2)))) == 1).all()


@pytest.mark.parametrize("normals", ["smooth", "flat"])
@pytest.mark.parametrize("shape", ["ball", "box", "needle", "hull-seed-5"])
def test_a_convex_body_is_one_everywhere(shape, normals):
    body = {
        "ball": lambda: ball(3),
        "box": box,
        "needle": lambda: box((0, 0, 0), (100, 1, 0.5)),
        "hull-seed-5": lambda: hull(np.random.default_rng(5).normal(size=(60, 3))),
    }[shape]()
    assert values(scene(*body), normals=normals).min() >= 1 - ONE_STEP


def test_the_inside_of_a_closed_sphere_is_zero():
    positions, faces = ball(4)
    assert values(scene(positions, faces[:, ::-1])).max() <= ONE_STEP


@pytest.mark.parametrize("thick", [True, False], ids=["solid", "sheet"])
def test_a_floor_beside_a_long_wall(thick):
    """1/2 (1 + d / sqrt(d^2 + h^2)) at distance d from a wall of height h, both 200 h long."""
    height, length, depth = 1.0, 200.0, 4.0
    floor = quad((0, -length / 2, 0), (depth, 0, 0), (0, length, 0))
    if thick:
        wall = box((-0.5, -length / 2, 0), (0, length / 2, height))
        wall_uvs = triangle_a_cell(len(wall[1])) * (0.2, 1) + (0.8, 0)
    else:
        wall, wall_uvs = quad((0, -length / 2, 0), (0, length, 0), (0, 0, height)), quad_uvs((0.8, 0), (1, 1))
    uvs = np.concatenate([quad_uvs((0, 0), (0.75, 1)), wall_uvs])
    options = BakeOptions(width=256, height=32, normals="flat")
    picture = bake_scene(scene(*join(floor, wall), uvs), options).texture.values
    distance = (np.arange(192) + 0.5) / 192 * depth
    expected = (1 + distance / np.hypot(distance, height)) / 2
    assert np.abs(picture[16, :192] - expected).max() < 0.015


@pytest.mark.parametrize(("radius", "height"), [(1.0, 0.7), pytest.param(1.0, 2.0, marks=pytest.mark.slow), (0.3, 0.1)])
def test_a_floor_under_a_coaxial_disc(radius, height):
    """1 - R^2 / (R^2 + H^2) at the centre."""
    shade = disc(radius, height)
    uvs = np.concatenate([quad_uvs((0, 0), (0.5, 1)), shade[0][shade[1]][..., :2] / 8 + (0.75, 0.5)])
    floor = quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))
    options = BakeOptions(width=514, height=257, normals="flat")
    picture = bake_scene(scene(*join(floor, shade), uvs), options).texture.values
    assert picture[128, 128] == pytest.approx(1 - radius**2 / (radius**2 + height**2), abs=0.005)
