"""An OpenGL context in plain memory through libOSMesa, for machines without EGL.

moderngl takes any object with `load_opengl_function`; this one asks OSMesaGetProcAddress.
Mesa removed OSMesa in version 25.1, where EGL on llvmpipe replaces it.
"""

import ctypes
from types import TracebackType
from typing import Self

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
