"""Faces that look the wrong way, and parts inside others: what is baked, and what is said."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, build_layout
from shapes import ball, cap, dented, join, quad, scene, torus, triangle_a_cell

backends = pytest.mark.parametrize("backend", ["gl", "ray"])
ONE_STEP = 1 / 255


def bake(made, backend, **options):
    return bake_scene(
        made, BakeOptions(**{"width": 128, "height": 128, "directions": 256, "backend": backend, **options})
    )


def reversed_scene(made):
    """The same surface and UVs with all faces turned."""
    return scene(made.positions, made.faces[:, ::-1], made.uvs[:, ::-1])


@backends
def test_a_ball_that_looks_inwards_is_dark_and_named_or_open_if_two_sided(backend):
    positions, faces = ball(3)
    inwards = scene(positions, faces[:, ::-1])
    baked = bake(inwards, backend)
    assert baked.texture.values[baked.texture.valid].max() < (1.5 * ONE_STEP if backend == "gl" else 1e-6)
    assert any("its faces point inwards" in line and "--two-sided" in line for line in baked.warnings)
    baked = bake(inwards, backend, two_sided=True)
    assert (baked.texture.values[baked.texture.valid] == 1).all()
    assert baked.dark.share == 0
    assert not any("--two-sided" in line for line in baked.warnings)


@backends
def test_two_sided_is_the_lighter_of_the_two_bakes(backend):
    """Half a sphere that looks outwards, half one that looks inwards, and a sheet beneath both."""
    positions, faces = cap(6)
    sheet = quad((-2, -2, -1.2), (6, 0, 0), (0, 4, 0), cells=4)
    plain = scene(*join((positions, faces), (positions + (2.5, 0, 0), faces[:, ::-1]), sheet))
    made = scene(plain.positions, plain.faces, triangle_a_cell(len(plain.faces)))
    front, back, both = (
        bake(mesh, backend, unwrap="keep", two_sided=two_sided)
        for mesh, two_sided in ((made, False), (reversed_scene(made), False), (made, True))
    )
    valid = both.texture.valid
    assert (front.texture.valid == valid).all()
    assert (back.texture.valid == valid).all()
    one, other = front.texture.values[valid], back.texture.values[valid]
    assert (one > other + 0.1).mean() > 0.1
    assert (other > one + 0.1).mean() > 0.1
    # Not to the bit: a turned face has its corners in another order, which rounds its samples' places otherwise.
    off = np.abs(both.texture.values[valid] - np.maximum(one, other))
    assert np.quantile(off, 0.99) < 1e-5
    assert off.max() < 1e-4


@backends
@pytest.mark.parametrize("shape", ["torus", "dented-seed-3"])
def test_two_sided_changes_nothing_where_a_closed_mesh_looks_outwards(shape, backend):
    made = scene(*(torus() if shape == "torus" else dented(3)))
    one, both = (bake(made, backend, two_sided=two_sided, directions=128) for two_sided in (False, True))
    assert np.abs(one.texture.values - both.texture.values).max() < 1e-6


@backends
def test_a_part_inside_another_is_dark_and_said(backend):
    inner = ball(2, 1.0)
    made = scene(*join(inner, ball(3, 3.0)))
    baked = bake(made, backend)
    sampler = CPURasterizer(build_layout(made, baked.atlas, 128, 128))
    texels = sampler.coverage()
    inside = sampler.samples(texels, CENTER).faces < len(inner[1])
    values = baked.texture.values.ravel()[texels.index]
    assert values[inside].max() < ONE_STEP
    assert (values[~inside] == 1).all()
    assert baked.dark.share == pytest.approx(inside.mean(), abs=0.01)
    assert any(f"{baked.dark.share:.1%} of texels are dark" in line for line in baked.notes)
