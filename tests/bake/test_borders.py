"""Where charts end: what a look-up on the surface finds there, and what never mixes."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import KDTree

from aoprecalc.api import bake_scene as baking
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.mesh.topology import boundary_edges
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import corner_ids
from aoprecalc.texture_lookup import bilinear
from shapes import bowl, box, join, quad, quad_uvs, scene, torus, triangle_a_cell

slow = pytest.mark.slow
SIZE = 64


def rms(values):
    return np.sqrt((values**2).mean())


def texels_from_border(made, atlas, uvs, size):
    """How far (k, 2) UVs are from the nearest chart border, in texels."""
    face, corner = np.nonzero(boundary_edges(corner_ids(made.faces, atlas.uvs)))
    start, end = atlas.uvs[face, corner], atlas.uvs[face, (corner + 1) % 3]
    along = np.linspace(0, 1, 33)[:, None, None]
    return KDTree((start + along * (end - start)).reshape(-1, 2)).query(uvs)[0] * size


@pytest.mark.parametrize("shape", ["torus", pytest.param("bowl", marks=slow)])
def test_look_ups_beside_a_border_are_hardly_worse_than_inside(shape):
    made = scene(*torus()) if shape == "torus" else scene(*join(bowl(), box((-0.3, -0.25, -0.75), (0.25, 0.3, -0.2))))
    baked = bake_scene(made, BakeOptions(size=128))
    points = sample_surface(made, baked.atlas.mapped, 4000, seed=1)
    uvs = points.interpolate(baked.atlas.uvs)
    truth = reference_ao(made, baked.normals, points, VerifyOptions(rays=1024), Progress())
    errors = bilinear(baked.texture.values, uvs, repeats=False) - truth
    beside = texels_from_border(made, baked.atlas, uvs, 128) < 1
    assert beside.sum() > 500
    assert rms(errors[beside]) < 1.5 * rms(errors[~beside])
    assert rms(errors) < 0.006


def open_and_closed(shift):
    """A floor in the open, and one within a closed box, in charts 2 texels apart, `shift` off the texels' sides."""
    floors = [quad((-1, -1, height), (2, 0, 0), (0, 2, 0)) for height in (0, -3)]
    charts = [quad_uvs((left / SIZE, 0.1), ((left + 16) / SIZE, 0.66)) for left in (4 + shift, 22 + shift)]
    around = triangle_a_cell(12) * (0.3, 0.9) + (0.68, 0.05)
    return scene(*join(*floors, box((-2, -2, -4), (2, 2, -2))), np.concatenate([*charts, around]))


@pytest.mark.parametrize("shift", [0, 0.5, *(pytest.param(shift, marks=slow) for shift in (0.05, 0.3, 0.8))])
def test_charts_two_texels_apart_keep_their_own_values(shift):
    made = open_and_closed(shift)
    options = BakeOptions(size=SIZE, directions=1000, normals="flat", unwrap="keep", backend="ray")
    texture = bake_scene(made, options).texture
    points = sample_surface(made, np.arange(len(made.faces)) < 4, 10_000, seed=0)
    found = bilinear(texture.values, points.interpolate(made.uvs), repeats=False)
    assert np.abs(found - (points.faces < 2)).max() < 0.02


def test_padding_copies_the_nearest_chart_and_never_mixes(monkeypatch):
    paintings, pad_and_fill = [], baking.pad_and_fill

    def spy(painting, *given, **named):
        paintings.append(painting)
        return pad_and_fill(painting, *given, **named)

    monkeypatch.setattr(baking, "pad_and_fill", spy)
    options = BakeOptions(size=SIZE, directions=128, normals="flat", unwrap="keep", padding=6)
    texture = bake_scene(open_and_closed(0.5), options).texture
    known, values = paintings[0].known, paintings[0].values
    away = ndimage.distance_transform_edt(~known)
    places = np.argwhere(known)
    tree = KDTree(places)
    padded = np.argwhere((away > 0) & (away <= 6))
    assert len(padded) > 300
    for row, column in padded:
        nearest = places[tree.query_ball_point((row, column), away[row, column] + 1e-6)]
        assert texture.values[row, column] in values[tuple(nearest.T)]


@pytest.mark.parametrize("offset", [pytest.param(0.1, marks=slow), pytest.param(0.5, marks=slow), 0.85])
@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_chart_thinner_than_a_texel_has_its_own_value(backend, offset):
    """The floor of a slot twice as deep as wide, and one in the open, in charts 40 texels high and a third wide."""
    floors = [quad((x, -20, 0), (1, 0, 0), (0, 40, 0)) for x in (0, 20)]
    walls = [box((-1, -20, -1), (0, 20, 2)), box((1, -20, -1), (2, 20, 2))]
    lefts = (10 + offset) / SIZE, (20 + offset) / SIZE
    charts = [quad_uvs((left, 4 / SIZE), (left + 1 / 3 / SIZE, 44 / SIZE)) for left in lefts]
    around = triangle_a_cell(24) * (0.5, 0.9) + (0.45, 0.05)
    made = scene(*join(*floors, *walls), np.concatenate([*charts, around]))
    options = BakeOptions(size=SIZE, normals="flat", unwrap="keep", backend=backend)
    texture = bake_scene(made, options).texture
    points = sample_surface(made, np.arange(len(made.faces)) < 4, 2000, seed=0)
    places = points.interpolate(made.corners)
    middle = np.abs(places[:, 1]) < 15
    left, right = places[:, 0], 1 - places[:, 0]
    slot = (left / np.hypot(left, 2) + right / np.hypot(right, 2)) / 2
    expected = np.where(points.faces < 2, slot, 1)
    found = bilinear(texture.values, points.interpolate(made.uvs), repeats=False)
    assert np.abs(found - expected)[middle].max() < 0.04
