"""The endless ground plane at a height of its own, against closed forms, by depth maps and by rays."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.verify import measure_texture
from aoprecalc.options import BakeOptions, PreviewOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.render.preview import preview_pictures
from aoprecalc.types import TexturedMesh
from shapes import quad, quad_uvs, scene

OPTIONS = {"size": 16, "unwrap": "keep", "directions": 2000, "ground": True, "up": "z"}


def wall():
    """An upright wall from z = 0 to 2 that faces -y, whose v is half the height."""
    return scene(*quad((0, 0, 0), (2, 0, 0), (0, 0, 2)), uvs=quad_uvs((0, 0), (1, 1)))


def test_a_face_over_the_ground_is_one_under_a_plate():
    """Over ground at a distance h below D nothing within the angle cos^-1(h / D) is open: 1 - (h / D)^2 is taken."""
    made = scene(*quad((0, 0, 1), (0, 0.02, 0), (0.02, 0, 0)), uvs=quad_uvs((0, 0), (1, 1)))
    for height, distance in ((0.5, 1.25), (-3, 5)):
        texture = bake_scene(made, BakeOptions(**OPTIONS, ground_height=height, max_distance=distance)).texture
        expected = ((1 - height) / distance) ** 2
        np.testing.assert_allclose(texture.values[texture.valid], expected, atol=5e-3)
    texture = bake_scene(made, BakeOptions(**OPTIONS, ground_height=0.5, max_distance=0.49)).texture
    assert (texture.values == 1).all()


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_what_lies_below_the_ground_is_dark(backend):
    baked = bake_scene(wall(), BakeOptions(**OPTIONS, ground_height=1, backend=backend, padding=0))
    np.testing.assert_allclose(baked.texture.values[:7], 0.5, atol=0.01)
    assert (baked.texture.values[9:] < 0.01).all()
    assert baked.warnings == (
        "50.0% of texels lie below the ground at 1 and are dark: the mesh reaches from 0 to 2 along z; use a "
        "--ground-height of at most 0",
    )
    assert not [line for line in baked.notes if "ground" in line or "dark" in line]
    assert baked.dark.below_ground == pytest.approx(0.5, abs=0.05)
    found = measure_texture(
        PreparedScene(baked.scene, baked.normals),
        baked.atlas,
        baked.texture.values,
        VerifyOptions(points=500, rays=256),
        Progress(),
        value=baked.options,
    )
    away = np.abs(found.uvs[:, 1] - 0.5) > 1 / 16
    assert np.abs(found.errors[away]).max() < 0.03
    assert baked.options.ground_height == 1


def test_a_mesh_below_the_ground_is_told_in_one_line():
    options = {**OPTIONS, "up": "auto", "directions": 64, "backend": "ray"}
    baked = bake_scene(wall(), BakeOptions(**options, ground_height=3))
    (line,) = (line for line in (*baked.warnings, *baked.notes) if "ground" in line or "dark" in line)
    assert line == (
        "100.0% of texels lie below the ground at 3 and are dark: the mesh reaches from 0 to 0 along y; use a "
        "--ground-height of at most 0, or name another axis with --up"
    )
    known = bake_scene(replace(wall(), up="z"), BakeOptions(**options, ground_height=3))
    assert known.warnings == (
        "100.0% of texels lie below the ground at 3 and are dark: the mesh reaches from 0 to 2 along z; use a "
        "--ground-height of at most 0",
    )


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_floor_on_the_ground_is_not_below_it(backend):
    made = scene(*quad((0, 0, 7), (2, 0, 0), (0, 2, 0)), uvs=quad_uvs((0, 0), (1, 1)))
    assert (bake_scene(made, BakeOptions(**OPTIONS, ground_height=7, backend=backend)).texture.values == 1).all()


@pytest.mark.parametrize("distance", [None, 5])
def test_the_default_is_the_lowest_point(distance):
    options = {**OPTIONS, "directions": 64, "max_distance": distance, "backend": "ray"}
    default, given = (
        bake_scene(wall(), BakeOptions(**options, ground_height=height)).texture.values for height in (None, 0)
    )
    np.testing.assert_allclose(default, given, atol=1e-6)


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_picture_has_the_ground_where_it_was(backend):
    """The wall stands on the ground, above it, or half in it: then its lower half is not seen."""
    pictures = {}
    for height in (0, -1, 1, 2.5):
        baked = bake_scene(wall(), BakeOptions(**{**OPTIONS, "directions": 64}, ground_height=height, backend="ray"))
        mesh = TexturedMesh(baked.scene, baked.normals.astype(np.float64), None, None, np.zeros(2, bool))
        options = PreviewOptions(size=(96, 96), up="z", shading="clay", backend=backend)
        pictures[height] = preview_pictures(mesh, None, options, Progress())[0].astype(int)
    wall_pixels = {
        height: np.count_nonzero(np.abs(picture - pictures[2.5]).max(axis=2) > 8)
        for height, picture in pictures.items()
    }
    assert 0 < wall_pixels[1] < 0.8 * wall_pixels[0]
    assert (pictures[0] != pictures[-1]).any()
