"""New UVs: inside the page, one to one, of one scale, with room between charts; and the choice between old and new."""

import re
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import AoprecalcError, ArgumentError, InputError
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout, corner_ids
from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.pack import NoRoomError
from aoprecalc.uv.unwrap import _CHILDREN, choose_atlas, unwrap
from shapes import ball, box, join, quad, quad_uvs, scene, torus

SIZE = 256


def charts_of(made, atlas):
    from aoprecalc.mesh.topology import face_components

    return face_components(corner_ids(made.faces[atlas.mapped], atlas.uvs[atlas.mapped]))


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e5])
def test_an_unwrap_is_a_faithful_map(method, scale):
    positions, faces = join(torus(around=24, across=12), (box()[0] * 0.4 + 3, box()[1]))
    made = scene(positions * scale, faces)
    atlas = unwrap(made, method, PageSpec(SIZE, 4))
    assert atlas.mapped.all()
    assert atlas.uvs.min() >= 0
    assert atlas.uvs.max() <= 1
    assert atlas.charts == charts_of(made, atlas).max() + 1
    raster = CPURasterizer(build_layout(made, atlas, SIZE, SIZE))
    assert raster.overlap() == 0
    # One scale over the whole surface, apart from what flattening stretches, and a page that is used.
    side, other = np.diff(made.corners, axis=1).transpose(1, 0, 2)
    across, down = np.diff(atlas.uvs, axis=1).transpose(1, 0, 2)
    ratio = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]) / np.linalg.norm(
        np.cross(side, other), axis=1
    )
    assert np.quantile(ratio, 0.95) < 3 * np.quantile(ratio, 0.05)
    assert len(raster.coverage()) > 0.25 * SIZE * SIZE


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
def test_charts_keep_the_gutter_between_them_and_half_of_it_at_the_sides(method):
    made = scene(*box())
    atlas = unwrap(made, method, PageSpec(SIZE, 4))
    charts = charts_of(made, atlas)
    texels = [np.column_stack(np.divmod(_covered(made, atlas, charts == chart), SIZE)) for chart in range(atlas.charts)]
    assert min(t.min() for t in texels) >= atlas.gutter // 2
    assert max(t.max() for t in texels) <= SIZE - atlas.gutter // 2
    gaps = [KDTree(texels[a]).query(texels[b])[0].min() for a in range(len(texels)) for b in range(a)]
    assert min(gaps, default=SIZE) >= atlas.gutter + 1


def _covered(made, atlas, faces):
    part = type(atlas)(atlas.method, atlas.uvs, faces, 1)
    return CPURasterizer(build_layout(made, part, SIZE, SIZE)).coverage().index


def test_faces_without_area_have_no_place():
    positions, faces = ball(1)
    made = scene(positions, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]]))
    atlas = unwrap(made, "xatlas", PageSpec(SIZE, 4))
    assert atlas.mapped.tolist() == [True] * len(faces) + [False] * 2
    with pytest.raises(InputError, match="none of 1 face has area"):
        unwrap(scene([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]]), "xatlas", PageSpec(SIZE, 4))


def test_steps_are_heard_from_xatlas():
    heard = []
    unwrap(scene(*torus(around=100, across=60)), "xatlas", PageSpec(SIZE, 4), on_step=heard.append)
    assert [step for step in dict.fromkeys(heard) if step != "starting"] == ["charts", "packing"]


def test_steps_are_heard_from_uvunwrap():
    heard = []
    unwrap(scene(*torus(around=400, across=200)), "uvunwrap", PageSpec(SIZE, 4), on_step=heard.append)
    stages = {"segmenting", "parameterizing", "packing", "output"}
    steps = [step for step in heard if step not in ("starting", "packing")]
    assert steps
    for step in steps:
        stage, count = step.split(", ")
        assert stage in stages
        assert re.fullmatch(r"try \d+|\d+ of \d+", count)


