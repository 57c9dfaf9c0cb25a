"""The rasterizer without OpenGL: held against the one with it, texel by texel."""

import subprocess
import sys

import numpy as np
import pytest

from aoprecalc.raster import cpu_rasterizer
from aoprecalc.raster import layout as raster_layout
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout
from aoprecalc.types import Atlas, Texels
from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.unwrap import unwrap
from shapes import quad, quad_uvs, scene, torus


def laid_out(uvs, width, height, repeats=False):
    """A layout of triangles that share nothing but what their UVs make them share."""
    positions = np.random.default_rng(0).normal(size=(len(uvs) * 3, 3))
    made = scene(positions, np.arange(len(uvs) * 3).reshape(-1, 3), uvs)
    return build_layout(made, Atlas("keep", uvs, np.ones(len(uvs), bool), 1, repeats=repeats), width, height)


def random_uvs(seed, count, centres=1.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, centres, (count, 1, 2)) + rng.normal(size=(count, 3, 2)) * rng.choice(
        [0.003, 0.03, 0.1], (count, 1, 1)
    )


def scattered(seed):
    """Triangles of all sizes, thin ones among them, with gaps between and some over others."""
    return laid_out(np.clip(random_uvs(seed, 60), 0.01, 0.99), 250, 170)


def mesh():
    made = scene(*torus())
    return build_layout(made, unwrap(made, "xatlas", PageSpec(256, 4)), 256, 256)


def wrapped_quad():
    uvs = quad_uvs((0.25, 0.25), (1.6, 0.75), cells=7) + (0.5, 3.0)
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=7), uvs)
    return build_layout(made, Atlas("keep", uvs, np.ones(len(uvs), bool), 1, repeats=True), 128, 96)


def on_the_grid():
    """Corners on texel corners and centres, so that edges run through centres and along the sides of squares."""
    return laid_out(np.random.default_rng(5).integers(0, 161, (60, 3, 2)) / 160, 80, 80)


LAYOUTS = {
    **{f"scattered-{seed}": lambda seed=seed: scattered(seed) for seed in range(4)},
    "mesh": mesh,
    "wrapped-quad": wrapped_quad,
    "wrapped-scattered": lambda: laid_out(random_uvs(9, 40, centres=3.0), 200, 150, repeats=True),
    "on-the-grid": on_the_grid,
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_agrees_with_opengl(on_gl, name):
    layout = LAYOUTS[name]()
    ours, theirs = CPURasterizer(layout), on_gl(layout)
    covered = theirs.coverage()
    assert len(covered) > 2000
    np.testing.assert_array_equal(ours.coverage().index, covered.index)
    assert ours.overlap() == pytest.approx(theirs.overlap(), abs=2 / len(covered))
    for sample_at in [(0.5, 0.5), (0.1, 0.9), (0.93, 0.02), (0.3, 0.7), (0.0, 0.0)]:
        our, their = ours.samples(covered, sample_at), theirs.samples(covered, sample_at)
        # Not all: where two borders meet, either may be found the nearer by rounding; and OpenGL moves the edges of
        # triangles that reach out of the picture by a hair.
        same = our.faces == their.faces
        same &= np.abs(our.weights - their.weights).max(axis=1) < 1e-3
        assert same.mean() >= 0.999


def test_bands_have_the_same_order_as_with_opengl(on_gl, monkeypatch):
    monkeypatch.setattr(raster_layout, "BAND_TEXELS", 256 * 37)  # no whole number of blocks
    layout = mesh()
    np.testing.assert_array_equal(CPURasterizer(layout).coverage().index, on_gl(layout).coverage().index)


def test_how_the_work_is_cut_changes_nothing(monkeypatch):
    layout = scattered(0)
    every = Texels(layout.width, layout.height, np.arange(layout.width * layout.height, dtype=np.int32)[::-1])
    whole = CPURasterizer(layout)
    expected, covered, overlap = whole.samples(every, (0.2, 0.6)), whole.coverage(), whole.overlap()
    monkeypatch.setattr(raster_layout, "BAND_TEXELS", layout.width * 23)
    monkeypatch.setattr(cpu_rasterizer, "_SPAN_CHUNK", 50)
    monkeypatch.setattr(cpu_rasterizer, "_CHUNK", 1000)
    cut = CPURasterizer(layout)
    found = cut.samples(every, (0.2, 0.6))
    np.testing.assert_array_equal(found.faces, expected.faces)
    np.testing.assert_array_equal(found.weights, expected.weights)
    np.testing.assert_array_equal(np.sort(cut.coverage().index), np.sort(covered.index))
    assert cut.overlap() == overlap


def test_triangles_hide_later_ones_and_every_border():
    big = np.array([(0.1, 0.1), (0.9, 0.1), (0.1, 0.9)])
    small = big * 0.5 + 0.1  # inside the big one, and so are its sides, which must not show
    for uvs, number_of_small, texels_of_small in (([big, small], 1, 0), ([small, big], 0, 0.5 * 25.6**2)):
        drawn = CPURasterizer(laid_out(np.stack(uvs), 64, 64))
        found = drawn.samples(drawn.coverage(), (0.5, 0.5))
        assert np.count_nonzero(found.faces == number_of_small) == pytest.approx(texels_of_small, rel=0.1)
        assert drawn.overlap() > 0.1


def test_texels_off_the_surface_have_no_sample():
    layout = laid_out(np.array([[(0.1, 0.1), (0.3, 0.1), (0.1, 0.3)]]), 32, 32)
    found = CPURasterizer(layout).samples(Texels(32, 32, np.arange(4, dtype=np.int32)), (0.5, 0.5))
    assert found.faces.tolist() == [-1] * 4
    assert found.weights.tolist() == [[1, 0, 0]] * 4


def test_needs_no_opengl():
    script = """
import sys
import numpy as np
from aoprecalc.raster.layout import Layout
from aoprecalc.raster.cpu_rasterizer import CPURasterizer

places = np.array([[(1, 1), (9, 2), (3, 8)]], np.float32)
none = np.zeros(1, np.int32)
raster = CPURasterizer(Layout(10, 10, places, none, places, none, none))
covered = raster.coverage()
assert (raster.samples(covered, (0.3, 0.4)).faces == 0).mean() > 0.9
assert raster.overlap() == 0
assert "moderngl" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True)
