"""An atlas of UVs as they are: what leaves the page, and how many charts there are."""

import numpy as np
import pytest

from aoprecalc.raster.layout import atlas_from_uvs
from shapes import join, quad, quad_uvs, scene


@pytest.mark.parametrize(("beyond", "repeats"), [(0.0, False), (5e-7, False), (1e-5, True), (1.0, True)])
@pytest.mark.parametrize("side", [1, -1])
def test_uvs_leave_the_page_by_more_than_rounding_only(side, beyond, repeats):
    uvs = quad_uvs((0, 0), (1, 1)) + side * np.array([beyond, 0.0])
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), uvs)
    assert atlas_from_uvs(made, uvs, np.ones(2, bool)).repeats == repeats


def test_only_the_faces_that_count_make_charts_and_leave_the_page():
    floors = [quad((0, 0, height), (1, 0, 0), (0, 1, 0)) for height in range(3)]
    uvs = np.concatenate(
        [quad_uvs((0.1 + 0.3 * n, 0.1), (0.3 + 0.3 * n, 0.3)) for n in range(2)] + [quad_uvs((5, 5), (6, 6))]
    )
    made = scene(*join(*floors), uvs)
    mapped = np.arange(6) < 4
    atlas = atlas_from_uvs(made, uvs, mapped)
    assert (atlas.charts, atlas.repeats) == (2, False)
    assert (atlas_from_uvs(made, uvs, ~mapped).charts, atlas_from_uvs(made, uvs, ~mapped).repeats) == (1, True)
