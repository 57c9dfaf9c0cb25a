"""The estimated error of a texture's resolution: nothing where nothing is lost, else what is measured afterwards."""

import math

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.verify import measure_texture
from aoprecalc.metrics import resolution
from aoprecalc.metrics.resolution import resolution_error
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.visibility.integrand import Integrand
from shapes import box, clutter, hull, join, notch, quad, quad_uvs, scene, torus

NOISE = 0.002  # of the reference that textures are measured with


def estimated(made, baked, size):
    return resolution_error(
        made, baked.normals, baked.atlas, (size, size), Integrand.from_options(BakeOptions(), made), 0
    )


@pytest.mark.parametrize("size", [64, 4096])
def test_an_open_surface_loses_nothing_at_any_size(size, monkeypatch):
    monkeypatch.setattr(resolution, "POINTS", 100)
    made = scene(*hull(np.random.default_rng(0).normal(size=(20, 3))))
    baked = bake_scene(made, BakeOptions(size=64, directions=2, backend="ray"))
    assert estimated(made, baked, size) == 0


def test_texels_around_points_at_the_sides_of_a_texture_that_repeats_are_found(monkeypatch):
    """A floor and a wall, once inside the page and once moved by half of it, across both sides."""
    monkeypatch.setattr(resolution, "POINTS", 500)
    shape = join(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 4), quad((0, 0, 0), (0, 1, 0), (0, 0, 1), 4))
    uvs = np.concatenate([quad_uvs((0, 0), (0.4, 0.4), 4), quad_uvs((0.6, 0.6), (1, 1), 4)])
    found = []
    for shift in (0.0, 0.5):
        made = scene(*shape, uvs + shift)
        baked = bake_scene(made, BakeOptions(size=64, directions=2, backend="ray"))
        assert baked.atlas.repeats == (shift > 0)
        found.append(estimated(made, baked, 64))
    assert found[1] == pytest.approx(found[0], rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("size", [64, 128, 256])
@pytest.mark.parametrize(
    "shape",
    [
        clutter(0),
        join(notch(60, 2.0), torus(around=24, across=12)),
        join(box(), quad((-4, -4, 0.3), (8, 0, 0), (0, 8, 0), 8)),  # a box through a floor: the light makes a step
    ],
    ids=["clutter", "notch", "step"],
)
def test_it_is_near_the_error_that_is_measured(shape, size):
    made = scene(*shape)
    baked = bake_scene(made, BakeOptions(size=size, directions=2048))
    measured = measure_texture(
        PreparedScene(made, baked.normals),
        baked.atlas,
        baked.texture.values,
        VerifyOptions(),
        Progress(),
        value=baked.options,
    )
    rest = baked.sampling_error**2 + NOISE**2
    lost = math.sqrt(max(measured.levels[0].rmse ** 2 - rest, 0.0))
    if lost > 0.003:
        assert lost / 2 < estimated(made, baked, size) < 2 * lost
    else:
        assert estimated(made, baked, size) < 0.006
