"""The pilot sample: a bake takes fewer directions where its texture is too coarse to show more."""

from functools import cache

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import prepare_bake
from aoprecalc.api.verify import measure_texture
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.options.bake import AUTO_DIRECTIONS
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import atlas_from_uvs, order_in_blocks
from aoprecalc.types import Texels
from aoprecalc.visibility import pilot
from aoprecalc.visibility.backend import RayBackend
from aoprecalc.visibility.directions import DirectionPlan
from aoprecalc.visibility.pilot import PilotErrors, _errors_of_blocks, _pilot_texels, enough_directions, pilot_errors
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from bake.test_projection import bumpy, plane
from shapes import join, quad, quad_uvs, scene

PLAN = DirectionPlan(AUTO_DIRECTIONS, True)
LEAST = 288  # nine groups of 16 axes
SIZE = 96
TOO_FINE, RESOLVED = (30, 0.02), (2, 0.1)  # waves of 3.2 and of 48 texels, and their height


@pytest.fixture(autouse=True)
def a_larger_share_of_small_textures(monkeypatch):
    monkeypatch.setattr(pilot, "_ONE_OF", 8)


@cache
def waves(count, height):
    """A square with waves, `count` a side; its texture spans it."""
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=240)
    uvs = positions[faces][..., :2]
    x, y = 2 * np.pi * count * positions[:, :2].T
    return scene(np.column_stack([positions[:, :2], height * np.sin(x) * np.sin(y)]), faces, uvs)


def setup_of(made, directions=None, **options):
    given = BakeOptions(**{"size": SIZE, "backend": "ray", **options})
    made = prepare_bake(made, given).scene
    atlas = atlas_from_uvs(made, made.uv_sets[0], np.ones(len(made.faces), bool))
    return BakeSetup(RayBackend(given.threads), BakeInputs(made, atlas, shading_normals(made), given, directions))


@cache
def measured(shape, directions=None):
    """The number of directions of a bake of waves, and the RMS error of its texture as rendered."""
    return measured_bake(waves(*shape), directions)


def measured_bake(made, directions=None, size=SIZE):
    options = BakeOptions(size=size, backend="ray", directions=directions, unwrap="keep")
    baked = bake_scene(made, options)
    prepared, rays = prepare_bake(baked.scene, options), VerifyOptions(points=4000, rays=576)
    errors = measure_texture(prepared, baked.atlas, baked.texture.values, rays, Progress(), value=ValueOptions())
    return baked.directions, errors.levels[0].rmse


@pytest.mark.parametrize(("shape", "count"), [(TOO_FINE, LEAST), ((12, 0.04), 2 * LEAST)])
def test_a_texture_that_is_too_coarse_takes_fewer_directions_and_is_as_good(shape, count):
    directions, error = measured(shape)
    assert directions == count
    assert error < 1.05 * measured(shape, AUTO_DIRECTIONS)[1]


def test_a_texture_that_shows_all_takes_all_directions():
    assert measured(RESOLVED)[0] == AUTO_DIRECTIONS


def errors_of(setup):
    (side,) = setup.sides
    return pilot_errors(setup, side)


@pytest.mark.parametrize("shape", [TOO_FINE, (12, 0.04)])
def test_the_error_of_the_resolution_is_that_of_a_bake_with_all_directions(shape):
    errors, (_, rendered) = errors_of(setup_of(waves(*shape))), measured(shape, AUTO_DIRECTIONS)
    assert 0.7 * rendered < errors.resolution < 1.4 * rendered


def test_the_error_of_sampling_is_that_of_the_directions():
    few, many = (measured(RESOLVED, count)[1] for count in (256, 2304))
    assert 0.5 * (few**2 - many**2) < errors_of(setup_of(waves(*RESOLVED))).sampling ** 2 < 4 * (few**2 - many**2)


def test_directions_are_enough_where_their_error_is_a_quarter_of_that_of_the_resolution():
    assert PilotErrors(0.04, 0.01, 256).enough(PLAN).count == LEAST
    assert PilotErrors(0.04, 0.02, 256).enough(PLAN).count == 864  # 256 * 2^(4/3) = 645, rounded up
    assert PilotErrors(0.04, 0.02, 256).enough(PLAN, random=True).count == AUTO_DIRECTIONS  # 256 * 2^2 = 1024
    assert PilotErrors(0.04, 0.0001, 256).enough(PLAN).count == LEAST


@pytest.mark.parametrize(("resolution", "sampling"), [(0.0, 0.01), (0.0, 0.0), (1e-7, 0.0), (0.1, 0.0), (1e-7, 1e-8)])
def test_nothing_found_is_no_reason_to_take_fewer_directions(resolution, sampling):
    assert PilotErrors(resolution, sampling, 256).enough(PLAN) == PLAN


def test_what_one_block_shows_decides_nothing():
    blocks, rng = np.repeat(np.arange(8), 100), np.random.default_rng(0)
    errors, weights = rng.normal(size=(2, len(blocks))), np.ones(len(blocks))
    assert _errors_of_blocks(*errors, weights, blocks) is not None
    assert _errors_of_blocks(*(errors * (blocks == 5)), weights, blocks) is None


