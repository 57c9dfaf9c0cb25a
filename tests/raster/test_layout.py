"""An atlas of UVs as they are: what leaves the page, and how many charts there are."""

import numpy as np
import pytest

from aoprecalc.raster.layout import Samples, atlas_from_uvs, texel_positions
from aoprecalc.types import Atlas, Texels
from shapes import join, quad, quad_uvs, scene


@pytest.mark.parametrize(("beyond", "repeats"), [(0.0, False), (5e-7, False), (1e-5, True), (1.0, True)])
@pytest.mark.parametrize("side", [1, -1])
def test_uvs_leave_the_page_by_more_than_rounding_only(side, beyond, repeats):
    uvs = quad_uvs((0, 0), (1, 1)) + side * np.array([beyond, 0.0])
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), uvs)
    assert atlas_from_uvs(made, uvs, np.ones(2, bool)).repeats == repeats


def test_only_the_faces_that_count_make_charts_and_leave_the_page():
    floors = [quad((0, 0, height), (1, 0, 0), (0, 1, 0)) for height in range(3)]
    uvs = np.concatenate(
        [quad_uvs((0.1 + 0.3 * n, 0.1), (0.3 + 0.3 * n, 0.3)) for n in range(2)] + [quad_uvs((5, 5), (6, 6))]
    )
    made = scene(*join(*floors), uvs)
    mapped = np.arange(6) < 4
    atlas = atlas_from_uvs(made, uvs, mapped)
    assert (atlas.charts, atlas.repeats) == (2, False)
    assert (atlas_from_uvs(made, uvs, ~mapped).charts, atlas_from_uvs(made, uvs, ~mapped).repeats) == (1, True)


@pytest.mark.parametrize("shift", [0.0, 0.7])
def test_samples_lie_where_they_do_among_fewer_or_more_than_there_are_faces_seed_5(shift):
    rng = np.random.default_rng(5)
    uvs = rng.random((9, 3, 2)) + shift
    atlas = Atlas("keep", uvs, np.ones(len(uvs), bool), len(uvs), repeats=shift > 0)
    samples = Samples(rng.integers(0, 9, 20).astype(np.int32), rng.dirichlet((1, 1, 1), 20).astype(np.float32))
    texels = Texels(64, 32, np.zeros(0, np.int32))
    many = texel_positions(atlas, texels, samples)
    few = [texel_positions(atlas, texels, samples.select(slice(start, start + 4))) for start in range(0, 20, 4)]
    assert (np.concatenate(few) == many).all()
    corners = uvs - np.floor(uvs.min(axis=1, keepdims=True)) if shift else uvs
    at = np.einsum("kc,kcx->kx", samples.weights, corners[samples.faces]) * (64, -32) + (0, 32)
    assert many == pytest.approx(at, abs=1e-4)
