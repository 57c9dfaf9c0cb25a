"""Near/far maps against a slow reference: rays against every triangle, for the same points and axes."""

import numpy as np
import pytest

from aoprecalc.model import Atlas
from aoprecalc.occlusion.axes import axes
from aoprecalc.occlusion.projection import extreme_points, project
from aoprecalc.occlusion.visibility import centred, visibility_sums
from aoprecalc.progress import Progress
from aoprecalc.surface.normals import geometric_normals, shading_normals
from aoprecalc.texspace.layout import lay_out
from aoprecalc.texspace.raster import Raster
from shapes import box, join, scene, torus

SIZE = 40
AXES = axes(64)  # less than a group: one receiver a texel, at its centre


def clutter(seed, boxes=5):
    """Boxes of random shape, place and rotation, and a ring, some of them through each other."""
    rng = np.random.default_rng(seed)
    parts = [torus(1.5, 0.3, around=16, across=8)]
    for _ in range(boxes):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        positions, faces = box()
        parts.append((positions * rng.uniform(0.2, 0.7, 3) @ turn + rng.normal(size=3), faces))
    return join(*parts)


def one_triangle_a_cell(count):
    """An atlas that gives every face a triangle of its own."""
    cells = int(np.ceil(np.sqrt(count)))
    place = np.column_stack(np.divmod(np.arange(count), cells))[:, None]
    return Atlas("keep", (place + np.array([(0.1, 0.1), (0.9, 0.1), (0.1, 0.9)])) / cells, np.ones(count, bool), count)


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


@pytest.mark.parametrize("seed", range(3))
def test_maps_agree_with_rays(renderer, seed):
    positions, faces = clutter(seed)
    made = scene(positions, faces)
    shading = shading_normals(made, "smooth", 40)
    raster = Raster(renderer.context, lay_out(made, one_triangle_a_cell(len(faces)), SIZE, SIZE))
    texels, bands = raster.coverage()
    fast = visibility_sums(renderer, made, shading, raster, texels, bands, AXES, 2048, Progress())

    found = np.frombuffer(raster.draw(0, (0.5, 0.5)).read(), np.float32).reshape(-1, 4)[texels.index]
    face = found[:, 0].astype(int) - 1
    weights = np.column_stack([1 - found[:, 1:3].sum(axis=1), found[:, 1:3]])
    corners = centred(positions)[faces]
    points = np.einsum("kc,kcx->kx", weights, corners[face])
    geometric = geometric_normals(made, shading)[face].astype(float)
    normals = np.einsum("kc,kcx->kx", weights, shading[face].astype(float))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where((normals * geometric).sum(axis=1, keepdims=True) <= 0, geometric, normals)
    slow = slow_sums(points, normals, geometric, corners, np.concatenate([AXES, -AXES]))

    assert fast[:, 1] == pytest.approx(slow[:, 1], rel=2e-3)
    difference = np.abs(fast[:, 0] / fast[:, 1] - slow[:, 0] / slow[:, 1])
    # What differs is within a map texel of a silhouette or a crease.
    assert difference.mean() < 0.01
    assert np.quantile(difference, 0.9) < 0.03


@pytest.mark.parametrize("shape", ["solid", "flat", "line"])
def test_projections_hold_every_point_with_a_margin(shape):
    points = (
        np.random.default_rng(7).normal(size=(200, 3))
        * {"solid": (1, 2, 3), "flat": (1, 1, 0), "line": (1, 0, 0)}[shape]
    )
    projections = project(axes(100), extreme_points(points), 256)
    seen = np.einsum("arx,px->arp", projections.rows, np.column_stack([points, np.ones(len(points))]))
    assert seen[:, :2].min() >= 0.999
    assert seen[:, :2].max() <= 255.001
    assert seen[:, 2] == pytest.approx(axes(100) @ points.T)
    # Rows are lengths over pitch: one map texel aside is one pitch.
    lengths = np.linalg.norm(projections.rows[:, :2, :3], axis=2)
    assert lengths * projections.pitch == pytest.approx(1)