def test_a_sure_quotient_of_errors_adds_nothing_to_that_of_sampling_seed_0():
    blocks, rng = np.repeat(np.arange(50), 100), np.random.default_rng(0)
    missed, weights = rng.normal(size=len(blocks)) * (1 + blocks / 25), rng.uniform(0.5, 1, len(blocks))
    resolution, sampling = _errors_of_blocks(missed, 0.5 * missed, weights, blocks)
    assert resolution == pytest.approx(np.sqrt(np.average(missed**2, weights=weights)))
    assert sampling == pytest.approx(0.5 * resolution)
    _, unsure = _errors_of_blocks(missed, rng.permutation(0.5 * missed), weights, blocks)
    assert unsure > 0.51 * resolution


def test_errors_count_by_the_area_of_the_surface():
    """Of waves on a ninth of the texture, beside a small open square on the rest."""
    cells = 120
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=cells)
    x, y = 2 * np.pi * 6 * positions[:, :2].T
    hills = np.column_stack([positions[:, :2], 0.03 * np.sin(x) * np.sin(y)])
    small = quad((5, 0, 0), (0.05, 0, 0), (0, 0.05, 0), cells=4)
    uvs = np.concatenate([positions[faces][..., :2] * 0.35, quad_uvs((0.37, 0), (1, 1), cells=4)])
    made = scene(*join((hills, faces), small), uvs)
    assert enough_directions(setup_of(made, size=192)) == PLAN
    _, rendered = measured_bake(made, AUTO_DIRECTIONS, size=192)
    assert 0.7 * rendered < errors_of(setup_of(made, size=192)).resolution < 1.4 * rendered


def test_a_small_texture_has_no_pilot_sample():
    assert errors_of(setup_of(waves(*TOO_FINE), size=48)) is None
    assert enough_directions(setup_of(waves(*TOO_FINE), size=48)) == PLAN


def test_details_on_few_texels_are_no_reason_to_take_fewer_directions():
    """All of them lie in one block of the pilot sample."""
    positions, faces = bumpy(0.05, 64, 8)
    details = ao.Mesh(positions * [0.085, 0.085, 0.1] + [0.096, 0.63, 0], faces, name="rock_high")
    low = ao.Mesh(*plane(), uvs=quad_uvs((0, 0), (1, 1)), name="rock_low")
    baked = ao.bake(low, ao.BakeOptions(size=128, backend="ray"), high=[details])
    assert baked.report.directions == AUTO_DIRECTIONS


@pytest.mark.parametrize("options", [{"two_sided": True}, {"bent_normals": True}, {"ground": True}])
def test_it_takes_fewer_directions_with_other_options_too(options):
    baked = bake_scene(waves(*TOO_FINE), BakeOptions(size=SIZE, backend="ray", **options))
    assert baked.directions < AUTO_DIRECTIONS


def test_the_most_demanding_side_decides(monkeypatch):
    two_sided = setup_of(waves(*TOO_FINE), two_sided=True)
    assert len(two_sided.sides) == 2
    coarse, fine = PilotErrors(0.04, 0.01, 256), PilotErrors(0.04, 0.02, 256)
    for errors, count in (((coarse, fine), 864), ((coarse, coarse), LEAST), ((coarse, None), AUTO_DIRECTIONS)):
        found = iter(errors)
        monkeypatch.setattr(pilot, "pilot_errors", lambda setup, side, found=found: next(found))
        assert enough_directions(two_sided).count == count


def test_a_setup_with_other_directions_is_one_made_with_them():
    made = waves(*RESOLVED)
    plan = DirectionPlan(LEAST, True)
    changed, anew = setup_of(made).with_directions(plan), setup_of(made, directions=plan)
    assert changed.inputs.directions == anew.inputs.directions == plan
    assert np.array_equal(changed.axes, anew.axes)
    assert changed.groups == anew.groups
    assert changed.interleaved


def test_the_pilot_sample_is_of_whole_blocks_all_over_the_texture():
    width, height = 300, 240
    texels = Texels(width, height, order_in_blocks(np.arange(width * height), width).astype(np.int32))
    rows, blocks = _pilot_texels(texels)
    assert (np.bincount(blocks) == 12 * 12).all()
    row, column = np.divmod(texels.index[rows], width)
    for block in range(blocks.max() + 1):
        of_block = blocks == block
        assert len({*zip(row[of_block] // 12, column[of_block] // 12, strict=True)}) == 1
    quarters = np.bincount(2 * (row >= height / 2) + (column >= width / 2), minlength=4) / len(rows)
    assert quarters.min() > 0.1


def test_threads_change_no_number_and_no_error():
    found = [errors_of(setup_of(waves(*TOO_FINE), threads=threads)) for threads in (1, 2)]
    assert found[0] == found[1]


def test_a_number_of_directions_is_taken_as_it_is():
    assert measured(TOO_FINE, AUTO_DIRECTIONS)[0] == AUTO_DIRECTIONS
