"""Medial balls: half a slab's thickness, a cylinder's radius, the ball itself; none holds a sample."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import shapes
from aoprecalc.spheres.sampling import NormalizedFrame, sample_points_with_normals
from aoprecalc.spheres.shadow import medial_balls

ARRIVED = 1e-3  # of the radius: balls that shrink by less stop


def units(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("radius", [1.0, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_inside_a_ball_each_is_the_ball(seed, radius):
    normals = units(300, seed)
    centers, radii = medial_balls(radius * normals, normals, radius * units(4000, seed + 10), max_radius=3.0)
    np.testing.assert_allclose(radii, radius, rtol=1e-3)
    assert np.abs(centers).max() < 1e-3 * radius


@pytest.mark.parametrize("thickness", [0.5, 0.1, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_in_a_slab_they_have_half_its_thickness(seed, thickness):
    """A sample on the other side no farther than e beside the point lets a ball grow by e^2 / (2 thickness)."""
    steps = np.linspace(-1, 1, 201)
    sheet = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    samples = np.concatenate([np.insert(sheet, 2, side * thickness / 2, axis=1) for side in (-1, 1)])
    random = np.random.default_rng(seed)
    side = random.choice([-1.0, 1.0], 300)
    points = np.column_stack([random.uniform(-0.4, 0.4, (300, 2)), side * thickness / 2])
    normals = np.column_stack([np.zeros((300, 2)), side])
    centers, radii = medial_balls(points, normals, samples, max_radius=0.5)
    aside = 0.005 * 2**0.5
    assert (radii > thickness / 2 * (1 - 1e-9)).all()
    assert (radii < (thickness / 2 + aside**2 / (2 * thickness)) * (1 + 2 * ARRIVED)).all()
    np.testing.assert_allclose(points - centers, normals * radii[:, None], rtol=0, atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_in_a_cylinder_they_have_its_radius(seed):
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(-2, 2, 201))
    samples = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), height], axis=-1).reshape(-1, 3)
    random = np.random.default_rng(seed)
    angle = random.uniform(0, 2 * np.pi, 300)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(300)])
    points = 0.5 * normals + np.outer(random.uniform(-0.5, 0.5, 300), [0, 0, 1])
    centers, radii = medial_balls(points, normals, samples, max_radius=3.0)
    np.testing.assert_allclose(radii, 0.5, rtol=2e-3)
    np.testing.assert_allclose(centers[:, :2], 0, rtol=0, atol=1e-3)


@pytest.mark.parametrize("side", [1, -1], ids=["inside", "outside"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["torus", "clutter", "bowl"])
def test_none_holds_a_sample_deeper_than_the_tolerance(name, seed, side):
    shape = {"torus": shapes.torus(), "clutter": shapes.clutter(seed), "bowl": shapes.bowl()}[name]
    scene = shapes.scene(*shape)
    frame, random = NormalizedFrame.from_positions(scene.positions), np.random.default_rng(seed)
    samples, _ = sample_points_with_normals(scene, frame, 5000, random)
    points, normals = sample_points_with_normals(scene, frame, 500, random)
    centers, radii = medial_balls(points, side * normals, samples, max_radius=1.0)
    assert (radii > 0).all()
    assert (radii <= 1).all()
    assert (radii < 0.9).any() or (name, side) == ("torus", -1)
    assert (cKDTree(samples).query(centers)[0] >= radii * (1 - ARRIVED) - 1e-12).all()


def test_a_ball_that_meets_nothing_keeps_its_size():
    points, normals = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 1]])
    centers, radii = medial_balls(points, normals, np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, -9]]), max_radius=2.0)
    assert radii.tolist() == [2]
    assert centers.tolist() == [[0, 0, -2]]
