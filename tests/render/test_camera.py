"""The camera: what it frames is in the picture, and its three ways to place a point agree."""

import numpy as np
import pytest

from aoprecalc.render.camera import PictureFrame, frame_views, view_axes
from shapes import rotation

ANGLES = [(0, 0), (24, 20), (137, -35), (-80, 89), (10, 90), (200, -90)]


def cloud(seed, flat=1.0, thin=1.0):
    """Random points of random extents within the unit sphere."""
    points = np.random.default_rng(seed).normal(size=(200, 3)) * (1, flat, thin) @ rotation(seed)
    return points / np.linalg.norm(points, axis=1).max()


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("size", [(1200, 900), (300, 1000), (4000, 16)])
@pytest.mark.parametrize(("seed", "flat", "thin"), [(1, 1, 1), (2, 0, 1), (3, 0, 0), (4, 1e-3, 1)])
def test_all_points_are_within_their_share_of_the_picture(angles, size, seed, flat, thin):
    points = cloud(seed, flat, thin)
    near, far = points[:100], 1.5 * points[100:]
    camera = frame_views([(view_axes(*angles), [(near, 0.6), (far, 0.95)])], *size)[0]
    for some, share in ((near, 0.6), (far, 0.95)):
        column, row, depth = camera.project(some).T
        assert depth.min() > 0.29
        assert np.abs(2 * column / size[0] - 1).max() <= share + 1e-9
        assert np.abs(2 * row / size[1] - 1).max() <= share + 1e-9


def test_the_picture_is_filled_in_one_direction():
    camera = frame_views([(view_axes(30, 15), [(cloud(5), 0.8)])], 640, 480)[0]
    column, row, _ = camera.project(cloud(5)).T
    filled = max(np.ptp(column) / 640, np.ptp(row) / 480)
    assert filled == pytest.approx(0.8, abs=1e-6)
    assert (column.max() + column.min()) / 2 == pytest.approx(320, abs=4)
    assert (row.max() + row.min()) / 2 == pytest.approx(240, abs=4)


def test_views_share_distance_and_height():
    points = cloud(6)
    views = [(view_axes(azimuth, 20), [(points, 0.8)]) for azimuth in range(0, 360, 45)]
    cameras = frame_views(views, 400, 300)
    seen = np.array([camera.axes @ camera.eye for camera in cameras])
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-12)
    alone = [frame_views([view], 400, 300)[0].eye for view in views]
    assert np.linalg.norm(cameras[0].eye) >= max(np.linalg.norm(eye) for eye in alone) - 0.2


@pytest.mark.parametrize("angles", ANGLES)
def test_rays_projection_and_clip_space_agree(angles):
    points = cloud(7)
    whole = frame_views([(view_axes(*angles), [(points, 0.8)])], 90, 70)[0]
    np.testing.assert_allclose(whole.axes @ whole.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(whole.axes) == pytest.approx(1)
    for camera in whole.bands(32):
        column, row, depth = camera.project(points).T
        along = camera.rays(column, row)
        np.testing.assert_allclose(camera.eye + depth[:, None] * along, points, atol=1e-5)
        clip = np.column_stack([points, np.ones(len(points))]) @ camera.clip_matrix(points).T
        assert np.abs(clip[:, 2] / clip[:, 3]).max() < 1
        rows, columns = camera.shape
        np.testing.assert_allclose((clip[:, 0] / clip[:, 3] + 1) / 2 * columns, column, atol=1e-9)
        np.testing.assert_allclose((clip[:, 1] / clip[:, 3] + 1) / 2 * rows + camera.rows[0], row, atol=1e-9)
    assert [camera.rows for camera in whole.bands(32)] == [(0, 32), (32, 64), (64, 70)]


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_frame_is_a_rotation_that_lifts_the_upward_axis(up):
    positions = cloud(8) * 30 + (1e6, -5, 3)
    frame = PictureFrame.from_positions(positions, up)
    points = frame.points(positions)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(1)
    np.testing.assert_allclose(points.max(axis=0), -points.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(frame.vectors(np.eye(3)["xyz".index(up)]), (0, 1, 0))
    assert np.linalg.det(frame.rotation) == pytest.approx(1)
    assert frame.radius * np.linalg.norm(points[0] - points[1]) == pytest.approx(
        np.linalg.norm(positions[0] - positions[1])
    )
