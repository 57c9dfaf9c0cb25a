"""Points are uniform by area, and more evenly so than independent ones."""

import numpy as np

from aoprecalc.mesh.surface import sample_surface
from shapes import join, quad, scene, torus


def test_faces_get_points_by_their_area_to_within_one():
    made = scene(*join(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 9), (3, 0, 0), (0, 3, 0))))
    counts = np.bincount(sample_surface(made, np.ones(4, bool), 1000, 0).faces, minlength=4)
    assert np.abs(counts - [50, 50, 450, 450]).max() <= 1


def test_only_covered_faces_with_area_get_points():
    positions, faces = join(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), ([[0, 0, 5], [1, 0, 5], [2, 0, 5]], [[0, 1, 2]]))
    made = scene(positions, faces)
    assert set(sample_surface(made, np.array([True, True, True]), 500, 0).faces) == {0, 1}
    assert set(sample_surface(made, np.array([False, True, True]), 500, 0).faces) == {1}


def test_points_are_uniform_within_a_face():
    made = scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    points = sample_surface(made, np.ones(1, bool), 30_000, 3)
    assert (points.weights >= 0).all()
    assert np.allclose(points.weights.sum(axis=1), 1)
    assert np.abs(points.weights.mean(axis=0) - 1 / 3).max() < 0.006
    x, y, _ = points.interpolate(made.corners).T
    quarters = [x + y < 0.5, x > 0.5, y > 0.5]
    assert np.abs(np.mean(quarters, axis=1) - 0.25).max() < 0.01


def test_the_seed_decides():
    made = scene(*torus())
    mapped = np.ones(len(made.faces), bool)
    first, same, other = (sample_surface(made, mapped, 100, seed) for seed in (1, 1, 2))
    assert (first.weights == same.weights).all()
    assert (first.weights != other.weights).any()


def test_size_and_place_do_not_matter():
    positions, faces = torus()
    mapped = np.ones(len(faces), bool)
    near = sample_surface(scene(positions, faces), mapped, 100, 0)
    for scale in (2.0**-60, 2.0**80):
        assert (sample_surface(scene(positions * scale, faces), mapped, 100, 0).faces == near.faces).all()
