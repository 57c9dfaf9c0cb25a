"""Both rasterizers, so that the same tests hold them to the same rules."""

from functools import partial

import pytest

from aoprecalc.raster.cpu_rasterizer import CPURasterizer


@pytest.fixture
def on_gl(renderer):
    """Makes a rasterizer of a layout that draws with OpenGL."""
    from aoprecalc.raster.gl_rasterizer import GLRasterizer  # needs moderngl, which is installed on Linux only

    return partial(GLRasterizer, renderer.context)


@pytest.fixture(params=["gl", "cpu"])
def rasterizer(request):
    """Makes a rasterizer of a layout: the test runs once with each kind."""
    return request.getfixturevalue("on_gl") if request.param == "gl" else CPURasterizer
