"""Contexts: OSMesa where EGL is missing, and what is said where neither is there."""

import ctypes
import subprocess
import sys

import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import RendererError, UsageError
from aoprecalc.gl import context
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.uv import unwrap as unwrapping
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.embree import casts_packets
from shapes import scene, torus

moderngl = pytest.importorskip("moderngl")  # installed on Linux only


def without_egl(monkeypatch):
    def no_library(*args, **given):
        raise Exception("libEGL.so.1: cannot open shared object file")

    real = moderngl.create_context
    monkeypatch.setattr(
        moderngl, "create_context", lambda **given: no_library() if "backend" in given else real(**given)
    )


def has_osmesa():
    for name in context.LIBRARIES:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


@pytest.mark.skipif(not has_osmesa(), reason="libOSMesa is not installed")
def test_osmesa_gives_the_same_bytes_as_egl(monkeypatch):
    made = scene(*torus(around=16, across=8))
    options = BakeOptions(width=64, height=64, directions=64)
    by_egl = bake_scene(made, options)
    without_egl(monkeypatch)
    with context.open_renderer() as renderer:
        assert renderer.kind == "osmesa"
    assert bake_scene(made, options).texture.values.tobytes() == by_egl.texture.values.tobytes()


def test_without_any_library_the_error_says_what_to_install(monkeypatch):
    without_egl(monkeypatch)
    monkeypatch.setattr(context, "LIBRARIES", ("libNoSuchThing.so",))
    advice = r"libEGL.*OSMesa: libOSMesa is not installed.*apt-get install"
    with pytest.raises(RendererError, match=advice), context.open_renderer():
        pass
    assert RendererError.exit_code == 3


@pytest.mark.parametrize(
    ("platform", "hidden", "expected"),
    [
        ("darwin", None, "no OpenGL 4.3: macOS has none that works without a display"),
        ("win32", None, "no OpenGL 4.3: Windows has none that works without a display"),
        ("linux", "moderngl", "no OpenGL 4.3: moderngl, which opens it, is not installed; `pip install moderngl`"),
    ],
)
def test_without_any_way_to_opengl_nothing_is_tried_and_rays_are_traced(platform, hidden, expected, monkeypatch):
    assert casts_packets()  # the answer is kept for the process: ask before the platform is replaced
    monkeypatch.setattr(sys, "platform", platform)
    if hidden:
        monkeypatch.setitem(sys.modules, hidden, None)
    with pytest.raises(RendererError) as raised, context.open_renderer():
        pass
    assert str(raised.value) == expected
    assert ray_notes(BakeOptions(directions=1000)) == [
        f"tracing rays instead of drawing depth maps, as there is {expected}"
    ]
    assert ray_notes(BakeOptions()) == []  # rays are faster than software OpenGL then


def ray_notes(options):
    notes = []

    class Heard(Progress):
        def note(self, text):
            notes.append(text)

    with open_backend(options, Heard()) as backend:
        assert backend.kind == "ray"
    return notes


def test_a_size_beyond_the_renderer_is_refused_before_anything_is_unwrapped(monkeypatch):
    monkeypatch.setattr(unwrapping, "unwrap", lambda *given: pytest.fail("unwrapped"))
    with context.open_renderer() as renderer:
        limit = renderer.context.info["GL_MAX_TEXTURE_SIZE"]
    with pytest.raises(UsageError, match=f"at most {limit} was expected"):
        bake_scene(scene(*torus(around=8, across=4)), BakeOptions(width=limit + 1))


def test_threads_are_passed_to_the_software_renderer():
    program = (
        "import os; from aoprecalc.gl.context import open_renderer\n"
        "with open_renderer(1): print(os.environ['LP_NUM_THREADS'])"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "1"
