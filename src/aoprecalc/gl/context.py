"""An OpenGL context in plain memory through libOSMesa, for machines without EGL.

moderngl takes any object with `load_opengl_function`; this one asks OSMesaGetProcAddress.
Mesa removed OSMesa in version 25.1, where EGL on llvmpipe replaces it.
"""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import moderngl

from aoprecalc.errors import RendererError

LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")

# From GL/osmesa.h and GL/gl.h
_FORMAT, _PROFILE, _CORE_PROFILE, _VERSION_MAJOR, _VERSION_MINOR = 0x22, 0x33, 0x34, 0x36, 0x37
_RGBA, _UNSIGNED_BYTE = 0x1908, 0x1401


class OSMesaContext:
    """A current OSMesa context of at least the given version; drawing goes to framebuffer objects only."""

    def __init__(self, major: int, minor: int) -> None:
        """Create the context and make it current in this thread; raises OSError where that is not possible."""
        self._library = _load_library()
        self._library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        self._library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_void_p] + [ctypes.c_int] * 3
        self._library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        self._library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        self._library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        wanted = [_FORMAT, _RGBA, _PROFILE, _CORE_PROFILE, _VERSION_MAJOR, major, _VERSION_MINOR, minor, 0]
        self._handle = self._library.OSMesaCreateContextAttribs((ctypes.c_int * len(wanted))(*wanted), None)
        if not self._handle:
            raise OSError(f"OSMesa offers no OpenGL {major}.{minor} core context")
        self._pixel = ctypes.create_string_buffer(4)  # OSMesa wants a window; nothing is drawn to it
        if not self._library.OSMesaMakeCurrent(self._handle, self._pixel, _UNSIGNED_BYTE, 1, 1):
            self.release()
            raise OSError("OSMesaMakeCurrent failed")

    def load_opengl_function(self, name: str) -> int:
        """Address of an OpenGL function, 0 if there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load = load_opengl_function  # moderngl asks by either name

    def __enter__(self) -> Self:
        """Make current: it always is, in the one thread that made it."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave it current."""

    def release(self) -> None:
        """Destroy the context."""
        if self._handle:
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = None


def _load_library() -> ctypes.CDLL:
    for name in LIBRARIES:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise OSError("libOSMesa is not installed")


# A headless OpenGL context: EGL on whichever device works, else OSMesa.

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


# How many devices EGL knows of.


def count_devices() -> int:
    """Return the number of EGL's devices; raises OSError where there is no EGL, or one that cannot tell.

    glcontext, which takes a device's number, does not say how many there are. See EGL_EXT_device_enumeration.
    """
    library = ctypes.CDLL(EGL_LIBRARY)
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        raise OSError(f"{EGL_LIBRARY} has no eglQueryDevicesEXT")
    # EGLBoolean eglQueryDevicesEXT(EGLint max_devices, EGLDeviceEXT *devices, EGLint *num_devices)
    kind = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))
    count = ctypes.c_int()
    if not kind(address)(0, None, ctypes.byref(count)):
        raise OSError(f"{EGL_LIBRARY} lists no devices")
    return count.value
