"""Charts: every face with area has a place, at the scale of its surface, and none lies over another."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.options import BakeOptions
from aoprecalc.raster.cpu_rasterizer import CPURasterizer, overlapping_triangles
from aoprecalc.raster.layout import build_layout, doubled_uv_areas
from aoprecalc.uv import charts as cutting
from aoprecalc.uv import unwrap as unwrapping
from aoprecalc.uv.charts import Charts, cut_again, make_charts, out_of_scale, sum_over_charts
from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.unwrap import cut_and_pack, unwrap
from shapes import ball, box, cap, city, clutter, join, quad, rotation, scene, scene_of_parts, torus

METHODS = pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
SIZE = 256


def areas_of(positions, faces):
    return np.linalg.norm(area_vectors(positions[faces]), axis=1) / 2


def lengths(corners):
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def sound_atlas(made, method, size):
    """The atlas of a scene, after a check that every face with area has its share of texels of its own."""
    atlas = unwrap(made, method, PageSpec(size, 4))
    assert atlas.mapped.all()
    assert CPURasterizer(build_layout(made, atlas, size, size)).overlap() == 0
    shares = [areas / areas.sum() for areas in (doubled_uv_areas(atlas.uvs), areas_of(made.positions, made.faces))]
    return atlas, shares[0] / shares[1]


@METHODS
@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_no_face_is_lost_at_any_scale(method, scale):
    """Clutter, and boxes of it 10,000 times smaller: with areas of 1e-10 of the surface."""
    big, small = clutter(seed=0), clutter(seed=1)
    positions, faces = join(big, (small[0] * 1e-4 + 3, small[1]))
    atlas, ratio = sound_atlas(scene(positions * scale, faces), method, SIZE)
    assert atlas.charts < len(faces) / 3
    assert np.quantile(ratio, 0.01) > 0.3
    assert np.quantile(ratio, 0.99) < 3


@METHODS
@pytest.mark.parametrize(
    "shape",
    [
        (np.eye(3), np.array([[0, 1, 2]])),
        quad((0, 0, 0), (1, 0, 0), (0, 1, 0)),
        quad((0, 0, 0), (3000, 0, 0), (0, 1, 0), cells=4),
        cap(),
    ],
    ids=["triangle", "square", "strip", "cap"],
)
@pytest.mark.parametrize("size", [64, 200])
def test_one_chart_stays_inside_the_page(method, shape, size):
    made = scene(*shape)
    atlas, _ = sound_atlas(made, method, size)
    room = atlas.gutter // 2 - 1
    assert atlas.uvs.min() * size >= room
    assert atlas.uvs.max() * size <= size - room


@METHODS
@pytest.mark.parametrize("thin", [1e-2, 1e-4, 1e-6])
def test_slivers_have_a_place(method, thin):
    """A strip as long as a torus, of triangles far thinner than a texel."""
    strip = quad((2, 0, 0), (thin, 0, 0), (0, 2, 0), cells=3)
    made = scene(*join(torus(around=24, across=12), strip))
    _, ratio = sound_atlas(made, method, SIZE)
    assert ratio[-len(strip[1]) :].sum() / len(strip[1]) == pytest.approx(1, abs=0.5)


@METHODS
@pytest.mark.parametrize("fineness", ["coarse", "fine", "planar", "patches", "faces"])
def test_charts_have_the_area_and_nearly_the_lengths_of_their_faces(method, fineness):
    positions, faces = join(
        *(box(low, high) for low, high in (((0, 0, 0), (1, 0.6, 0.2)), ((0.2, 0.7, 0), (0.5, 1, 1))))
    )
    charts = make_charts(method, positions, faces.astype(np.int32), fineness)
    assert (charts.chart >= 0).all()
    in_plane, on_surface = (
        sum_over_charts(charts.chart, areas) for areas in (doubled_uv_areas(charts.uvs) / 2, areas_of(positions, faces))
    )
    assert in_plane == pytest.approx(on_surface)
    assert np.abs(lengths(charts.uvs) / lengths(positions[faces]) - 1).max() < 0.02


def test_planar_charts_of_a_box_are_its_sides():
    positions, faces = box((0, 0, 0), (3, 2, 1))
    positions = positions @ rotation(0)
    charts = make_charts("xatlas", positions, faces.astype(np.int32), "planar")
    assert charts.count == 6
    assert sorted(sum_over_charts(charts.chart, doubled_uv_areas(charts.uvs) / 2)) == pytest.approx([2, 2, 3, 3, 6, 6])
    assert lengths(charts.uvs) == pytest.approx(lengths(positions[faces]))


def test_planar_charts_do_not_fold_and_do_not_lie_over_themselves():
    """Not where a surface bends back, nor where a face is there twice, nor where it is there with both windings."""
    positions, faces = ball(3)
    twice = np.concatenate([faces, faces[:50], faces[:50, ::-1]]).astype(np.int32)
    charts = make_charts("xatlas", positions, twice, "planar")
    side, other = (charts.uvs[:, corner] - charts.uvs[:, 0] for corner in (1, 2))
    assert (side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0] > 0).all()
    for chart in range(charts.count):
        uvs = charts.uvs[charts.chart == chart]
        assert not overlapping_triangles((uvs / uvs.max() * 200).astype(np.float32), 200, 200).any()
    # No face is turned from its chart's plane by more than 25 degrees.
    flat, true = doubled_uv_areas(charts.uvs) / 2, areas_of(positions, twice)
    assert (flat / true).min() > np.cos(np.radians(25)) ** 2
    assert charts.count < len(twice) / 5


@METHODS
def test_a_spiral_ramp_does_not_lie_over_itself(method):
    """Nearly flat, of five turns one above the other: xatlas projects it as a whole."""
    turn = np.linspace(0, 10 * np.pi, 200)
    sides = [np.column_stack([radius * np.cos(turn), radius * np.sin(turn), 1e-3 * turn]) for radius in (1, 2)]
    i = np.arange(199)
    faces = np.concatenate([np.stack([i, i + 200, i + 1], 1), np.stack([i + 1, i + 200, i + 201], 1)])
    atlas, ratio = sound_atlas(scene(np.concatenate(sides), faces), method, SIZE)
    assert ratio.max() < 2 * ratio.min()
    assert atlas.charts < 50


def blown_up(charts):
    return charts.uvs * np.where(charts.chart == 0, 30.0, 1.0)[:, None, None]


def folded(charts):
    return np.abs(charts.uvs - 0.4 * charts.uvs.max(axis=(0, 1)))


def collapsed(charts):
    return charts.uvs * np.where(np.arange(len(charts.chart)) % 5 == 0, 0.0, 1.0)[:, None, None]


def piled(charts):
    """All faces of a chart in the place of its first."""
    first = np.unique(charts.chart, return_index=True)[1]
    return charts.uvs[first[charts.chart]]


@METHODS
@pytest.mark.parametrize(
    ("where", "fault"),
    [
        *(("cut", fault) for fault in (blown_up, folded, collapsed, piled)),
        *(("packed", fault) for fault in (blown_up, folded, piled)),
    ],
)
def test_faulty_charts_are_cut_again(method, where, fault, monkeypatch):
    """Whether the unwrapper made them so, or the packer, at its first try."""
    positions, faces = torus(around=40, across=20)
    positions, faces = (positions - positions.min(axis=0)) / np.ptp(positions, axis=0).max(), faces.astype(np.int32)
    good = make_charts(method, positions, faces)
    if where == "cut":
        real = cutting._METHODS[method]

        def cut_badly(positions, faces, fine):
            return real(positions, faces, fine) if fine else (fault(good), good.chart.copy())

        monkeypatch.setitem(cutting._METHODS, method, cut_badly)
    else:
        pack, tries = unwrapping.pack_charts, []

        def pack_badly(charts, *settings, **how):
            packed = pack(charts, *settings, **how)
            tries.append(packed)
            return packed if len(tries) > 1 else replace(packed, uvs=fault(Charts(packed.uvs, charts.chart)) % 1)

        monkeypatch.setattr(unwrapping, "pack_charts", pack_badly)
    answer = cut_and_pack(method, positions, faces, SIZE, 2)
    assert answer["placed"].all()
    triangles = (answer["uvs"] * (SIZE, -SIZE) + (0, SIZE)).astype(np.float32)
    assert not overlapping_triangles(triangles, SIZE, SIZE).any()
    ratio = doubled_uv_areas(answer["uvs"]) / areas_of(positions, faces)
    assert ratio.max() < 3 * ratio.min()


def test_what_is_out_of_scale():
    surface = np.array([4.0, 3.0, 2.0, 1.0, 1e-9])
    assert out_of_scale(surface * 7, surface).tolist() == [False] * 5
    assert out_of_scale(surface * (7, 7, 3, 15, 7), surface).tolist() == [False, False, True, True, False]
    assert out_of_scale(surface * (7, 7, 7, 7, 70), surface, negligible=1e-6).tolist() == [False] * 5
    assert out_of_scale(surface + (0, 0, 0, 0, 9), surface).tolist() == [False] * 4 + [
        True
    ]  # takes half of the texture


def test_cutting_again_leaves_the_other_charts_as_they_are():
    positions, faces = torus(around=40, across=20)
    faces = faces.astype(np.int32)
    before = make_charts("xatlas", positions, faces)
    after = cut_again(before, np.arange(before.count) == 1, "xatlas", positions, faces, "planar")
    others = before.chart != 1
    assert after.uvs[others] == pytest.approx(before.uvs[others])
    assert len(np.unique(after.chart[others])) == before.count - 1
    assert not set(after.chart[others]) & set(after.chart[~others])
    assert after.count > before.count


@pytest.mark.slow
@METHODS
def test_a_city_in_a_sky(method):
    """Whose smallest faces are 1e-10 of the surface, and longest charts 1,000 times as long as they are wide."""
    made = city()
    ratio = sound_atlas(made, method, 512)[1]
    assert ratio.min() > 0.5
    assert ratio.max() < 2


def test_a_city_in_a_sky_is_baked_right_and_the_sky_told():
    """Seen from outside the box, its sides hide the houses; without it they stand in the open."""
    made = city(boxes=20)
    options = {"size": 256, "directions": 128, "normals": "flat"}
    closed = bake_scene(made, BakeOptions(**options))
    assert closed.texture.values[closed.texture.valid].max() < 0.05
    (told,) = [line for line in closed.warnings if line.startswith("'sky': ")]
    assert "% of the texture, as it is far larger than the rest; if it needs none, --exclude it" in told
    clear = bake_scene(made, BakeOptions(**options, exclude=("sky",)))
    assert not any("of the texture" in line for line in clear.warnings)
    roofs = (made.faces < 8 * 20).all(axis=1) & (area_vectors(made.corners)[:, 2] > 0)
    uvs = clear.atlas.uvs[roofs].mean(axis=1)
    column, row = (uvs * (256, -256) + (0, 256)).astype(int).T
    assert clear.texture.values[row, column].mean() > 0.9


@pytest.mark.parametrize(
    "parts",
    [
        [torus()],
        [torus(around=20, across=10), ball(2, 0.8)],
        [ball(4, 2.0), *((0.02 * ball(1)[0] + (0, y, 2), ball(1)[1]) for y in (-1, 0, 1))],  # a body and its buttons
        [box((-4, -4, -4), (4, 4, 4)), *(box((x, -1, -4), (x + 1, 1, -2)) for x in (-3, 0, 2))],  # a room
    ],
    ids=["one part", "two fair parts", "buttons", "a room"],
)
def test_ordinary_parts_are_not_told(parts):
    baked = bake_scene(scene_of_parts(*parts), BakeOptions(size=128, directions=64))
    assert not any("of the texture" in line for line in baked.warnings)
