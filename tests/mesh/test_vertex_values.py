"""Values at vertices by least squares: what comes back exactly, what stays apart, and never worse than samples."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.vertex_ao import interpolation_error
from aoprecalc.mesh.surface import SurfacePoints, area_vectors, sample_surface, shading_normals
from aoprecalc.mesh.vertex_values import fit_vertex_values, vertex_groups
from shapes import box, clutter, join, quad, scene, scene_of_parts, torus


def areas_of(made):
    return np.linalg.norm(area_vectors(made.corners), axis=1)


def fitted(made, field, mode="smooth", areas=None, **options):
    """The values at the corners, (f, 3), that come nearest to field(positions (k, 3)) -> (k,), and the groups."""
    groups = vertex_groups(made, shading_normals(made, mode))
    areas = areas_of(made) if areas is None else areas
    points = np.full(len(groups), 36.0)
    values = fit_vertex_values(
        made.corners, groups, areas, points, lambda where: field(where.interpolate(made.corners)), **options
    )
    return values[groups], groups


def unevenly(positions, faces, seed=0):
    """A flat shape with its inner positions moved, so that its triangles are of many sizes."""
    moved = positions.copy()
    inner = (np.abs(positions[:, :2] - 0.5) < 0.499).all(axis=1)
    moved[inner, :2] += np.random.default_rng(seed).uniform(-0.08, 0.08, (inner.sum(), 2))
    return scene(moved, faces)


@pytest.mark.parametrize("smoothness", [0, 0.01, 10])
def test_a_linear_field_on_a_flat_square_comes_back_exactly(smoothness):
    made = unevenly(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=5))

    def field(where):
        return 0.2 + 0.5 * where[:, 0] - 0.1 * where[:, 1]

    values, _ = fitted(made, field, smoothness=smoothness)
    assert values.ravel() == pytest.approx(field(made.corners.reshape(-1, 3)), abs=1e-8)


def test_a_constant_comes_back_exactly():
    values, _ = fitted(scene(*clutter(0)), lambda where: np.full(len(where), 0.3))
    assert values == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize(("top", "sides"), [(0.2, 0.9), (0, 1)])
def test_a_step_at_hard_edges_does_not_bleed(top, sides):
    made = scene(*box())
    values, groups = fitted(made, lambda where: np.where(where[:, 2] > 1 - 1e-9, top, sides), "flat")
    on_top = (made.corners[:, :, 2] > 0).all(axis=1)
    assert groups.max() + 1 == 24
    assert values[on_top] == pytest.approx(top, abs=1e-9)
    assert values[~on_top] == pytest.approx(sides, abs=1e-9)


def test_smooth_edges_have_one_value_at_both_faces():
    made = scene(*box())
    values, groups = fitted(made, lambda where: np.where(where[:, 2] > 1 - 1e-9, 0.2, 0.9), "smooth")
    assert groups.max() + 1 == 8
    for position in range(8):
        assert np.ptp(values[made.faces == position]) == 0


def test_levels_of_detail_have_values_of_their_own():
    shape = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    one = scene_of_parts(shape, shape)
    merged = replace(one, faces=one.faces % 4, positions=one.positions[:4])
    levels = (replace(part, levels=range(n, n + 1)) for n, part in enumerate(merged.parts))
    normals = shading_normals(merged)
    assert vertex_groups(merged, normals).max() + 1 == 4
    assert vertex_groups(replace(merged, parts=tuple(levels)), normals).max() + 1 == 8


def test_a_symmetric_shape_has_symmetric_values():
    made = scene(*torus(around=16, across=8))
    values, _ = fitted(made, lambda where: 0.5 + 0.4 * where[:, 2] ** 3 - 0.2 * np.hypot(where[:, 0], where[:, 1]) ** 2)
    at = np.zeros(len(made.positions))
    at[made.faces.ravel()] = values.ravel()
    rings = at.reshape(16, 8)  # around, across: turning the torus changes nothing
    assert rings == pytest.approx(rings[:1].repeat(16, axis=0), abs=1e-8)


@pytest.mark.parametrize("scale", [1e-6, 1e5])
def test_the_scale_of_the_mesh_does_not_matter(scale):
    positions, faces = clutter(1)
    near, far = (
        fitted(scene(positions * factor, faces), lambda where, factor=factor: 0.5 + 0.3 * np.sin(where[:, 0] / factor))
        for factor in (1, scale)
    )
    assert near[0] == pytest.approx(far[0], abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_fitted_values_are_nearer_to_the_field_than_samples_at_the_vertices(seed):
    made, turn = scene(*clutter(seed)), np.random.default_rng(seed).normal(size=(3, 3))

    def field(where):
        return 0.5 + 0.4 * np.sin(where @ turn).prod(axis=1)

    values, _ = fitted(made, field)
    points = sample_surface(made, np.ones(len(made.faces), bool), 20_000, seed)
    expected = field(points.interpolate(made.corners))
    samples = field(made.corners.reshape(-1, 3)).reshape(-1, 3)
    assert interpolation_error(values, points, expected) < interpolation_error(samples, points, expected)


def test_bounds_are_kept_at_less_cost_than_by_clipping():
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=8))

    def field(where):
        return (where[:, 0] > 0.55) * 1.0

    values, _ = fitted(made, field, smoothness=0)
    assert (values.min(), values.max()) == (0, 1)
    points = sample_surface(made, np.ones(len(made.faces), bool), 20_000, 0)
    expected = field(points.interpolate(made.corners))
    wide, _ = fitted(made, lambda where: 0.4 + 0.2 * field(where), smoothness=0)  # nowhere near the bounds
    clipped = ((wide - 0.4) / 0.2).clip(0, 1)
    assert interpolation_error(values, points, expected) < interpolation_error(clipped, points, expected)


def test_faces_without_a_field_get_what_is_around_them():
    """A strip of which the middle is not asked lies between its ends; a far piece gets the mean."""
    strip, away = quad((0, 0, 0), (9, 0, 0), (0, 9, 0), cells=9), quad((99, 0, 0), (1, 0, 0), (0, 1, 0))
    made = scene(*join(strip, away))
    middle = made.corners[:, :, 0].mean(axis=1)
    areas = np.where((middle < 3) | ((middle > 6) & (middle < 90)), areas_of(made), 0)
    asked = []

    def field(where):
        asked.append(where)
        return np.where(where[:, 0] < 4, 0.2, 0.8)

    values, _ = fitted(made, field, areas=areas)
    assert not ((np.concatenate(asked)[:, 0] > 3) & (np.concatenate(asked)[:, 0] < 6)).any()
    x = made.corners[:, :, 0]
    assert values[x <= 3] == pytest.approx(0.2, abs=1e-3)
    assert values[x == 4].mean() == pytest.approx(0.4, abs=0.02)
    assert values[x == 5].mean() == pytest.approx(0.6, abs=0.02)
    assert values[x > 90] == pytest.approx(0.5, abs=1e-6)


def test_the_error_is_that_of_linear_interpolation():
    points = SurfacePoints(np.array([0, 0]), np.array([[1.0, 0, 0], [0, 0.5, 0.5]]))
    assert interpolation_error(np.array([[0.0, 1, 2]]), points, np.array([0.0, 1.0])) == pytest.approx(np.sqrt(0.125))
