"""Points of a grid inside meshes and spheres: volumes by formula, and each point by the solid angle around it."""

import numpy as np
import pytest

import shapes
from aoprecalc.spheres.sampling import VoxelGrid, inside_mesh, spheres_per_voxel


def around(positions, most):
    return VoxelGrid.from_box(positions.min(axis=0), positions.max(axis=0), most)


def volume(positions, faces, most=64):
    grid = around(positions, most)
    return np.count_nonzero(inside_mesh(positions, faces, grid)) * grid.pitch**3


def windings(positions, faces, points):
    """How often a closed mesh winds around points, (k,): the solid angle of its faces (A. Van Oosterom, 1983)."""
    corners = positions[faces][None] - points[:, None, None]
    a, b, c = corners.transpose(2, 0, 1, 3)
    lengths = np.linalg.norm(corners, axis=3)
    below = lengths.prod(axis=2)
    for one, other, third in ((a, b, 2), (b, c, 0), (c, a, 1)):
        below += (one * other).sum(axis=2) * lengths[..., third]
    triple = (a * np.cross(b, c)).sum(axis=2)
    return np.rint(np.arctan2(triple, below).sum(axis=1) / (2 * np.pi)).astype(int)


def turned(shape, seed):
    positions, faces = shape
    return positions @ shapes.rotation(seed).T, faces


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (shapes.box((-1, -0.5, -0.25)), 2 * 1.5 * 1.25),
        (shapes.ball(4), 4 / 3 * np.pi),
        (shapes.torus(1.0, 0.4, 96, 48), 2 * np.pi**2 * 0.4**2),
    ],
    ids=["box", "ball", "torus"],
)
def test_volumes(shape, expected, seed):
    assert volume(*turned(shape, seed)) == pytest.approx(expected, rel=0.01)


def test_a_box_along_the_grid_is_filled_to_the_last_point():
    positions, faces = shapes.box((-1, -1, -1), (1, 0, 2))
    grid = around(positions, 12)
    assert grid.shape == (8, 4, 12)
    assert inside_mesh(positions, faces, grid).all()


@pytest.mark.parametrize("most", [9, 10])
def test_columns_through_poles_and_edges_are_filled(most):
    """Meshes that lie about the axes: with odd numbers of points a column goes through corners, with others edges."""
    cone, drum = shapes.spun([(0, -1), (1, 0), (0, 1)], 8), shapes.spun([(0, -1), (1, -1), (1, 1), (0, 1)], 8)
    for positions, faces in (shapes.ball(2), cone, drum, shapes.torus(1, 0.5, 16, 8)):
        grid = around(positions, most)
        inside = inside_mesh(positions, faces, grid)
        points = grid.centers(np.ones(grid.shape, bool))
        expected = windings(positions, faces, points).reshape(grid.shape)
        nudges = 0.01 * grid.pitch * np.array([[1, 2, 3], [-2, -1, 3], [2, -3, -1], [-1, 1, -3]])
        around_them = [windings(positions, faces, points + nudge).reshape(grid.shape) for nudge in nudges]
        sure = np.logical_and.reduce([found == expected for found in around_them])
        assert sure[expected != 0].any()
        np.testing.assert_array_equal(inside[sure], expected[sure] != 0)


@pytest.mark.parametrize("seed", range(4))
def test_either_winding_will_do(seed):
    positions, faces = shapes.clutter(seed)
    grid = around(positions, 24)
    np.testing.assert_array_equal(inside_mesh(positions, faces[:, ::-1], grid), inside_mesh(positions, faces, grid))


@pytest.mark.parametrize("seed", range(6))
def test_points_that_a_mesh_winds_around(seed):
    """Boxes through each other and a ring; sure of points that lie no closer to the surface than it is moved."""
    positions, faces = shapes.clutter(seed)
    grid = around(positions, 12)
    points = grid.centers(np.ones(grid.shape, bool))
    expected = windings(positions, faces, points)
    nudges = 0.01 * grid.pitch * np.concatenate([np.eye(3), -np.eye(3)])
    sure = np.logical_and.reduce([windings(positions, faces, points + nudge) == expected for nudge in nudges])
    assert sure.mean() > 0.98
    assert 0 < (expected != 0).mean() < 1
    np.testing.assert_array_equal(inside_mesh(positions, faces, grid).ravel()[sure], expected[sure] != 0)


def test_parts_within_each_other():
    outer, inner = shapes.ball(3), shapes.ball(3, radius=0.5)
    cavity = inner[0], inner[1][:, ::-1]
    whole, half = volume(*outer), volume(*inner)
    assert half == pytest.approx(whole / 8, rel=0.02)
    assert volume(*shapes.join(outer, inner)) == whole  # wound around twice
    assert volume(*shapes.join(outer, cavity)) == pytest.approx(whole * 7 / 8, rel=0.005)


def test_parts_through_each_other_count_once():
    """Two unit balls one radius apart: each cap beyond the middle plane has 5/24 pi of volume."""
    first, second = shapes.ball(4), shapes.ball(4)
    both = shapes.join(first, (second[0] + [1, 0, 0], second[1]))
    assert volume(*both) == pytest.approx(8 / 3 * np.pi - 2 * 5 / 24 * np.pi, rel=0.01)


def test_an_open_mesh_holds_nothing_in_columns_that_end_inside():
    positions, faces = shapes.cap()
    assert not inside_mesh(positions, faces, around(positions, 16)).any()


def test_points_are_the_middles_of_cubes():
    grid = VoxelGrid.from_box(np.array([1.0, 2, 3]), np.array([2.0, 4, 3]), 4)
    assert grid.shape == (2, 4, 1)
    inside = np.zeros(grid.shape, bool)
    inside[1, 3, 0] = True
    assert grid.centers(inside).tolist() == [[1.75, 3.75, 3.25]]


@pytest.mark.parametrize("seed", range(6))
def test_spheres_that_hold_each_point(seed):
    random = np.random.default_rng(seed)
    centers = random.uniform(-1.5, 1.5, (25, 3))
    radii = random.choice([0.0, 0.1, 0.5, 4.0], 25, p=[0.1, 0.4, 0.4, 0.1]) * random.uniform(0.5, 1, 25)
    shape = random.permutation([9, 14, 20])
    grid = VoxelGrid(np.full(3, -1.0), 2 / 20, tuple(shape.tolist()))
    points = grid.centers(np.ones(grid.shape, bool))
    expected = (np.linalg.norm(points[:, None] - centers, axis=2) <= radii).sum(axis=1)
    assert expected.max() > 1
    np.testing.assert_array_equal(spheres_per_voxel(centers, radii, grid).ravel(), expected)
