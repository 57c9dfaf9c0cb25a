"""How fine maps are that are left to `auto`."""

import numpy as np

from aoprecalc.types import Atlas
from aoprecalc.visibility.directions import MAX_SHADOW_SIZE, MIN_SHADOW_SIZE, auto_shadow_size
from shapes import quad, quad_uvs, scene

SQUARE = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad_uvs((0, 0), (1, 1)))
ATLAS = Atlas("keep", SQUARE.uvs, np.ones(2, bool), 1)


def size(texels, directions):
    return auto_shadow_size(SQUARE, ATLAS, texels**2, directions)


def test_maps_are_finer_than_the_texture_but_not_without_bounds():
    """Along nearly every axis the square's map is as wide as one of its sides or diagonals."""
    assert 1.25 * 1000 * 0.9 < size(1000, 1000) < 1.25 * 1000 * np.sqrt(2) + 128
    assert size(10, 1000) == MIN_SHADOW_SIZE
    assert size(30_000, 1000) == MAX_SHADOW_SIZE


def test_fewer_directions_deserve_coarser_maps_and_more_than_1000_no_finer_ones():
    sizes = [size(1000, directions) for directions in (128, 256, 512, 1000)]
    assert sizes == sorted(set(sizes))
    assert sizes[0] < 0.6 * sizes[-1]
    assert size(1000, 9000) == sizes[-1]
