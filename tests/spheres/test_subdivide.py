"""Pieces cover the triangles they are of, and are small."""

import numpy as np
import pytest

import shapes
from aoprecalc.spheres.containment import subdivide


def areas(corners):
    a, b, c = corners.transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def longest(corners):
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()


@pytest.mark.parametrize("length", [0.1, 0.5, 5.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_same_surface_in_short_pieces(seed, length):
    positions, faces = shapes.clutter(seed)
    corners = positions[faces]
    small = subdivide(corners, length)
    assert longest(small) <= length
    assert areas(small).sum() == pytest.approx(areas(corners).sum(), rel=1e-9)
    covered = {tuple(corner) for corner in small.reshape(-1, 3)}
    assert {tuple(corner) for corner in corners.reshape(-1, 3)} <= covered


@pytest.mark.parametrize("seed", range(3))
def test_each_point_of_a_triangle_is_in_a_piece_and_only_in_one(seed):
    random = np.random.default_rng(seed)
    triangle = random.normal(size=(1, 3, 3))
    small = subdivide(triangle, 0.3)
    assert len(small) > 1
    points = random.dirichlet(np.ones(3), 200) @ triangle[0]
    origin, along, across = small[:, 0], small[:, 1] - small[:, 0], small[:, 2] - small[:, 0]
    solved = np.linalg.pinv(np.stack([along, across], axis=2)) @ (points[:, None] - origin)[..., None]
    weights = np.concatenate([solved[..., 0], 1 - solved.sum(axis=2)], axis=2)
    assert ((weights > -1e-9).all(axis=2).sum(axis=1) == 1).all()


def test_short_triangles_stay():
    corners = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3, 3))
    np.testing.assert_array_equal(subdivide(corners, 1.0), corners)


def test_a_triangle_without_area_is_cut_too():
    small = subdivide(np.array([[[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0]]]), 0.2)
    assert longest(small) <= 0.2
    assert (small.min(), small.max()) == (0, 1)
