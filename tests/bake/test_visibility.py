"""Both testers against a slow reference: rays against every triangle, for the same points and axes."""

import numpy as np
import pytest

from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, build_layout
from aoprecalc.types import Atlas
from aoprecalc.visibility import directions
from aoprecalc.visibility.directions import convex_hull_points, fit_projections, light_axes
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.ray_testers import RayTester
from shapes import clutter, scene, triangle_a_cell

SIZE = 40
AXES = light_axes(64)


def slow_sums(points, normals, geometric, corners, directions):
    """Cast a ray from every point along every direction; corners (f, 3, 3)."""
    a, b, c = corners.transpose(1, 0, 2)
    start = points + 1e-6 * geometric
    sums = np.zeros((len(points), 2))
    for w in directions:
        p = np.cross(w, c - a)
        det = np.einsum("fx,fx->f", b - a, p)
        inverse = np.divide(1, det, out=np.zeros_like(det), where=np.abs(det) > 1e-12)
        t = start[:, None] - a
        u = np.einsum("kfx,fx->kf", t, p) * inverse
        q = np.cross(t, b - a)
        v = (q @ w) * inverse
        away = np.einsum("kfx,fx->kf", q, c - a) * inverse
        hit = ((inverse != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (away > 0)).any(axis=1)
        weight = np.maximum(0, normals @ w) * (geometric @ w > 0)
        sums += np.column_stack([weight * ~hit, weight])
    return sums


def still(seed):
    """A scene on its unit surface, and one sample for each of its texels."""
    positions, faces = clutter(seed)
    made = scene(positions, faces)
    atlas = Atlas("keep", triangle_a_cell(len(faces)), np.ones(len(faces), bool), len(faces))
    sampler = CPURasterizer(build_layout(made, atlas, SIZE, SIZE))
    return NormalizedSurface.from_scene(made, shading_normals(made, "smooth", 40)), sampler.samples(
        sampler.coverage(), CENTER
    )


def expected(surface, samples):
    corners = surface.positions[surface.faces].astype(float)
    points = np.einsum("kc,kcx->kx", samples.weights, corners[samples.faces])
    geometric = surface.geometric_normals[samples.faces].astype(float)
    normals = np.einsum("kc,kcx->kx", samples.weights, surface.shading_normals[samples.faces].astype(float))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where((normals * geometric).sum(axis=1, keepdims=True) <= 0, geometric, normals)
    return slow_sums(points, normals, geometric, corners, np.concatenate([AXES, -AXES]))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_maps_and_rays_agree_with_slow_rays(renderer, seed):
    surface, samples = still(seed)
    from aoprecalc.visibility.depth_maps import DepthMapTester  # needs moderngl, which is installed on Linux only

    slow = expected(surface, samples)
    # What differs by maps is within a map texel of a silhouette or a crease; by rays, where they graze an edge.
    for tester, mean, for_90, for_99 in (
        (DepthMapTester(renderer, surface, Integrand(), len(samples.faces), 2048), 1e-3, 1e-4, 0.02),
        (RayTester(surface, Integrand()), 1e-4, 2e-7, 2e-7),
    ):
        fast = tester.accumulate(samples, AXES, Progress())
        assert fast[:, 1] == pytest.approx(slow[:, 1], rel=3e-5)
        difference = np.abs(fast[:, 0] / fast[:, 1] - slow[:, 0] / slow[:, 1])
        assert difference.mean() < mean
        assert (np.quantile(difference, [0.9, 0.99]) < [for_90, for_99]).all()


@pytest.mark.parametrize("shape", ["solid", "flat", "line"])
def test_projections_hold_every_point_with_a_margin(shape):
    points = (
        np.random.default_rng(7).normal(size=(200, 3))
        * {"solid": (1, 2, 3), "flat": (1, 1, 0), "line": (1, 0, 0)}[shape]
    )
    projections = fit_projections(light_axes(100), convex_hull_points(points), 256)
    seen = np.einsum("arx,px->arp", projections.rows, np.column_stack([points, np.ones(len(points))]))
    assert seen[:, :2].min() >= 0.999
    assert seen[:, :2].max() <= 255.001
    assert seen[:, 2] == pytest.approx(light_axes(100) @ points.T)
    # Rows are lengths over pitch: one map texel aside is one pitch.
    lengths = np.linalg.norm(projections.rows[:, :2, :3], axis=2)
    assert lengths * projections.pitch == pytest.approx(1)


def test_points_in_parts_give_the_same_bits_seed_8(monkeypatch):
    points, axes = np.random.default_rng(8).normal(size=(1001, 3)), light_axes(20)
    whole = fit_projections(axes, points, 256)
    monkeypatch.setattr(directions, "_PROJECTED", 2000)  # parts of about 100 points
    in_parts = fit_projections(axes, points, 256)
    assert np.array_equal(in_parts.rows, whole.rows)
    assert np.array_equal(in_parts.pitch, whole.pitch)
