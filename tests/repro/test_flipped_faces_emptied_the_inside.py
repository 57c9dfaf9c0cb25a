"""Where faces of a closed mesh are turned round its winding says nothing, and columns through them held nothing."""

import numpy as np

from aoprecalc.spheres.sampling import VoxelGrid, inside_mesh
from shapes import ball


def test_a_ball_with_flipped_faces_has_the_same_inside():
    positions, faces = ball(3)
    flipped = faces.copy()
    some = np.random.default_rng(0).random(len(faces)) < 0.3
    flipped[some] = flipped[some, ::-1]
    grid = VoxelGrid.from_box(np.full(3, -1.0), np.full(3, 1.0), 32)
    np.testing.assert_array_equal(inside_mesh(positions, flipped, grid), inside_mesh(positions, faces, grid))
