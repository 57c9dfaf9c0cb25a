"""Silhouettes are what pixel by pixel tests find, and a ball's is a disc from everywhere."""

import numpy as np
import pytest

import shapes
from aoprecalc.spheres.silhouettes import (
    Views,
    disc_spans,
    fibonacci_views,
    mesh_silhouettes,
    span_counts,
    span_sums,
    spheres_per_pixel,
)

SNAPPED = 1 / 128  # pixels: the rasteriser moves corners by half as much at most


def pixel_centers(size):
    """(size, size, 2): column and row of each pixel's centre."""
    return np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1) + 0.5


def depths(triangles, at):
    """(m, k): how far inside each of m triangles, (m, 3, 2), the points (k, 2) lie; negative outside.

    The least of the signed distances from the lines along the edges.
    """
    sides = np.roll(triangles, -1, axis=1) - triangles
    turned = np.sign(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    aside = at[None, None] - triangles[:, :, None]
    across = sides[:, :, None, 0] * aside[..., 1] - sides[:, :, None, 1] * aside[..., 0]
    return (across * turned[:, None, None] / np.linalg.norm(sides, axis=2)[..., None]).min(axis=1)


def in_discs(columns, rows, radii, size):
    """(d, n, size, size): whether the centre of each pixel lies in each disc, from the definition."""
    at = pixel_centers(size)
    away = np.hypot(at[..., 0] - columns[..., None, None], at[..., 1] - rows[..., None, None])
    return away <= radii[:, None, None]


def random_discs(seed, count=40, pictures=3, size=32):
    """Discs of all sizes, many of which leave the picture, some of them wholly, some around all of it."""
    random = np.random.default_rng(seed)
    places = random.uniform(-0.5 * size, 1.5 * size, (2, pictures, count))
    return *places, size * random.choice([0.02, 0.1, 0.4, 2.0], count) * random.uniform(0, 1, count)


@pytest.mark.parametrize("seed", range(6))
def test_pixels_whose_centres_lie_in_a_triangle(seed):
    """Sure of those that lie in one, and of those that lie in none, by more than corners are moved."""
    positions, faces = shapes.clutter(seed)
    views = fibonacci_views(5, [4.0, 1.0][seed % 2], 40, turn=seed / 7)  # all of it, or its middle
    found = mesh_silhouettes(positions, faces, views)
    at = pixel_centers(40).reshape(-1, 2)
    for mask, *places in zip(found, *views.project(positions), strict=True):
        deepest = depths(np.stack(places, axis=-1)[faces], at).max(axis=0).reshape(40, 40)
        sure = np.abs(deepest) > SNAPPED
        assert sure.mean() > 0.95
        assert mask.any()
        np.testing.assert_array_equal(mask[sure], deepest[sure] > 0)


@pytest.mark.parametrize("place", [(0, 0, 0), (0.3, -0.2, 0.1)])
def test_the_disc_of_a_ball_from_everywhere(place):
    positions, faces = shapes.ball(4, radius=0.7)
    views = fibonacci_views(32, 1.2, 200, turn=0.5)
    pixel = (2 * views.half_extent / views.resolution) ** 2
    area = np.pi * 0.7**2
    by_mesh = mesh_silhouettes(positions + place, faces, views)
    by_sphere = spheres_per_pixel(np.array([place], float), np.array([0.7]), views)
    assert by_mesh.sum(axis=(1, 2)) * pixel == pytest.approx(np.full(32, area), rel=0.006)  # its facets lie within
    assert by_sphere.sum(axis=(1, 2)) * pixel == pytest.approx(np.full(32, area), rel=0.003)
    assert (by_mesh & (by_sphere == 0)).sum() < 1e-3 * by_mesh.sum()


@pytest.mark.parametrize("seed", range(6))
def test_spheres_over_each_pixel(seed):
    random = np.random.default_rng(seed)
    centers = random.normal(size=(30, 3))
    radii = random.choice([0.0, 0.01, 0.3, 5.0], 30, p=[0.2, 0.3, 0.45, 0.05]) * random.uniform(0.5, 1, 30)
    views = fibonacci_views(4, 1.0, 32, turn=seed / 7)
    expected = in_discs(*views.project(centers), radii * views.pixels_per_unit, views.resolution).sum(axis=1)
    assert (expected > 0).any()
    np.testing.assert_array_equal(spheres_per_pixel(centers, radii, views), expected)


def test_no_spheres_cover_nothing():
    assert not spheres_per_pixel(np.zeros((0, 3)), np.zeros(0), fibonacci_views(3, 1.0, 16, turn=0.0)).any()


def test_a_disc_without_size_covers_the_pixel_in_whose_centre_it_lies():
    columns, rows = np.array([[2.5, 4.0, 5.5]]), np.array([[3.5, 3.5, 5.0]])
    spans = disc_spans(columns, rows, np.zeros(3), 8)
    assert [spans.disc.tolist(), spans.row.tolist(), spans.start.tolist(), spans.stop.tolist()] == [[0], [3], [2], [3]]


@pytest.mark.parametrize("seed", range(6))
def test_spans_of_discs(seed):
    columns, rows, radii = random_discs(seed)
    spans = disc_spans(columns, rows, radii, 32)
    all_of_them = in_discs(columns, rows, radii, 32)
    assert (spans.start >= 0).all()
    assert (spans.start < spans.stop).all()
    assert (spans.stop <= 32).all()
    for index in range(columns.size):
        view, disc = divmod(index, len(radii))
        mask = np.zeros((3 * 32, 32), bool)
        for span in np.flatnonzero(spans.disc == index):
            mask[spans.row[span], spans.start[span] : spans.stop[span]] = True
        expected = np.zeros((3, 32, 32), bool)
        expected[view] = all_of_them[view, disc]
        np.testing.assert_array_equal(mask.reshape(3, 32, 32), expected)


@pytest.mark.parametrize("seed", range(6))
def test_sums_over_discs(seed):
    columns, rows, radii = random_discs(seed)
    pictures = np.random.default_rng(seed).normal(size=(3, 32, 32)).astype(np.float32)
    spans = disc_spans(columns, rows, radii, 32)
    inside = in_discs(columns, rows, radii, 32)
    expected = (pictures[:, None] * inside).sum(axis=(2, 3), dtype=float)
    np.testing.assert_allclose(span_sums(spans, pictures, columns.size), expected.ravel(), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(span_counts(spans, 3, 32), inside.sum(axis=1))


@pytest.mark.parametrize("seed", range(4))
def test_from_behind_silhouettes_are_mirrored(seed):
    positions, faces = shapes.clutter(seed)
    views = fibonacci_views(6, 4.0, 64, turn=0.1)
    behind = Views(-views.across, views.upward, views.half_extent, views.resolution)
    differs = mesh_silhouettes(positions, faces, behind) != mesh_silhouettes(positions, faces, views)[..., ::-1]
    assert differs.sum() <= 3  # of 24,576 pixels: those whose centre an edge goes through, as far as is told
    radii = np.linspace(0.05, 0.5, len(positions))
    np.testing.assert_array_equal(
        spheres_per_pixel(positions, radii, behind), spheres_per_pixel(positions, radii, views)[..., ::-1]
    )


def test_some_views_show_what_they_show_among_all():
    positions, faces = shapes.clutter(0)
    views = fibonacci_views(7, 3.0, 48, turn=0.2)
    whole = mesh_silhouettes(positions, faces, views)
    which = np.array([5, 0, 3])
    assert (len(views), len(views[2:4]), len(views[which])) == (7, 2, 3)
    np.testing.assert_array_equal(mesh_silhouettes(positions, faces, views[which]), whole[which])
    np.testing.assert_array_equal(mesh_silhouettes(positions, faces, views[2:4]), whole[2:4])


def test_views_look_from_all_around_along_columns_and_rows_at_right_angles():
    views = fibonacci_views(50, 2.0, 10, turn=0.3)
    along = np.cross(views.across, views.upward)
    for sides in (views.across, views.upward, along):
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(along.T @ along / 50, np.eye(3) / 3, atol=0.02)  # as of the whole sphere
    columns, rows = views.project(2 * views.across)
    np.testing.assert_allclose(np.diag(columns), 10)
    np.testing.assert_allclose(np.diag(rows), 5)


def test_turned_views_have_none_in_common():
    first, second = (
        np.cross(views.across, views.upward)
        for views in (fibonacci_views(32, 1, 8, 0.5), fibonacci_views(40, 1, 8, 0.25))
    )
    assert np.abs(first @ second.T).max() < 1 - 1e-4
