"""A face without area had the normal (0, 0, 1) and so made a smooth edge hard, depending on how the mesh was turned."""

import numpy as np
import pytest

from aoprecalc.mesh.surface import shading_normals
from shapes import scene


@pytest.mark.parametrize("turn", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_a_sliver_on_an_edge_keeps_it_smooth(turn):
    positions = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0.2), (-1, 0, 0.2), (0, 0.5, 0)], float)[:, list(turn)]
    faces = [[0, 2, 1], [0, 1, 4], [0, 4, 3], [4, 1, 3]]
    normals = shading_normals(scene(positions, faces), "smooth", 40)
    at_first = normals[np.array(faces) == 0]
    assert np.allclose(at_first, at_first[0], atol=1e-6)
