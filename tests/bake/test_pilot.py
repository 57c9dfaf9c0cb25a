"""The pilot sample: a bake takes fewer directions where its texture is too coarse to show more."""

from functools import cache

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.prepared_scene import prepare_bake
from aoprecalc.api.verify import measure_texture
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.options.bake import AUTO_DIRECTIONS
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import atlas_from_uvs, order_in_blocks
from aoprecalc.types import Texels
from aoprecalc.visibility.backend import RayBackend
from aoprecalc.visibility.directions import DirectionPlan
from aoprecalc.visibility.pilot import PilotErrors, _pilot_texels, _resolution_error, enough_directions, pilot_errors
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from shapes import quad, scene

PLAN = DirectionPlan(AUTO_DIRECTIONS, True)
LEAST = 288  # nine groups of 16 axes
SIZE = 96
TOO_FINE, RESOLVED = (30, 0.02), (2, 0.1)  # waves of 3.2 and of 48 texels, and their height


@cache
def waves(count, height):
    """A square with waves, `count` a side; its texture spans it."""
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=240)
    uvs = positions[faces][..., :2]
    x, y = 2 * np.pi * count * positions[:, :2].T
    return scene(np.column_stack([positions[:, :2], height * np.sin(x) * np.sin(y)]), faces, uvs)


def setup_of(made, **options):
    given = BakeOptions(**{"size": SIZE, "backend": "ray", **options})
    atlas = atlas_from_uvs(made, made.uv_sets[0], np.ones(len(made.faces), bool))
    return BakeSetup(RayBackend(given.threads), BakeInputs(made, atlas, shading_normals(made), given))


@cache
def measured(shape, directions=None):
    """The number of directions of a bake of waves, and the RMS error of its texture as rendered."""
    options = BakeOptions(size=SIZE, backend="ray", directions=directions)
    baked = bake_scene(waves(*shape), options)
    prepared, rays = prepare_bake(baked.scene, options), VerifyOptions(points=10_000, rays=1024)
    errors = measure_texture(prepared, baked.atlas, baked.texture.values, rays, Progress(), value=ValueOptions())
    return baked.directions, errors.levels[0].rmse


def test_a_texture_that_is_too_coarse_takes_fewer_directions_and_is_as_good():
    directions, error = measured(TOO_FINE)
    assert directions == LEAST
    assert error < 1.05 * measured(TOO_FINE, AUTO_DIRECTIONS)[1]


def test_a_texture_that_shows_all_takes_all_directions():
    assert measured(RESOLVED)[0] == AUTO_DIRECTIONS


@pytest.mark.parametrize("shape", [TOO_FINE, (12, 0.04)])
def test_the_error_of_the_resolution_is_that_of_a_bake_with_all_directions(shape):
    errors, (_, rendered) = pilot_errors(setup_of(waves(*shape))), measured(shape, AUTO_DIRECTIONS)
    assert 0.7 * rendered < errors.resolution < 1.3 * rendered


def test_the_error_of_sampling_is_that_of_the_directions():
    setup = setup_of(waves(*RESOLVED), directions=256)
    few, many = (measured(RESOLVED, count)[1] for count in (256, 4096))
    assert 0.5 * (few**2 - many**2) < pilot_errors(setup).sampling ** 2 < 2.5 * (few**2 - many**2)


def test_directions_are_enough_where_their_error_is_a_quarter_of_that_of_the_resolution():
    assert PilotErrors(0.01, 256, 0.04).enough(PLAN).count == LEAST
    assert PilotErrors(0.02, 256, 0.04).enough(PLAN).count == 864  # 256 * 2^(4/3) = 645, rounded up
    assert PilotErrors(0.02, 256, 0.04).enough(PLAN, random=True).count == AUTO_DIRECTIONS  # 256 * 2^2 = 1024
    assert PilotErrors(0.0001, 256, 0.04).enough(PLAN).count == LEAST
    assert PilotErrors(0.0001, 256, 0.04).enough(DirectionPlan(100, True)).count == 100


def test_nothing_found_is_no_reason_to_take_fewer_directions():
    assert PilotErrors(0.01, 256, 0.0).enough(PLAN) == PilotErrors(0.0, 256, 0.0).enough(PLAN) == PLAN


def test_what_one_block_shows_does_not_count():
    blocks = np.repeat(np.arange(8), 144)
    local = np.tile(np.stack(np.divmod(np.arange(144), 12), axis=1) + 0.3, (8, 1)).astype(np.float32)
    rough = (np.random.default_rng(0).random(len(blocks)) > 0.5).astype(np.float32)
    everywhere, in_one = (
        _resolution_error(local, np.where(chosen, rough, np.float32(0)), np.ones(len(blocks)), blocks)
        for chosen in (blocks >= 0, blocks == 5)
    )
    assert everywhere > 0.1
    assert in_one < 1e-6


def test_a_small_texture_has_no_pilot_sample():
    assert pilot_errors(setup_of(waves(*TOO_FINE), size=48)) is None
    assert enough_directions(setup_of(waves(*TOO_FINE), size=48)) == PLAN


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
    found = [pilot_errors(setup_of(waves(*TOO_FINE), threads=threads)) for threads in (1, 2)]
    assert found[0] == found[1]


def test_a_number_of_directions_is_taken_as_it_is():
    assert measured(TOO_FINE, AUTO_DIRECTIONS)[0] == AUTO_DIRECTIONS
