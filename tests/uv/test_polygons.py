"""Polygons that stay whole: their triangles lie side by side, unfolded without stretch, and no seam is inside one."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.io.formats.polygons import Polygons, polygon_triangles
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout, doubled_uv_areas
from aoprecalc.uv.charts import make_charts
from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.polygons import join_polygons
from aoprecalc.uv.unwrap import unwrap
from shapes import rotation, scene


def lengths(corners):
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def cut(uvs, polygons, made):
    """How many polygons have a vertex with more than one UV."""
    corners = {}
    for triangle, owner, flat in zip(made, polygons, uvs, strict=True):
        for vertex, uv in zip(triangle.tolist(), flat.tolist(), strict=True):
            corners.setdefault((owner, vertex), set()).add(tuple(np.round(uv, 9)))
    return len({owner for (owner, _), found in corners.items() if len(found) > 1})


def knot(around=40, across=12):
    """A twisted tube of quads that are not planar: positions, triangles and the quad of each."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    angle, turn = 2 * np.pi * u / around, 2 * np.pi * v / across + 4 * np.pi * u / around
    radius = 1 + 0.3 * np.cos(turn) + 0.1 * np.sin(3 * turn)
    points = np.stack([radius * np.cos(angle), 0.3 * np.sin(turn), radius * np.sin(angle)], axis=2).reshape(-1, 3)

    def at(x, y):
        return (x % around) * across + y % across

    quads = np.stack([at(u, v), at(u, v + 1), at(u + 1, v + 1), at(u + 1, v)], axis=2).reshape(-1)
    counts = np.full(len(quads) // 4, 4)
    triangles, owners = polygon_triangles(counts, quads, points)
    return points, quads[triangles].astype(np.int32), owners.astype(np.int32), Polygons(counts, triangles, owners)


@pytest.mark.parametrize("sides", [4, 5, 9])
@pytest.mark.parametrize("mirrored", [1, -1])
def test_a_planar_polygon_is_flattened_as_it_is(sides, mirrored):
    """Its triangles lie anywhere; what comes out is the polygon, in the scale and the place of the largest."""
    angle = 2 * np.pi * np.arange(sides) / sides
    flat = np.stack([np.cos(angle) * (1 + 0.3 * (np.arange(sides) % 2)), np.sin(angle)], axis=1)
    points = np.column_stack([flat, np.zeros(sides)]) @ rotation(3).T
    triangles = np.array([[0, n, n + 1] for n in range(1, sides - 1)], np.int32)
    shown = 2 * flat * (mirrored, 1)
    generator = np.random.default_rng(sides)
    uvs = shown[triangles] + generator.uniform(-9, 9, (len(triangles), 1, 2))
    uvs, chart = join_polygons(
        uvs, np.arange(len(triangles), dtype=np.int32), points, triangles, np.zeros(len(triangles), np.int32)
    )
    assert len(set(chart.tolist())) == 1
    assert cut(uvs, np.zeros(len(triangles), int), triangles) == 0
    moved = uvs - shown[triangles]
    assert moved == pytest.approx(np.broadcast_to(moved[0, 0], moved.shape), abs=1e-9)


def test_what_is_whole_keeps_its_place():
    points, triangles, owners, _ = knot(8, 6)
    generator = np.random.default_rng(1)
    uvs = generator.uniform(size=(len(points), 2))[triangles]
    chart = np.zeros(len(triangles), np.int32)
    for found, given in zip(join_polygons(uvs, chart, points, triangles, owners), (uvs, chart), strict=True):
        assert found is given


@pytest.mark.parametrize("fineness", ["coarse", "planar", "patches", "faces"])
def test_no_chart_ends_inside_a_polygon(fineness):
    points, triangles, owners, _ = knot()
    charts = make_charts("xatlas", points / 3, triangles, fineness, owners)
    assert cut(charts.uvs, owners, triangles) == 0
    assert charts.placed.all()
    if fineness == "faces":
        assert charts.count == len(owners) / 2
        assert lengths(np.pad(charts.uvs, ((0, 0), (0, 0), (0, 1)))) == pytest.approx(lengths(points[triangles] / 3))


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
def test_new_uvs_leave_polygons_whole_and_lie_over_nothing(method):
    points, triangles, owners, polygons = knot()
    made = scene(points, triangles)
    free = unwrap(made, method, PageSpec(256, 4))
    assert len(polygons.merge_triangles([free.uvs], free.mapped).counts) > len(polygons.counts)
    whole = replace(made, polygons=owners)
    atlas = unwrap(whole, method, PageSpec(512, 4))
    assert np.array_equal(polygons.merge_triangles([atlas.uvs], atlas.mapped).counts, polygons.counts)
    assert CPURasterizer(build_layout(whole, atlas, 512, 512)).overlap() == 0
    assert (doubled_uv_areas(atlas.uvs) > 0).all()
