"""With two directions a plane could lie edge-on to both and was said to cover no texels."""

import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from shapes import quad, scene


@pytest.mark.parametrize("plane", ["xy", "yz", "zx"])
def test_two_directions_are_enough_for_planes_along_the_axes(plane):
    x, y, z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    right, up = {"xy": (x, y), "yz": (y, z), "zx": (z, x)}[plane]
    texture = bake_scene(scene(*quad((0, 0, 0), right, up)), BakeOptions(width=16, height=16, directions=2)).texture
    assert (texture.values[texture.valid] == 1).all()
