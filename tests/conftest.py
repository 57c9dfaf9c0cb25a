"""What all tests share: a renderer that must be left clean, and that Ctrl-C is heard."""

import signal

import pytest

from aoprecalc.gl.context import open_renderer

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in the background of a shell; programs would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def renderer():
    """A renderer; the test fails if OpenGL reported an error in it."""
    with open_renderer() as renderer:
        yield renderer
        assert renderer.context.error == "GL_NO_ERROR"
