"""A texture on overlapping UVs was verified: an alarming error, and no word about its cause."""

import numpy as np
import pytest

import aoprecalc as ao

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(("scale", "shift", "share"), [(1, 0, "100.0%"), (0.5, 0, "25.0%"), (0.5, 0.5, None)])
def test_the_share_of_the_texels_is_told(scale, shift, share):
    uvs = SQUARE[:, :2]
    pair = [0.5 * uvs + 0.5, scale * uvs] if shift else [uvs, scale * uvs]
    vertices = np.concatenate([SQUARE, SQUARE + (0, 0, 1)])
    mesh = ao.Mesh(vertices, np.concatenate([FACES, FACES + 4]), uvs=np.concatenate(pair), name="squares")
    given = ao.VerifyOptions(points=500, rays=64)
    warnings = ao.verify(mesh, np.ones((64, 64), np.float32), given).warnings
    expected = f"{share} of the texels lie inside two triangles: no texture can be right for both"
    assert [line.split(";")[0] for line in warnings] == ([expected] if share else [])
