"""Which faces need UVs, and when the UVs of a file are on UDIM tiles."""

import numpy as np
import pytest

from aoprecalc.uv.checks import needs_uvs, surface_share
from aoprecalc.uv.tiles import udim_tiles
from shapes import quad, quad_uvs, scene


def plane(low=(0, 0), high=(1, 1)):
    return scene(*quad((0, 0, 0), (2, 0, 0), (0, 1, 0)), quad_uvs(low, high))


def test_the_faces_that_need_uvs_are_told_anew_each_time():
    made = plane()
    needs_uvs(made)[:] = False
    assert needs_uvs(made).all()


def test_the_share_of_faces_is_that_of_their_area():
    made = plane()
    assert surface_share(made, np.array([True, False])) == 0.5
    assert surface_share(made, np.zeros(2, bool)) == 0.0


@pytest.mark.parametrize("low", [(0, 0), (3, 1)])
def test_uvs_on_one_tile_are_on_none_and_nothing_is_rasterized(low):
    made = plane(low, (low[0] + 1, low[1] + 1))
    assert udim_tiles(lambda layout: pytest.fail("rasterized"), made, np.zeros(2, np.int64), 64, 64) == ()
