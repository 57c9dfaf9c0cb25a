"""The layout of charts, and the values that the surface shows, where both are known."""

import numpy as np
import pytest

from aoprecalc.render.comparison import (
    BACKGROUND,
    HEAT_MAP_PADDING,
    ao_histogram,
    chart_colors,
    chart_layout,
    heat_map_picture,
)
from aoprecalc.types import TexturedMesh
from shapes import join, quad, quad_uvs, scene

LEFT, RIGHT = ((0.0, 0.0), (0.5, 1.0)), ((0.75, 0.5), (1.0, 1.0))


def two_charts(cells=1):
    """Two quads, in the left half of the texture and in the upper half of its last quarter."""
    shape = join(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells), quad((2, 0, 0), (1, 0, 0), (0, 1, 0), cells))
    uvs = np.concatenate([quad_uvs(*LEFT, cells), quad_uvs(*RIGHT, cells)])
    made, normals = scene(*shape, uvs), np.zeros((len(uvs), 3, 3)) + (0, 0, 1)
    return TexturedMesh(made, normals, uvs, np.ones((8, 8), np.float32), np.ones(len(uvs), bool))


@pytest.mark.parametrize("cells", [1, 5])
def test_each_chart_covers_its_rectangle_in_a_colour_of_its_own(cells):
    layout = chart_layout(two_charts(cells), (64, 32))
    assert layout.charts == 2
    assert layout.picture.shape == (32, 64, 3)
    expected = np.zeros((64, 128), bool)
    expected[:, :64] = expected[:32, 96:] = True
    assert np.array_equal(layout.covered, expected)
    left, right, empty = layout.picture[16, 1], layout.picture[7, 62], layout.picture[24, 40]
    assert len({tuple(left.tolist()), tuple(right.tolist()), tuple(empty.tolist())}) == 3
    assert (layout.picture[20:, 36:] == empty).all()


def test_faces_without_the_texture_are_left_out():
    mesh = two_charts()
    bare = TexturedMesh(mesh.scene, mesh.normals, mesh.uvs, mesh.ao, np.zeros(4, bool))
    assert chart_layout(bare, (16, 16)) is None
    half = TexturedMesh(mesh.scene, mesh.normals, mesh.uvs, mesh.ao, np.array([True, True, False, False]))
    assert chart_layout(half, (16, 16)).charts == 1


def test_uvs_that_repeat_come_back_into_the_texture():
    mesh = two_charts()
    moved = TexturedMesh(mesh.scene, mesh.normals, mesh.uvs + (3, -2), mesh.ao, mesh.textured)
    assert np.array_equal(chart_layout(moved, (32, 32)).covered, chart_layout(mesh, (32, 32)).covered)


def test_colours_of_charts_differ_from_those_before_and_from_paper():
    colors = chart_colors(200)
    assert ((colors >= 0) & (colors <= 255)).all()
    assert np.abs(np.diff(colors, axis=0)).max(axis=1).min() > 20


def test_the_histogram_counts_what_the_surface_covers():
    ao = np.zeros((4, 4), np.float32)
    ao[:, :2], ao[:2, 3] = 0.25, 1.0
    covered = chart_layout(two_charts(), (16, 16)).covered
    counts, values = ao_histogram(ao, covered, 10)
    assert counts.sum() == len(values) == covered.sum()
    assert counts[2] / counts.sum() == 4 / 5  # a half of the texture and an eighth of it
    assert counts[9] / counts.sum() == 1 / 5
    whole, _ = ao_histogram(ao, None, 10)
    assert whole.sum() == 16


def test_a_heat_map_continues_its_colours_but_not_far():
    pixels = np.zeros((40, 40, 3), np.float32) + np.array(BACKGROUND) / 255
    pixels[:10] = (1, 0, 0)
    picture = heat_map_picture(pixels)
    assert (picture[: 10 + HEAT_MAP_PADDING] == (255, 0, 0)).all()
    assert (picture[10 + HEAT_MAP_PADDING :] == BACKGROUND).all()
    assert heat_map_picture(pixels[:, :, :1]).shape == (40, 40, 3)
