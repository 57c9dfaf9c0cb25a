"""What all tests share: a renderer that must be left clean, that Ctrl-C is heard, and the last words of a crash."""

import faulthandler
import inspect
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest

from aoprecalc.cli import main
from aoprecalc.gl.context import open_renderer
from aoprecalc.uv import unwrap as unwrapping
from shapes import MESHES

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in the background of a shell; programs would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

LAST_WORDS = pytest.StashKey()


@pytest.fixture
def renderer():
    """A renderer; the test fails if OpenGL reported an error in it."""
    with open_renderer() as renderer:
        yield renderer
        assert renderer.context.error == "GL_NO_ERROR"


ATLASES = {}


@pytest.fixture(scope="module", autouse=True)
def unwrap_each_mesh_once():
    """Give bakes in this process the UVs that an earlier one got for the same mesh: each unwrap starts a process."""
    unwrap = unwrapping.unwrap

    def remembered(scene, *settings, **more):
        more_settings = [value for name, value in more.items() if name != "cuts" and not callable(value)]
        arrays = scene.positions, scene.faces, scene.receives, *([] if scene.polygons is None else [scene.polygons])
        owners = [part.uv_owner for part in scene.parts]
        key = (*(array.tobytes() for array in arrays), *owners, *settings, *more_settings)
        if key not in ATLASES:
            ATLASES[key] = unwrap(scene, *settings, **more)
        return ATLASES[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unwrapping, "unwrap", remembered)
        yield


@pytest.fixture
def command(capsys, monkeypatch):
    """command(*words): what `aoprecalc` with these words does in this process, as if in one of its own."""

    def run(*words):
        words = list(map(str, words))
        monkeypatch.setattr(sys, "argv", ["aoprecalc", *words])
        handler = signal.getsignal(signal.SIGTERM)
        try:
            with pytest.raises(SystemExit) as ending:
                main(words)
        finally:
            signal.signal(signal.SIGTERM, handler)
        return subprocess.CompletedProcess(words, ending.value.code, *capsys.readouterr())

    return run


def pytest_collection_modifyitems(items):
    """Mark the tests that need OpenGL: they use the fixture above, or "gl" is one of their parameters.

    Tests marked `corpus` are skipped where their meshes are missing. Tests that name xatlas are skipped where it is not
    installed: PyPI has none for Python 3.14 or Linux on ARM.
    """
    has_xatlas = find_spec("xatlas") is not None
    for item in items:
        if not has_xatlas and "xatlas" in item.name + inspect.getsource(item.function):
            item.add_marker(pytest.mark.skip(reason="xatlas is not installed"))
        if item.get_closest_marker("corpus") and not MESHES.is_dir():
            item.add_marker(pytest.mark.skip(reason="the folder shared/meshes is not beside the repository"))
        parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
        if "renderer" in item.fixturenames or any(isinstance(value, str) and value == "gl" for value in parameters):
            item.add_marker("gl")


@pytest.hookimpl(trylast=True)  # after pytest has asked for stacks among the dots, where nobody finds them
def pytest_configure(config):
    """Have a worker of pytest-xdist keep its stacks in a file, should a driver crash it."""
    if hasattr(config, "workerinput"):
        kept = Path(config.workerinput["last_words"]) / config.workerinput["workerid"]
        config.stash[LAST_WORDS] = kept.open("w")  # open as long as the worker lives
        faulthandler.enable(config.stash[LAST_WORDS])
    else:
        config.stash[LAST_WORDS] = tempfile.TemporaryDirectory()
        config.add_cleanup(config.stash[LAST_WORDS].cleanup)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node):
    """Tell a worker where its stacks go."""
    node.workerinput["last_words"] = node.config.stash[LAST_WORDS].name


def pytest_terminal_summary(terminalreporter, config):
    """Show the stacks of workers that crashed; one that was killed from outside leaves none."""
    for kept in sorted(Path(config.stash[LAST_WORDS].name).iterdir()):
        if words := kept.read_text():
            terminalreporter.section(f"stacks of {kept.name}")
            of_ours = [line for line in words.splitlines() if "site-packages" not in line]
            terminalreporter.write_line("\n".join(of_ours))