def test_xatlas_is_given_up_when_its_time_is_over(monkeypatch):
    """A stand-in that never answers: the error says how many faces, how long, where it was, and what to do."""
    stuck = "import sys, time; print('step: charts', file=sys.stderr, flush=True); time.sleep(600)"
    monkeypatch.setitem(_CHILDREN, "xatlas", [sys.executable, "-c", stuck])
    expected = (
        r"xatlas has not unwrapped 12 faces within 1.5 s \(unwrap_timeout\), it is at: charts; "
        "allow more time or use unwrap uvunwrap"
    )
    started = time.monotonic()
    with pytest.raises(AoprecalcError, match=expected):
        unwrap(scene(*box()), "xatlas", PageSpec(SIZE, 4), timeout=1.5)
    assert 1.5 < time.monotonic() - started < 60


def test_uvunwrap_is_given_up_when_its_time_is_over():
    with pytest.raises(
        AoprecalcError, match=r"uvunwrap has not unwrapped 320000 faces within 0.01 s .* allow more time"
    ):
        unwrap(scene(*torus(around=800, across=200)), "uvunwrap", PageSpec(SIZE, 4), timeout=0.01)


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
def test_an_unwrap_in_time_is_the_same_as_one_without_a_limit(method):
    made = scene(*box())
    assert np.array_equal(
        unwrap(made, method, PageSpec(SIZE, 4), timeout=600).uvs, unwrap(made, method, PageSpec(SIZE, 4)).uvs
    )


