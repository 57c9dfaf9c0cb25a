"""`texel_density`: every chart of new UVs has that many texels per unit of length, or the bake is refused."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from aoprecalc import subprocesses
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import AoprecalcError, ArgumentError, InputError
from aoprecalc.options import BakeOptions
from aoprecalc.uv import fill
from aoprecalc.uv.checks import TexelDensity
from aoprecalc.uv.fill import PageSpec, next_power_of_two, rounded_down
from aoprecalc.uv.unwrap import unwrap
from shapes import box, join, quad, quad_uvs, scene, scene_of_parts, torus

SQUARE = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))


def bake(made, **options):
    return bake_scene(made, BakeOptions(directions=2, **options))


def test_a_unit_square_at_100_covers_100_x_100_texels():
    baked = bake(scene(*SQUARE), size=128, texel_density=100)
    assert np.count_nonzero(baked.texture.valid) == 100**2


@pytest.mark.parametrize("method", ["xatlas", "uvunwrap"])
def test_a_cube_of_edge_2_has_six_squares_of_twice_the_density(method):
    made = scene(*box())
    atlas = unwrap(made, method, PageSpec(256, 4, 30.0))
    corners = atlas.uvs.reshape(6, 6, 2) * 256  # two triangles a side
    assert np.allclose(np.sort(np.ptp(corners, axis=1).ravel()), 60)
    density = TexelDensity.of(made, atlas, 256, 256)
    assert (density.mean, density.least) == pytest.approx((30, 30))


def test_the_density_does_not_depend_on_what_else_is_in_the_scene_nor_on_its_unit():
    for unit in (1e-3, 1.0, 1e3):
        positions, faces = join(torus(around=24, across=12), (box()[0] * 0.3 + 3, box()[1]))
        made = scene(positions * unit, faces)
        atlas = unwrap(made, "xatlas", PageSpec(512, 4, 20.0 / unit))
        density = TexelDensity.of(made, atlas, 512, 512)
        assert density.mean * unit == pytest.approx(20)
        assert density.least * unit == pytest.approx(20)


def test_without_a_density_charts_with_more_to_show_get_more_texels_and_the_mean_tells_the_page():
    apart = scene(*join(torus(around=24, across=12), quad((9, 0, 0), (4, 0, 0), (0, 4, 0))))
    baked = bake_scene(apart, BakeOptions(size=256, directions=64))
    density = TexelDensity.of(apart, baked.atlas, 256, 256)
    assert density.least < 0.9 * density.mean
    share = np.count_nonzero(baked.texture.valid) / 256**2
    area = 4 * np.pi**2 * 0.4 + 16
    assert density.mean == pytest.approx(np.sqrt(share * 256**2 / area), rel=0.05)


def test_gutters_are_as_wide_as_is_wanted_where_the_charts_leave_room():
    made = scene(*box())
    assert unwrap(made, "xatlas", PageSpec(512, 8, 20.0)).gutter == 16
    assert unwrap(made, "xatlas", PageSpec(512, 8, 80.0)).gutter < 16


def refused(made, **options):
    with pytest.raises(ArgumentError) as error:
        bake(made, **options)
    return str(error.value)


@pytest.mark.parametrize(("shape", "size", "density"), [(SQUARE, 64, 100.0), (box(), 128, 55.0), (torus(), 128, 40.0)])
def test_a_density_without_room_is_refused_with_one_that_fits_and_a_size_for_it(shape, size, density):
    made = scene(*shape)
    message = refused(made, size=size, texel_density=density)
    found = re.fullmatch(
        rf"texel_density is {density:g}, for which {size} x {size} texels have no room; use ([\d.]+), "
        r"or a size of (\d+)",
        message,
    )
    assert found, message
    fits, larger = float(found[1]), int(found[2])
    assert fits < density
    for wanted, page in ((fits, size), (density, larger)):
        baked = bake(made, size=page, texel_density=wanted)
        assert TexelDensity.of(made, baked.atlas, page, page).mean == pytest.approx(wanted)


def test_a_density_beyond_every_size_is_refused_at_once():
    message = refused(scene(*box()), size=64, texel_density=1e9)
    assert re.fullmatch(r"texel_density is 1e\+09, for which 64 x 64 texels have no room; use [\d.]+", message)


def test_a_density_for_which_the_surface_is_smaller_than_a_texel():
    with pytest.raises(InputError, match="covers none of 64 x 64 texels; use a greater texel_density"):
        bake(scene(*SQUARE), size=64, texel_density=1e-4)


def test_uvs_that_are_kept_have_a_density_of_their_own():
    made = scene(*SQUARE, quad_uvs((0.25, 0.25), (0.75, 0.75)))
    message = refused(made, size=64, texel_density=100)
    assert message == (
        "texel_density is 100, but the file's own UVs have 32 at 64 x 64; use a size of 256 without it, "
        "or unwrap xatlas for new UVs"
    )
    assert TexelDensity.of(made, bake(made, size=64).atlas, 64, 64).mean == pytest.approx(32)
    baked = bake(made, size=128, texel_density=100, unwrap="xatlas")
    assert np.count_nonzero(baked.texture.valid) == 100**2


def test_the_shorter_side_of_a_texture_counts():
    made = scene(*SQUARE)
    baked = bake(made, width=256, height=128, texel_density=100)
    assert np.count_nonzero(baked.texture.valid) == 2 * 100**2


def test_instances_that_share_texels_count_once():
    made = scene_of_parts(SQUARE, quad((5, 0, 0), (1, 0, 0), (0, 1, 0)))
    assert TexelDensity.of(made, unwrap(made, "xatlas", PageSpec(256, 4, 50.0)), 256, 256).mean == pytest.approx(50)


@pytest.mark.parametrize("density", [0, -1, "dense", float("nan"), float("inf")])
def test_what_is_no_density_is_refused(density):
    with pytest.raises(ArgumentError, match=r"texel_density is .*; expected a number above 0"):
        BakeOptions(texel_density=density)


@pytest.mark.parametrize(("number", "power"), [(0.3, 1), (1, 1), (2, 2), (2.1, 4), (64, 64), (65, 128)])
def test_powers_of_two(number, power):
    assert next_power_of_two(number) == power


@pytest.mark.parametrize(("number", "text"), [(63.29, "63.2"), (0.012399, "0.0123"), (1e4, "1e+04"), (512.0, "512")])
def test_numbers_are_rounded_down(number, text):
    assert rounded_down(number) == text
    assert float(text) <= number


def test_the_last_packing_ends_at_the_time_limit_and_where_a_step_raises(monkeypatch):
    made = scene(*box())
    place = fill.pack_charts

    def slowly(*arguments, **more):
        late = SimpleNamespace(monotonic=lambda: 1e12)
        with monkeypatch.context() as patch:
            patch.setattr(subprocesses, "time", late)
            return place(*arguments, **more)

    monkeypatch.setattr(fill, "pack_charts", slowly)
    with pytest.raises(AoprecalcError, match=r"within 60 s \(unwrap_timeout\), it is at: packing;"):
        unwrap(made, "xatlas", PageSpec(64, 2), timeout=60.0)

    def stop(step):
        if step == "packing":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        unwrap(made, "xatlas", PageSpec(64, 2), on_step=stop)


@pytest.mark.parametrize(
    ("packings", "advice"), [(0, "use a lower one"), (1, r"use \d+(\.\d+)?"), (9, r"use .*, or a size of \d+")]
)
def test_the_advice_of_a_refusal_is_what_the_time_limit_leaves(monkeypatch, packings, advice):
    place, calls = fill.pack_charts, []

    def until_late(*arguments, tick, **more):
        calls.append(tick)
        if len(calls) > 1 + packings:  # the first one is the packing that is refused
            monkeypatch.setattr(subprocesses, "time", SimpleNamespace(monotonic=lambda: 1e12))
        return place(*arguments, tick=tick, **more)

    monkeypatch.setattr(fill, "pack_charts", until_late)
    message = refused(scene(*box()), size=64, texel_density=100, unwrap_timeout=60)
    assert re.fullmatch(rf"texel_density is 100, for which 64 x 64 texels have no room; {advice}", message)


def test_a_page_without_room_for_all_charts_is_refused_in_plain_words():
    many = join(*(quad((3 * number, 0, 0), (1, 0, 0), (0, 1, 0)) for number in range(200)))
    made = scene(*many)
    with pytest.raises(ArgumentError) as error:
        unwrap(made, "xatlas", PageSpec(16, 2))
    assert str(error.value) == (
        "size is 16, but 200 charts with gutters of 2 texels do not fit 16 x 16 texels; use a larger one"
    )
