"""Texel coverage and what lies under each sample, by either rasterizer, against a slow reference."""

import numpy as np
import pytest

from aoprecalc.raster.layout import build_layout
from aoprecalc.types import Atlas, Texels
from shapes import quad, quad_uvs, scene

SIZE = 32


def atlas_of(uvs, repeats=False):
    return Atlas("keep", uvs, np.ones(len(uvs), bool), 1, repeats=repeats)


def random_triangles(seed, count=12):
    """Triangles with UVs anywhere, thin ones among them; none shares an edge."""
    rng = np.random.default_rng(seed)
    uvs = rng.uniform(0.05, 0.95, (count, 1, 2)) + rng.normal(size=(count, 3, 2)) * rng.choice(
        [0.003, 0.05, 0.2], (count, 1, 1)
    )
    uvs = np.clip(uvs, 0.02, 0.98)
    positions = rng.normal(size=(count * 3, 3))
    return scene(positions, np.arange(count * 3).reshape(-1, 3), uvs), uvs


def squares_touched(triangle):
    """Slow reference: which of SIZE x SIZE squares a triangle in texels touches, by separating axes."""
    row, column = np.mgrid[0:SIZE, 0:SIZE]
    squares = np.stack([column, row], -1)[..., None, :] + np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    sides = np.roll(triangle, -1, axis=0) - triangle
    touched = np.ones((SIZE, SIZE), bool)
    for normal in [(1.0, 0.0), (0.0, 1.0), *np.column_stack([-sides[:, 1], sides[:, 0]])]:
        ours, theirs = triangle @ normal, squares @ np.asarray(normal)
        touched &= (ours.max() >= theirs.min(axis=-1)) & (ours.min() <= theirs.max(axis=-1))
    return touched


def lies_inside(triangle, points, by=0.01):
    """Slow reference: which of (k, 2) points lie inside a triangle, `by` texels from its sides or more."""
    sides = np.roll(triangle, -1, axis=0) - triangle
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1, keepdims=True)
    away = np.stack([(points - start) @ normal for start, normal in zip(triangle, normals, strict=True)])
    return (away > by).all(axis=0) | (away < -by).all(axis=0)


@pytest.mark.parametrize("seed", range(6))
def test_every_touched_square_is_covered_and_no_other(rasterizer, seed):
    made, uvs = random_triangles(seed)
    texels = rasterizer(build_layout(made, atlas_of(uvs), SIZE, SIZE)).coverage()
    covered = np.zeros(SIZE * SIZE, bool)
    covered[texels.index] = True
    places = uvs * (SIZE, -SIZE) + (0, SIZE)
    grown, shrunk = (
        np.any([squares_touched(place + (place - place.mean(axis=0)) * by) for place in places], axis=0).ravel()
        for by in (0.02, -0.02)
    )
    assert not (covered & ~grown).any()
    assert (covered >= shrunk).all()


@pytest.mark.parametrize("sample_at", [(0.5, 0.5), (0.1, 0.9), (0.93, 0.02)])
@pytest.mark.parametrize("seed", range(3))
def test_samples_lie_on_their_face_in_their_square_or_close_by(rasterizer, seed, sample_at):
    made, uvs = random_triangles(seed)
    texels = Texels(SIZE, SIZE, np.arange(SIZE * SIZE, dtype=np.int32))
    samples = rasterizer(build_layout(made, atlas_of(uvs), SIZE, SIZE)).samples(texels, sample_at)
    assert samples.weights.min() >= 0
    np.testing.assert_allclose(samples.weights.sum(axis=1), 1, rtol=1e-6)
    has = samples.faces >= 0
    places = uvs * (SIZE, -SIZE) + (0, SIZE)
    corner = np.column_stack(np.divmod(np.arange(SIZE * SIZE), SIZE)[::-1])
    inside = np.any([lies_inside(place, corner + sample_at) for place in places], axis=0)
    assert inside.sum() > 30
    assert has[inside].all()
    found = np.einsum("kc,kcx->kx", samples.weights, places[samples.faces])
    # Where the sample itself is inside its face it is moved only to get off the borders, which all edges are here.
    moved = np.linalg.norm(found - corner - sample_at, axis=1)
    deep = np.zeros(len(corner), bool)
    for face, place in enumerate(places):
        deep |= (samples.faces == face) & lies_inside(place, corner + sample_at, 0.25)
    assert deep.sum() > 20
    assert (moved[deep] < 1e-3).all()
    assert (moved[inside] < 0.41).all()
    # Border samples may leave the square by 0.4 texels on their way into the face, twice that at its corners.
    assert (found >= corner - 0.81)[has].all()
    assert (found <= corner + 1.81)[has].all()


def test_a_chart_thinner_than_a_texel_has_texels(rasterizer):
    uvs = np.array([[(0.1, 0.51), (0.9, 0.51), (0.9, 0.511)]])
    made = scene(np.eye(3), [[0, 1, 2]], uvs)
    texels = rasterizer(build_layout(made, atlas_of(uvs), SIZE, SIZE)).coverage()
    assert len(texels) >= 0.8 * SIZE


def test_inner_edges_belong_to_one_side_and_overlap_is_measured(rasterizer):
    uvs = quad_uvs((0.1, 0.1), (0.9, 0.9), cells=5)
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=5), uvs)
    assert rasterizer(build_layout(made, atlas_of(uvs), SIZE, SIZE)).overlap() == 0
    folded = uvs.copy()
    folded[..., 0] = np.where(folded[..., 0] > 0.5, 1 - folded[..., 0], folded[..., 0])
    assert rasterizer(build_layout(made, atlas_of(folded), SIZE, SIZE)).overlap() > 0.9


def test_uvs_beyond_the_unit_square_wrap_round(rasterizer):
    uvs = quad_uvs((0.25, 0.25), (0.75, 0.75)) + (0.5, 3.0)
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), uvs)
    texels = rasterizer(build_layout(made, atlas_of(uvs, repeats=True), SIZE, SIZE)).coverage()
    covered = np.zeros((SIZE, SIZE), bool)
    covered.ravel()[texels.index] = True
    columns = np.flatnonzero(covered.any(axis=0))
    assert columns.tolist() == [*range(SIZE // 4), *range(SIZE * 3 // 4, SIZE)]
    assert covered.sum() == SIZE * SIZE // 4


def test_row_0_is_v_1(rasterizer):
    uvs = np.array([[(0.0, 1.0), (0.0, 0.9), (0.1, 1.0)]])
    made = scene(np.eye(3), [[0, 1, 2]], uvs)
    texels = rasterizer(build_layout(made, atlas_of(uvs), SIZE, SIZE)).coverage()
    assert 0 in texels.index
    assert texels.index.max() < SIZE * 4
