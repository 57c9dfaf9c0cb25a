"""The Z-order curve in two and three dimensions."""

import numpy as np

from aoprecalc.raster.layout import morton_codes


def test_the_first_sixteen_squares_make_four_zs():
    cells = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (3, 0), (2, 1), (3, 1), (0, 2), (1, 2), (0, 3), (1, 3)])
    assert morton_codes(cells).tolist() == list(range(12))


def test_every_cell_of_a_cube_has_a_place_of_its_own():
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3), axis=-1).reshape(-1, 3)
    assert np.sort(morton_codes(cells)).tolist() == list(range(512))
    assert morton_codes(np.array([[4095, 4095, 4095]]))[0] == 2**36 - 1
