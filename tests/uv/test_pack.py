"""Packing: charts keep their shapes and their gutters, inside a page that they fill."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial import KDTree

from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.uv.chart_images import ChartBorders, chart_masks, in_least_boxes
from aoprecalc.uv.charts import Charts
from aoprecalc.uv.pack import (
    MIN_GUTTER,
    NoRoomError,
    Outlines,
    choose_gutter,
    first_unsafe_mip,
    pack_charts,
)
from aoprecalc.uv.page import Page, reach_of_gutter
from shapes import quad

SIZE = 256


def polygons(count, seed):
    """Charts of star-shaped polygons, cut into fans: round ones, long ones, concave ones, all of them apart."""
    rng = np.random.default_rng(seed)
    uvs, chart = [], []
    for number in range(count):
        corners = rng.integers(3, 12)
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
        points = rng.uniform(0.3, 1, (corners, 1)) * np.stack([np.cos(angles), np.sin(angles)], 1)
        points *= rng.lognormal(0, 0.7) * np.array([1, rng.uniform(0.05, 1)])
        turn = rng.uniform(0, np.pi)
        points = points @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        uvs.append(np.stack([np.zeros_like(points), points, np.roll(points, -1, axis=0)], 1))
        chart.append(np.full(corners, number))
    return Charts(np.concatenate(uvs), np.concatenate(chart).astype(np.int32))


def rectangle(width, height, number=0):
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    return Charts(corners[[[0, 1, 2], [0, 2, 3]]], np.full(2, number, np.int32))


def touches(triangle, row, column):
    """Tell whether a triangle and a cell share area: no side of either lies between them (separating axes)."""
    cell = np.array([(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)], float)
    for shape in (triangle, cell):
        for side in np.roll(shape, -1, axis=0) - shape:
            along = np.array([-side[1], side[0]])
            one, other = triangle @ along, cell @ along
            if one.max() <= other.min() + 1e-9 or other.max() <= one.min() + 1e-9:
                return False
    return True


@pytest.mark.parametrize("seed", range(3))
def test_masks_are_the_cells_that_triangles_touch_by_a_slow_reference(seed):
    triangles = np.random.default_rng(seed).uniform(0, 12, (20, 3, 2))
    triangles -= triangles.min(axis=1, keepdims=True)
    charts = np.arange(20, dtype=np.int32)
    masks = chart_masks(triangles, charts, 0.0, ChartBorders.of(triangles, charts))
    for triangle, mask in zip(triangles, masks, strict=True):
        expected = [[touches(triangle, row, column) for column in range(mask.shape[1])] for row in range(mask.shape[0])]
        assert np.array_equal(mask, expected)
        assert mask.any(axis=0).all()
        assert mask.any(axis=1).all()


def test_a_square_on_the_grid_touches_the_cells_inside_it_alone():
    square = rectangle(8, 8)
    (mask,) = chart_masks(square.uvs, square.chart, 1e-3, ChartBorders.of(square.uvs, square.chart))
    assert mask.shape == (8, 8)


def bulging(uvs):
    return uvs * (1 + 0.1 * np.sin(3 * uvs[..., ::-1]))


def folded(uvs):
    return np.abs(uvs - (1.1, 0.9))


def mirrored(uvs):
    return uvs * (-1, 1)


def torn(uvs):
    """Each third face a little apart, and each seventh a point."""
    uvs = uvs + np.where(np.arange(len(uvs)) % 3 == 0, 1e-3, 0.0)[:, None, None]
    return np.where((np.arange(len(uvs)) % 7 == 0)[:, None, None], uvs[:, :1], uvs)


def with_holes(uvs):
    return uvs[(np.sin(7 * uvs).prod(axis=-1) < 0.4).all(axis=1)]


@pytest.mark.parametrize("change", [bulging, folded, mirrored, torn, with_holes])
@pytest.mark.parametrize("scale", [3.0, 40.0, 200.0])
def test_a_border_and_what_lies_inside_are_all_that_a_chart_covers(change, scale):
    """Two charts of fine triangles, one much larger, give the same images as with all of their faces drawn."""
    positions, faces = quad((0, 0, 0), (2, 0.3, 0), (-0.4, 1, 0), cells=30)
    uvs = change(positions[faces][..., :2] + 0.4)
    uvs = np.concatenate([uvs, 0.3 * uvs[: len(uvs) // 2, :, ::-1]])
    chart = np.repeat(np.array([0, 1], np.int32), [2 * len(uvs) // 3, len(uvs) - 2 * len(uvs) // 3])
    borders = ChartBorders.of(uvs, chart)
    every_face = ChartBorders(np.arange(len(uvs)), np.zeros(0, np.intp))
    flat = in_least_boxes(uvs, chart, borders)
    assert np.array_equal(flat, in_least_boxes(uvs, chart, every_face))
    assert flat.min() == 0.0
    found, expected = (chart_masks(scale * flat, chart, 1e-3, these) for these in (borders, every_face))
    assert len(found) == 2
    for mask, whole in zip(found, expected, strict=True):
        assert np.array_equal(mask, whole)
    if change in (bulging, mirrored, with_holes):
        assert len(borders.faces) < len(uvs) / 2


def covered(charts, packed, size):
    """The texels that each chart covers, by the slow reference."""
    texels = []
    for chart in range(charts.count):
        triangles = packed.uvs[charts.chart == chart] * size
        low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
        rows, columns = (range(int(low[axis]), int(np.ceil(high[axis]))) for axis in (1, 0))
        found = [(row, column) for row in rows for column in columns if any(touches(t, row, column) for t in triangles)]
        texels.append(np.array(found))
    return texels


@pytest.mark.parametrize(("size", "padding", "seed"), [(128, 1, 0), (128, 3, 1), (100, 8, 2)])
def test_gutters_are_kept_between_charts_and_across_the_sides_by_a_slow_reference(size, padding, seed):
    charts = polygons(12, seed)
    packed = pack_charts(charts, size, padding)
    texels = covered(charts, packed, size)
    for chart, own in enumerate(texels):
        others = np.concatenate([found for other, found in enumerate(texels) if other != chart])
        around = np.concatenate([others + (down, right) for down in (-size, 0, size) for right in (-size, 0, size)])
        assert KDTree(around).query(own)[0].min() >= packed.gutter + 1
        assert own.min() >= packed.gutter / 2
        assert own.max() < size - packed.gutter / 2


@pytest.mark.parametrize("cell", [1, 2, 3])
@pytest.mark.parametrize("gutter", [2, 3, 5, 8])
def test_what_a_cell_keeps_free_are_those_with_a_texel_too_near(gutter, cell):
    reach = reach_of_gutter(gutter, cell)
    own = np.stack(np.meshgrid(range(cell), range(cell)), -1).reshape(-1, 2)
    for row in range(12):
        for column in range(12):
            other = own + (row * cell, column * cell)
            distance = np.linalg.norm(own[:, None] - other, axis=2).min()
            assert (row < len(reach) and column <= reach[row]) == (distance < gutter + 1)


@pytest.mark.parametrize("seed", range(4))
def test_every_chart_keeps_its_shape_and_the_page_is_full(seed):
    charts = polygons(60, seed)
    packed = pack_charts(charts, SIZE, 1)
    assert packed.gutter == MIN_GUTTER
    assert packed.uvs.min() > 0
    assert packed.uvs.max() < 1
    sides, packed_sides = (np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2) for uvs in (charts.uvs, packed.uvs))
    assert np.allclose(packed_sides * SIZE, sides * packed.density)
    winding, packed_winding = (np.sign(np.linalg.det(uvs[:, 1:] - uvs[:, :1])) for uvs in (charts.uvs, packed.uvs))
    assert np.array_equal(winding, packed_winding)  # turned, not mirrored
    assert doubled_uv_areas(packed.uvs).sum() / 2 > 0.5


def test_the_unit_of_length_does_not_matter_and_runs_are_equal():
    charts = polygons(40, seed=5)
    first = pack_charts(charts, SIZE, 4)
    assert np.array_equal(pack_charts(charts, SIZE, 4).uvs, first.uvs)
    larger = pack_charts(Charts(charts.uvs * 1024, charts.chart), SIZE, 4)
    assert np.array_equal(larger.uvs, first.uvs)
    assert larger.density * 1024 == first.density


def test_faces_in_no_chart_stay_at_the_origin():
    charts = polygons(5, seed=6)
    none = np.zeros((2, 3, 2))
    more = Charts(np.concatenate([none, charts.uvs]), np.concatenate([[-1, -1], charts.chart]).astype(np.int32))
    packed = pack_charts(more, SIZE, 4)
    assert not packed.uvs[:2].any()
    assert np.array_equal(packed.uvs[2:], pack_charts(charts, SIZE, 4).uvs)


@pytest.mark.parametrize("size", [1024, 4096])
def test_a_density_is_exact(size):
    square = rectangle(1, 1)
    packed = pack_charts(square, size, 8, density=512)
    assert packed.density == 512
    corners = packed.uvs.reshape(-1, 2) * size
    assert np.array_equal(corners.max(axis=0) - corners.min(axis=0), [512, 512])
    assert np.array_equal(corners, np.round(corners))  # it covers 512 texels a side, not 513


def test_what_does_not_fit_is_refused():
    with pytest.raises(NoRoomError, match="1 chart with gutters of 2 texels do not fit 256 x 256 texels"):
        pack_charts(rectangle(1, 1), SIZE, 8, density=300)
    many = [rectangle(1, 1, number) for number in range(2000)]
    with pytest.raises(NoRoomError):  # not even at one texel each
        pack_charts(Charts(np.concatenate([c.uvs for c in many]), np.concatenate([c.chart for c in many])), 64, 1)


def test_a_long_chart_is_laid_along_the_page_and_turned_where_it_fits():
    turn = np.array([(np.cos(0.4), np.sin(0.4)), (-np.sin(0.4), np.cos(0.4))])
    long = rectangle(20, 1)
    packed = pack_charts(Charts(long.uvs @ turn, long.chart), SIZE, 1)
    extent = np.ptp(packed.uvs.reshape(-1, 2), axis=0) * SIZE
    assert extent.max() > 0.97 * (SIZE - packed.gutter)
    assert extent.min() < extent.max() / 19


def test_a_small_chart_lies_in_the_hole_of_a_large_one():
    frame = np.ones((40, 40), bool)
    frame[10:30, 10:30] = False
    places = Page(40, 40, reach_of_gutter(2, 1)).place([np.ones((16, 16), bool), frame])
    assert places[1].tolist() == [0, 0, 0]
    assert places[0, :2].tolist() == [12, 12]


def placed_row_by_row(columns, rows, reach, masks):
    """Where a page puts charts, by trying all places, a row at a time, with all cells of a chart."""
    taken, first_row, places = np.zeros((rows, columns), bool), {}, []
    for mask in masks:
        bottom, found = rows + 1, None
        for turns in range(4):
            turned = np.rot90(mask, turns)
            height, width = turned.shape
            size_class = int(3 * np.log2(width)), int(3 * np.log2(height))
            for row in range(
                first_row.get(size_class, 0), min(bottom - 1, rows) - height + 1 if width <= columns else 0
            ):
                windows = sliding_window_view(taken[row : row + height], (height, width))[0]
                free = ~(windows & turned).any(axis=(1, 2))
                if free.any():
                    bottom, found, first_row[size_class] = row + height, (row, int(free.argmax()), turns), row
                    break
        places.append(found)
        row, column, turns = found
        for down, right in np.argwhere(np.rot90(mask, turns)) + (row, column):
            for distance, wide in enumerate(reach):
                for near in {max(0, down - distance), min(rows - 1, down + distance)}:
                    taken[near, max(0, right - wide) : right + wide + 1] = True
    return np.array(places)


@pytest.mark.parametrize(("columns", "gutter", "cell"), [(65, 2, 1), (63, 5, 2), (40, 4, 1)])
def test_places_are_the_lowest_by_a_slow_reference_seed_1(columns, gutter, cell):
    """Of round charts and long ones; one as long as the page is wide, one of far cells, one that goes around a cell."""
    charts, apart = polygons(40, seed=1), np.zeros((33, 33), bool)
    apart[::16, ::16] = True
    borders = ChartBorders.of(charts.uvs, charts.chart)
    masks = chart_masks(6 * in_least_boxes(charts.uvs, charts.chart, borders), charts.chart, 0.0, borders)
    masks += [np.ones((columns, 1), bool), apart, np.ones((20, 20), bool), np.ones((1, 1), bool)]
    masks.sort(key=lambda mask: -sum(mask.shape))
    reach = reach_of_gutter(gutter, cell)
    places = placed_row_by_row(columns, 300, reach, masks)
    assert np.array_equal(Page(columns, 300, reach).place(masks), places)
    assert (places[:, 2] % 2 == 1).any()


def test_the_gutter_shrinks_with_the_room_and_never_below_two():
    assert choose_gutter(Outlines(1.0, 0.1, 1.0), 1024, 8) == 16
    gutters = [choose_gutter(Outlines(1.0, length, 1.0), 1024, 8) for length in (4.0, 40.0, 100.0, 400.0, 4000.0)]
    assert gutters == sorted(gutters, reverse=True)
    assert gutters[-1] == 2
    assert choose_gutter(Outlines(1.0, 4.0, 1.0), 1024, 0) == 2


@pytest.mark.parametrize("size", [16, 17, 128, 1024])
@pytest.mark.parametrize("thickness", [1e-2, 1e-4, 1e-8])
def test_a_thin_chart_is_as_long_as_the_page(thickness, size):
    """However thin: its area says nothing of the page that it needs. No image is larger than the page."""
    packed = pack_charts(rectangle(1, thickness), size, 8)
    assert np.ptp(packed.uvs.reshape(-1, 2), axis=0).max() * size > 0.99 * (size - 2 * (packed.gutter / 2 + 1))
    assert packed.uvs.min() >= 0
    assert packed.uvs.max() <= 1


def test_a_thin_ring_is_as_wide_as_the_page():
    angle = np.linspace(0, 2 * np.pi, 65)
    outer, inner = (radius * np.column_stack([np.cos(angle), np.sin(angle)]) for radius in (1, 0.999))
    first = np.stack([outer[:-1], outer[1:], inner[1:]], axis=1)
    second = np.stack([outer[:-1], inner[1:], inner[:-1]], axis=1)
    charts = Charts(np.concatenate([first, second]), np.zeros(128, np.int32))
    packed = pack_charts(charts, SIZE, 4)
    assert np.ptp(packed.uvs.reshape(-1, 2), axis=0).min() * SIZE > SIZE - packed.gutter - 2


def test_eight_texels_of_padding_are_right_to_level_two():
    assert first_unsafe_mip(16, 8) == 3
    assert [first_unsafe_mip(gutter, 99) for gutter in (2, 6, 12, 24)] == [1, 2, 3, 4]
    assert [first_unsafe_mip(99, padding) for padding in (0, 1, 3, 6)] == [0, 1, 2, 3]
