"""A size beyond the renderer was told for meshes without UVs only; others ended in an error of OpenGL."""

import pytest

import aoprecalc as ao
from aoprecalc.errors import ArgumentError
from aoprecalc.gl.context import open_renderer
from aoprecalc.options import BakeOptions
from shapes import quad


@pytest.mark.gl
@pytest.mark.parametrize("backend", ["auto", "gl"])
@pytest.mark.parametrize("has_uvs", [True, False])
def test_a_size_beyond_the_renderer_is_told(backend, has_uvs):
    with open_renderer() as renderer:
        size = 2 * renderer.max_size
    if size > 32768:
        pytest.skip("the largest size of a bake is within the limits of this renderer")
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    mesh = ao.Mesh(positions, faces, uvs=positions[faces][..., :2] if has_uvs else None)
    with pytest.raises(ArgumentError, match=f"size is {size}, beyond this renderer"):
        ao.bake(mesh, BakeOptions(size=size, backend=backend))