def test_a_killed_xatlas_is_an_error_of_one_line(monkeypatch):
    monkeypatch.setitem(_CHILDREN, "xatlas", [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"])
    with pytest.raises(AoprecalcError, match=r"xatlas could not unwrap 12 faces: signal 9 .*; or try unwrap uvunwrap"):
        unwrap(scene(*box()), "xatlas", PageSpec(SIZE, 4))


def choose(made, unwrap, progress=None):
    options = BakeOptions(width=SIZE, height=SIZE, unwrap=unwrap)
    return choose_atlas(CPURasterizer, made, options, progress or Progress())


class Notes(Progress):
    def __init__(self):
        self.said = []

    def note(self, text):
        self.said.append(text)


def test_where_xatlas_is_not_installed_auto_takes_uvunwrap_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "xatlas", None)
    heard = Notes()
    assert choose(scene(*box()), "auto", heard).method == "uvunwrap"
    assert heard.said[-1].startswith("uvunwrap makes the UVs: xatlas is not installed")


@pytest.mark.parametrize(("method", "other"), [("xatlas", "uvunwrap"), ("uvunwrap", "xatlas")])
def test_an_unwrapper_that_is_not_installed_is_refused(method, other, monkeypatch):
    monkeypatch.setitem(sys.modules, method, None)
    with pytest.raises(ArgumentError, match=f"unwrap is {method}.*`pip install {method}`, or use {other}"):
        choose(scene(*box()), method)
    monkeypatch.setitem(sys.modules, other, None)
    with pytest.raises(ArgumentError, match="neither of which is installed"):
        choose(scene(*box()), "auto")


def test_good_uvs_are_kept():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    for low, high in (((0.1, 0.1), (0.9, 0.9)), ((2.3, -0.4), (3.1, 0.4))):
        atlas = choose(scene(positions, faces, quad_uvs(low, high, cells=4)), "auto")
        assert (atlas.method, atlas.charts, atlas.repeats) == ("keep", 1, low[0] > 1)


FAULTS = {
    "missing": lambda uvs: None,
    "overlap": lambda uvs: np.abs(uvs - (0.5, 0)),
    "no area": lambda uvs: np.where(np.arange(len(uvs))[:, None, None] == 3, uvs[:, :1], uvs),
    "tiled": lambda uvs: uvs * 3,
    "nothing": lambda uvs: uvs * 0,
    "repeats": lambda uvs: uvs * 25,
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_uvs_are_replaced_and_kept_where_that_is_asked_for_and_possible(fault):
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    uvs = FAULTS[fault](quad_uvs((0.1, 0.1), (0.9, 0.9), cells=4))
    made = scene(positions, faces, uvs)
    assert choose(made, "auto").method == "xatlas"
    if fault in ("missing", "nothing", "repeats"):
        with pytest.raises(InputError, match="cannot hold a bake"):
            choose(made, "keep")
        return
    kept = choose(made, "keep")
    assert kept.method == "keep"
    assert np.array_equal(kept.uvs, uvs)
    assert np.flatnonzero(~kept.mapped).tolist() == ([3] if fault == "no area" else [])


@pytest.mark.parametrize(("share", "method"), [(0.0009, "keep"), (0.0011, "xatlas")])
def test_auto_keeps_uvs_that_hold_all_but_a_thousandth_of_the_surface(share, method):
    """A quad, and beside it a smaller one without area in UV space: its share of the surface decides, not its faces."""
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    side = (share / (1 - share)) ** 0.5
    small = quad((2, 0, 0), (side, 0, 0), (0, side, 0), cells=8)
    uvs = np.concatenate([quad_uvs((0.1, 0.1), (0.9, 0.9), cells=4), np.zeros((len(small[1]), 3, 2))])
    atlas = choose(scene(*join((positions, faces), small), uvs), "auto")
    assert atlas.method == method
    assert atlas.checks[0].flat_faces == len(small[1])
    assert atlas.checks[0].flat_share == pytest.approx(share)
    assert np.flatnonzero(~atlas.mapped).tolist() == (list(range(32, 160)) if method == "keep" else [])


def test_keep_takes_the_set_that_loses_least():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    uvs = quad_uvs((0.1, 0.1), (0.9, 0.9), cells=4)
    flat = np.where(np.arange(32)[:, None, None] < 3, uvs[:, :1], uvs)
    made = replace(scene(positions, faces), uv_sets=(FAULTS["overlap"](uvs), flat, uvs * 0))
    assert choose(made, "keep").uv_set == 1
    assert choose(replace(made, uv_sets=(*made.uv_sets, uvs)), "keep").uv_set == 3


def test_what_has_no_texels_is_told_with_its_share_of_the_surface():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    uvs = quad_uvs((0.1, 0.1), (0.9, 0.9), cells=4)
    made = scene(positions, faces, np.where(np.arange(32)[:, None, None] < 2, uvs[:, :1], uvs))
    baked = bake_scene(made, BakeOptions(size=SIZE, directions=64, unwrap="keep"))
    (line,) = baked.warnings
    assert line.startswith("2 of 32 faces (0.062 of the surface) have no area in the file's UVs, so no texels;")


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_texel_of_two_faces_has_the_value_of_the_first(backend):
    """A quad that is open and one between two walls, on the same UVs, in both orders."""
    dark = join(*(quad((60, 0, height), (9, 0, 0), (0, 9, 0)) for height in (1, 0.9, 1.1)))
    clear, uvs = quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad_uvs((0, 0), (1, 1))
    away = np.concatenate([uvs * 0.01, uvs * 0.01])
    for first, second, expected in ((clear, dark, 1.0), (dark, clear, 0.0)):
        of_first, of_second = (np.concatenate([uvs, away]) if shape is dark else uvs for shape in (first, second))
        made = scene(*join(first, second), np.concatenate([of_first, of_second]))
        baked = bake_scene(made, BakeOptions(size=64, directions=128, unwrap="keep", backend=backend, fill="none"))
        middle = baked.texture.values[16:48, 16:48]
        assert np.abs(middle - expected).max() < 0.02
        assert any("the value of the face that comes first in the file" in line for line in baked.warnings)


def test_a_page_without_room_for_texels_by_need_keeps_the_packing_that_fits(monkeypatch):
    made = scene(*box())
    fits = unwrap(made, "xatlas", PageSpec(SIZE, 4))

    def no_room(*_, **_more):
        raise NoRoomError("there is no room")

    monkeypatch.setattr("aoprecalc.uv.fill.pack_charts", no_room)  # in this process alone, not in the child
    kept = unwrap(made, "xatlas", PageSpec(SIZE, 4))
    assert kept.charts == fits.charts
    assert kept.mapped.all()
    assert kept.gutter >= 2
    assert 0 <= kept.uvs.min() < kept.uvs.max() <= 1
