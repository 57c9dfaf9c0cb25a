"""New UVs: inside the page, one to one, of one scale, with room between charts; and the choice between old and new."""

import re
import sys
import time

import numpy as np
import pytest
from scipy.spatial import KDTree

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout, corner_ids
from aoprecalc.uv.pack import choose_gutter, first_unsafe_mip
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
    atlas = unwrap(made, method, SIZE, 4)
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
    atlas = unwrap(made, method, SIZE, 4)
    charts = charts_of(made, atlas)
    texels = [np.column_stack(np.divmod(_covered(made, atlas, charts == chart), SIZE)) for chart in range(atlas.charts)]
    assert min(t.min() for t in texels) >= atlas.gutter // 2 - 1
    assert max(t.max() for t in texels) <= SIZE - atlas.gutter // 2
    gaps = [KDTree(texels[a]).query(texels[b], p=np.inf)[0].min() for a in range(len(texels)) for b in range(a)]
    assert min(gaps, default=SIZE) >= atlas.gutter - 1


def _covered(made, atlas, faces):
    part = type(atlas)(atlas.method, atlas.uvs, faces, 1)
    return CPURasterizer(build_layout(made, part, SIZE, SIZE)).coverage().index


def test_faces_without_area_have_no_place():
    positions, faces = ball(1)
    made = scene(positions, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]]))
    atlas = unwrap(made, "xatlas", SIZE, 4)
    assert atlas.mapped.tolist() == [True] * len(faces) + [False] * 2
    with pytest.raises(InputError, match="none of 1 face has area"):
        unwrap(scene([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]]), "xatlas", SIZE, 4)


def test_steps_are_heard_from_xatlas():
    heard = []
    unwrap(scene(*torus(around=100, across=60)), "xatlas", SIZE, 4, on_step=heard.append)
    steps = [step for step in dict.fromkeys(heard) if step != "starting"]
    assert steps[0] == "charts"
    assert steps[1:] == sorted(steps[1:], key=lambda step: int(step.split()[2]))
    assert all(re.fullmatch(r"packing, try \d+ of at most 12", step) for step in steps[1:])


def test_steps_are_heard_from_uvunwrap():
    heard = []
    unwrap(scene(*torus(around=400, across=200)), "uvunwrap", SIZE, 4, on_step=heard.append)
    stages = {"segmenting", "parameterizing", "packing", "output"}
    steps = [step for step in heard if step != "starting"]
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
        unwrap(scene(*box()), "xatlas", SIZE, 4, timeout=1.5)
    assert 1.5 < time.monotonic() - started < 60


def test_uvunwrap_is_given_up_when_its_time_is_over():
    with pytest.raises(
        AoprecalcError, match=r"uvunwrap has not unwrapped 320000 faces within 0.01 s .* allow more time"
    ):
        unwrap(scene(*torus(around=800, across=200)), "uvunwrap", SIZE, 4, timeout=0.01)


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
def test_an_unwrap_in_time_is_the_same_as_one_without_a_limit(method):
    made = scene(*box())
    assert np.array_equal(unwrap(made, method, SIZE, 4, timeout=600).uvs, unwrap(made, method, SIZE, 4).uvs)


def test_a_killed_xatlas_is_an_error_of_one_line(monkeypatch):
    monkeypatch.setitem(_CHILDREN, "xatlas", [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"])
    with pytest.raises(AoprecalcError, match=r"xatlas could not unwrap 12 faces: signal 9 .*; or try unwrap uvunwrap"):
        unwrap(scene(*box()), "xatlas", SIZE, 4)


def test_the_gutter_shrinks_with_the_room_and_never_below_two():
    assert choose_gutter(charts=1, area=1.0, perimeter=4.0, size=1024, padding=8) == 16
    outlines = [4.0, 40.0, 100.0, 400.0, 4000.0]
    gutters = [choose_gutter(1, 1.0, outline, 1024, 8) for outline in outlines]
    assert gutters == sorted(gutters, reverse=True)
    assert gutters[-1] == 2
    assert choose_gutter(1, 1.0, 4.0, 1024, 0) == 2


def test_eight_texels_of_padding_are_right_to_level_two():
    assert first_unsafe_mip(16, 8) == 3
    assert [first_unsafe_mip(gutter, 99) for gutter in (2, 6, 12, 24)] == [1, 2, 3, 4]
    assert [first_unsafe_mip(99, padding) for padding in (0, 1, 3, 6)] == [0, 1, 2, 3]


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


@pytest.mark.parametrize("fault", ["missing", "overlap", "no area", "tiled"])
def test_uvs_that_cannot_hold_a_bake_are_replaced_or_refused(fault):
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    uvs = quad_uvs((0.1, 0.1), (0.9, 0.9), cells=4)
    if fault == "overlap":
        uvs[..., 0] = np.abs(uvs[..., 0] - 0.5)
    elif fault == "no area":
        uvs[3] = uvs[3, 0]
    elif fault == "tiled":
        uvs *= 3
    made = scene(positions, faces, None if fault == "missing" else uvs)
    assert choose(made, "auto").method == "xatlas"
    with pytest.raises(InputError, match="cannot hold a bake"):
        choose(made, "keep")
