"""Spheres for collisions hold the whole surface, and the inside of a closed mesh, and protrude little."""

import numpy as np
import pytest

import shapes
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.spheres.containment import containing_radii, subdivide
from aoprecalc.spheres.sampling import VoxelGrid, inside_mesh, signed_distances

FLAT = shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 2)

slow = pytest.mark.slow


def fitted(scene, count, method="collision", radius="mean", seed=0):
    options = SphereOptions(spheres=count, samples=3000, method=method, radius=radius, seed=seed)
    return fit_sphere_set(scene, options, Progress())


def beyond(points, spheres):
    """By how much of the box's longest side, for a box of side 2, the farthest point is outside; negative inside."""
    return signed_distances(points, spheres.centers, spheres.radii).max() / 2


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (shapes.ball(3), 1),
        pytest.param(shapes.ball(3), 5, marks=slow),
        pytest.param(shapes.torus(0.7, 0.3), 12, marks=slow),
        (shapes.cap(), 6),
        pytest.param(shapes.box(), 3, marks=slow),
        pytest.param(shapes.clutter(2, boxes=2), 10, marks=slow),
        pytest.param(FLAT, 4, marks=slow),
        pytest.param(shapes.box((-1, -1e-4, -1e-4), (1, 1e-4, 1e-4)), 4, marks=slow),
    ],
    ids=["ball 1", "ball", "torus", "open bowl", "box", "clutter", "plate", "needle"],
)
def test_every_point_is_held(shape, count, surface_points):
    """Of the surface, the corners among it, and of the inside of the closed ones."""
    scene = shapes.scene(*shape)
    found, quality = fitted(scene, count)
    assert len(found) == count
    assert (found.radii > 0).all()
    assert beyond(surface_points(scene, 50_000, 1), found) < 1e-9
    assert beyond(scene.positions, found) < 1e-9
    assert (quality["coverage"], quality["leak"] < 2e-3) == (1, True)


@slow
@pytest.mark.parametrize("name", ["ball", "torus", "capsule"])
def test_a_closed_mesh_is_held_and_spheres_protrude_far_less_than_clusters_do(name, capsule, surface_points):
    scene = {"ball": shapes.scene(*shapes.ball(3)), "torus": shapes.scene(*shapes.torus()), "capsule": capsule}[name]
    count, most = {"ball": (3, 0.012), "torus": (20, 0.09), "capsule": (8, 0.05)}[name]
    found, quality = fitted(scene, count)
    low, high = scene.positions.min(axis=0), scene.positions.max(axis=0)
    grid = VoxelGrid.from_box(low, high, 48)  # the points that are held by design, and
    inside = grid.centers(inside_mesh(scene.positions, scene.faces, grid))
    assert len(inside) > 5000
    assert beyond(inside, found) < 1e-9
    assert quality["inside_volume"] > 0.9999  # those of another grid
    lloyds = fitted(scene, count, "lloyd", "cover")[1]
    assert quality["spill"] <= min(most, 0.12 * lloyds["spill"])
    assert quality["outside_volume"] <= 0.12 * lloyds["outside_volume"]
    assert beyond(surface_points(scene, 50_000, 2), found) < 1e-9


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [1, 5, 40, 200])
def test_whatever_spheres_there_are_they_grow_until_they_hold_all(count, seed):
    """Of a box, by spheres anywhere, and by many on its faces, which hold those and leave the middle out."""
    random = np.random.default_rng(seed)
    positions, faces = shapes.box()
    small = subdivide(positions[faces], 0.2)
    inside = random.uniform(-1, 1, (2000, 3))
    centers, radii = random.uniform(-1, 1, (count, 3)), random.uniform(0.01, 0.3, count)
    if count == 200:
        centers[: count - 1] /= np.abs(centers[: count - 1]).max(axis=1, keepdims=True)
    surface_only = containing_radii(small, inside[:0], centers, radii, 0.02)
    assert (surface_only >= radii).all()
    anywhere = (random.dirichlet(np.ones(3), (len(small), 5)) @ small).reshape(-1, 3)
    assert signed_distances(anywhere, centers, surface_only).max() < 1e-11
    assert count < 200 or signed_distances(inside, centers, surface_only).max() > 0.1
    contained = containing_radii(small, inside, centers, radii, 0.02)
    assert (contained >= surface_only).all()
    assert signed_distances(inside, centers, contained).max() < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, (0.02, 0, 0)), (1e3, (5e3, 0, -1e3))])
def test_held_at_any_size_and_place(scale, offset, surface_points):
    positions, faces = shapes.box((-1, -0.5, -0.2), (1, 0.5, 0.2))
    scene = shapes.scene(positions * scale + offset, faces)
    found, _ = fitted(scene, 4)
    assert beyond(surface_points(scene, 20_000, 3), found) < 1e-9 * scale
    assert beyond(scene.positions, found) < 1e-9 * scale


@pytest.mark.slow
def test_same_seed_same_bytes():
    scene = shapes.scene(*shapes.cap(6))
    first, again = fitted(scene, 2)[0], fitted(scene, 2)[0]
    assert first.centers.tobytes() == again.centers.tobytes()
    assert first.radii.tobytes() == again.radii.tobytes()
    assert (first.method, first.radius_rule) == ("collision", "own")


def test_steps_are_counted_as_progress(listener):
    options = SphereOptions(spheres=1, samples=500, method="collision")
    found, _ = fit_sphere_set(shapes.scene(*shapes.ball(1)), options, listener)
    assert listener.steps == found.iterations > 0
