"""What all tests share: a renderer that must be left clean."""

import pytest

from aoprecalc.gl.context import open_renderer


@pytest.fixture
def renderer():
    """A renderer; the test fails if OpenGL reported an error in it."""
    with open_renderer() as renderer:
        yield renderer
        assert renderer.context.error == "GL_NO_ERROR"
