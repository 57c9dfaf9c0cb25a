"""A headless OpenGL context: EGL on whichever device works, else OSMesa."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import moderngl

from aoprecalc.errors import RendererError
from aoprecalc.gl.osmesa import OSMesaContext

VERSION = (4, 3)  # the first with compute shaders and storage buffers
_MOST_DEVICES = 16
# By the names that every installation has; the plain ones belong to the development packages.
_EGL = {"backend": "egl", "libegl": "libEGL.so.1", "libgl": "libGL.so.1"}

_ADVICE = (
    "install a software renderer: `apt-get install libegl1 libgl1 libgl1-mesa-dri` (Debian, Ubuntu), "
    "`dnf install mesa-libEGL mesa-libGL mesa-dri-drivers` (Fedora)"
)


@dataclass(frozen=True)
class Renderer:
    """An OpenGL context and what it calls itself.

    context   the moderngl context, current in the thread that opened it and bound to it
    kind      egl or osmesa
    name      GL_RENDERER, e.g. "llvmpipe (LLVM 15.0.6, 256 bits)"
    """

    context: moderngl.Context
    kind: str
    name: str


@contextmanager
def open_renderer(threads: int = 0) -> Iterator[Renderer]:
    """Open a context for the length of a `with` block and release everything made in it at the end.

    threads: for software rendering; 0 is all cores.
    Raises RendererError, with what was tried and what to install, where no context of VERSION can be made.
    """
    if threads:
        os.environ["LP_NUM_THREADS"] = str(threads)  # llvmpipe reads it when its first context is made
    context, kind = _create()
    context.gc_mode = "context_gc"
    try:
        yield Renderer(context, kind, context.info["GL_RENDERER"])
    finally:
        context.gc()
        context.release()


def _create() -> tuple[moderngl.Context, str]:
    require = VERSION[0] * 100 + VERSION[1] * 10
    failures = []
    for device in range(_MOST_DEVICES):
        try:
            settings: dict[str, Any] = {**_EGL, "device_index": device}
            return moderngl.create_context(standalone=True, require=require, **settings), "egl"
        except Exception as error:  # glcontext raises bare Exception for all its reasons
            failures.append(f"EGL device {device}: {error}")
            if "found" in str(error) or "libEGL" in str(error) or "libGL" in str(error):
                break  # no such device, or no library: the next index fares no better
    try:
        memory: Any = OSMesaContext(*VERSION)
        return moderngl.create_context(context=memory, require=require), "osmesa"
    except Exception as error:
        failures.append(f"OSMesa: {error}")
    raise RendererError(f"no OpenGL {VERSION[0]}.{VERSION[1]} context could be made ({'; '.join(failures)}); {_ADVICE}")
