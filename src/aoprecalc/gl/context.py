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
EGL_LIBRARY = "libEGL.so.1"
_EGL = {"backend": "egl", "libegl": EGL_LIBRARY, "libgl": "libGL.so.1"}

# What installs a software renderer, by system.
INSTALLS = {
    "Debian, Ubuntu": "apt-get install libegl1 libgl1 libgl1-mesa-dri",
    "Fedora": "dnf install mesa-libEGL mesa-libGL mesa-dri-drivers",
}
_ADVICE = "install a software renderer: " + ", ".join(f"`{line}` ({system})" for system, line in INSTALLS.items())


@dataclass(frozen=True)
class Candidate:
    """What may give a context.

    kind     egl or osmesa
    device   the number of an EGL device, from 0; None for OSMesa
    """

    kind: str
    device: int | None = None

    @property
    def name(self) -> str:
        """What people call it."""
        return "OSMesa" if self.device is None else f"EGL device {self.device}"


# In the order in which they are tried; there are rarely as many devices.
CANDIDATES = (*(Candidate("egl", device) for device in range(_MOST_DEVICES)), Candidate("osmesa"))


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


def make_context(candidate: Candidate) -> moderngl.Context:
    """Make the context of one candidate, of VERSION or later, current in this thread.

    Raises an exception of any kind, as glcontext raises bare ones for all its reasons. A broken driver may crash the
    process, or hang it.
    """
    require = VERSION[0] * 100 + VERSION[1] * 10
    if candidate.kind == "osmesa":
        memory: Any = OSMesaContext(*VERSION)
        return moderngl.create_context(context=memory, require=require)
    settings: dict[str, Any] = {**_EGL, "device_index": candidate.device}
    return moderngl.create_context(standalone=True, require=require, **settings)


def _create() -> tuple[moderngl.Context, str]:
    failures, given_up = [], ""
    for candidate in CANDIDATES:
        if candidate.kind == given_up:
            continue
        try:
            return make_context(candidate), candidate.kind
        except Exception as error:
            failures.append(f"{candidate.name}: {error}")
            if "found" in str(error) or "libEGL" in str(error) or "libGL" in str(error):
                given_up = candidate.kind  # no such device, or no library: the next index fares no better
    raise RendererError(f"no OpenGL {VERSION[0]}.{VERSION[1]} context could be made ({'; '.join(failures)}); {_ADVICE}")
