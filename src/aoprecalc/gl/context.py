"""Headless OpenGL: contexts (EGL, else OSMesa), the devices that EGL lists, shader programs, triangles for pictures."""

import ctypes
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import RendererError
from aoprecalc.system import has_headless_opengl, system_name
from aoprecalc.types import Float32Array, Float64Array, Int32Array

if TYPE_CHECKING:
    import moderngl  # in functions: it is installed on Linux only

VERSION = (4, 3)  # the first with compute shaders and storage buffers
LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
# The names that every installation has; those without a number belong to the development packages.
EGL_LIBRARY = "libEGL.so.1"
_EGL = {"backend": "egl", "libegl": EGL_LIBRARY, "libgl": "libGL.so.1"}
_MAX_DEVICES = 16
_PACKAGE = "aoprecalc.gl"

# How to install a software renderer, by system. conda-forge's Mesa has EGL from version 26.1.
INSTALLS = {
    "Debian, Ubuntu": "apt-get install libegl1 libgl1 libgl1-mesa-dri",
    "Fedora": "dnf install mesa-libEGL mesa-libGL mesa-dri-drivers",
    "conda": "conda install -c conda-forge libegl libgl mesa-llvmpipe",
}
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software", "swiftshader", "swr")  # in GL_RENDERER, in small letters
_ADVICE = "install a software renderer: " + ", ".join(f"`{line}` ({system})" for system, line in INSTALLS.items())


@dataclass(frozen=True)
class Candidate:
    """A way to make a context.

    kind     egl or osmesa
    device   the index of an EGL device, from 0; None for OSMesa
    """

    kind: str
    device: int | None = None

    @property
    def name(self) -> str:
        """The name for messages."""
        return "OSMesa" if self.device is None else f"EGL device {self.device}"


# In the order in which they are tried; few machines have as many devices.
CANDIDATES = (*(Candidate("egl", device) for device in range(_MAX_DEVICES)), Candidate("osmesa"))


@dataclass(frozen=True)
class Renderer:
    """An open OpenGL context.

    context   the moderngl context, current in the thread that opened it and bound to it
    kind      egl or osmesa
    name      GL_RENDERER, e.g. "llvmpipe (LLVM 15.0.6, 256 bits)"
    """

    context: "moderngl.Context"
    kind: str
    name: str

    @property
    def max_size(self) -> int:
        """The greatest width or height of a texture, in texels."""
        return int(self.context.info["GL_MAX_TEXTURE_SIZE"])


def is_software(renderer: str) -> bool:
    """Tell from GL_RENDERER whether a renderer runs on the processor."""
    return any(name in renderer.lower() for name in _SOFTWARE)


def opengl_problem() -> str | None:
    """Return why no context can be made here, whatever drivers there are, or None where one may be."""
    if not has_headless_opengl():
        return f"{system_name()} has none that works without a display"
    if find_spec("moderngl") is None:
        return "moderngl, which opens it, is not installed; `pip install moderngl`"
    return None


@contextmanager
def open_renderer(threads: int = 0) -> Iterator[Renderer]:
    """Open a context for the length of a `with` block; release it and everything made in it at the end.

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


def make_context(candidate: Candidate) -> "moderngl.Context":
    """Make the context of one candidate, of VERSION or later, current in this thread.

    Raises an exception of any kind, as glcontext raises bare ones for all its reasons. A broken driver may crash or
    hang the process.
    """
    if problem := opengl_problem():
        raise OSError(problem)
    import moderngl

    require = VERSION[0] * 100 + VERSION[1] * 10
    if candidate.kind == "osmesa":
        in_memory: Any = OSMesaContext(*VERSION)
        return moderngl.create_context(context=in_memory, require=require)
    settings: dict[str, Any] = {**_EGL, "device_index": candidate.device}
    return moderngl.create_context(standalone=True, require=require, **settings)


def _create() -> tuple["moderngl.Context", str]:
    if problem := opengl_problem():
        raise RendererError(f"no OpenGL {VERSION[0]}.{VERSION[1]}: {problem}")
    failures, exhausted = [], ""
    for candidate in CANDIDATES:
        if candidate.kind == exhausted:
            continue
        try:
            return make_context(candidate), candidate.kind
        except Exception as error:
            failures.append(f"{candidate.name}: {error}")
            if "found" in str(error) or "libEGL" in str(error) or "libGL" in str(error):
                exhausted = candidate.kind  # no such device, or no library: no higher index can work
    raise RendererError(f"no OpenGL {VERSION[0]}.{VERSION[1]} context could be made ({'; '.join(failures)}); {_ADVICE}")


def count_devices() -> int:
    """Return the number of EGL devices (EGL_EXT_device_enumeration), which glcontext does not tell.

    Raises OSError where there is no EGL, or one that cannot list them.
    """
    library = ctypes.CDLL(EGL_LIBRARY)
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        raise OSError(f"{EGL_LIBRARY} has no eglQueryDevicesEXT")
    # EGLBoolean eglQueryDevicesEXT(EGLint max_devices, EGLDeviceEXT *devices, EGLint *num_devices)
    prototype = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))
    count = ctypes.c_int()
    if not prototype(address)(0, None, ctypes.byref(count)):
        raise OSError(f"{EGL_LIBRARY} lists no devices")
    return count.value


# OSMesa: rendering in plain memory, for machines without EGL. Mesa removed it in version 25.1, where EGL on llvmpipe
# replaces it. moderngl takes any object with `load_opengl_function`; this one asks OSMesaGetProcAddress.

# From GL/osmesa.h and GL/gl.h
_FORMAT, _PROFILE, _CORE_PROFILE, _VERSION_MAJOR, _VERSION_MINOR = 0x22, 0x33, 0x34, 0x36, 0x37
_RGBA, _UNSIGNED_BYTE = 0x1908, 0x1401


class OSMesaContext:
    """A current OSMesa context of at least the given version, for rendering to framebuffer objects only."""

    def __init__(self, major: int, minor: int) -> None:
        """Create the context and make it current in this thread; raises OSError where that is not possible."""
        self._library = _load_osmesa()
        self._library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        self._library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_void_p] + [ctypes.c_int] * 3
        self._library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        self._library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        self._library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        attributes = [_FORMAT, _RGBA, _PROFILE, _CORE_PROFILE, _VERSION_MAJOR, major, _VERSION_MINOR, minor, 0]
        self._handle = self._library.OSMesaCreateContextAttribs((ctypes.c_int * len(attributes))(*attributes), None)
        if not self._handle:
            raise OSError(f"OSMesa offers no OpenGL {major}.{minor} core context")
        self._pixel = ctypes.create_string_buffer(4)  # OSMesa needs a window; nothing is drawn to it
        if not self._library.OSMesaMakeCurrent(self._handle, self._pixel, _UNSIGNED_BYTE, 1, 1):
            self.release()
            raise OSError("OSMesaMakeCurrent failed")

    def load_opengl_function(self, name: str) -> int:
        """Return the address of an OpenGL function, 0 if there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load = load_opengl_function  # moderngl uses both names

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


def _load_osmesa() -> ctypes.CDLL:
    for name in LIBRARIES:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise OSError("libOSMesa is not installed")


# Shader programs, from the `.glsl` files beside the code that uses them.

_HEADER = "#version 430 core\n"
_INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)


def shader_source(package: str, name: str, **constants: float | str) -> str:
    """Return the complete text of shader `name` in `package`.

    Adds the version line and a #define for each constant, and replaces each line `#include "x.glsl"` by that file,
    beside the shader or in this folder.
    """
    defines = "".join(f"#define {key} {value}\n" for key, value in constants.items())
    return _HEADER + defines + _read_shader(package, name)


def _read_shader(package: str, name: str) -> str:
    beside = files(package) / name
    text = (beside if beside.is_file() else files("aoprecalc.gl") / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda line: _read_shader(package, line[1]), text)


def draw_program(
    context: "moderngl.Context", package: str, vertex: str, fragment: str, **constants: float | str
) -> "moderngl.Program":
    """Compile a vertex and a fragment shader of `package` into a program."""
    return context.program(
        vertex_shader=shader_source(package, vertex, **constants),
        fragment_shader=shader_source(package, fragment, **constants),
    )


def compute_program(
    context: "moderngl.Context", package: str, name: str, **constants: float | str
) -> "moderngl.ComputeShader":
    """Compile a compute shader of `package`."""
    return context.compute_shader(shader_source(package, name, **constants))


# Triangles drawn for pictures: which one each sample sees, and where they keep light from the ground.


class TriangleDrawer:
    """The triangles of a mesh in an OpenGL context; both their sides are visible and cast shadows."""

    def __init__(self, renderer: Renderer, corners: Float32Array, casters: Float32Array) -> None:
        """Upload the triangles that are seen, (o, 3, 3) float32 corners, and those that cast shadows, (s, 3, 3)."""
        self._context = renderer.context
        self._corners, self._casters = (
            self._context.buffer(np.ascontiguousarray(triangles, np.float32)) for triangles in (corners, casters)
        )
        self.max_size = int(self._context.info["GL_MAX_TEXTURE_SIZE"])

    def visible(self, matrix: Float64Array, width: int, height: int) -> Int32Array:
        """Return the index of the triangle that each sample sees, (height, width) int32; -1 where there is none.

        matrix   (4, 4): from positions to clip space; row 0 is at y = -1

        A visibility buffer: C. Burns, W. Hunt, "The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading",
        Journal of Computer Graphics Techniques 2(2), 2013.
        """
        import moderngl

        program = draw_program(self._context, _PACKAGE, "visible.vert.glsl", "visible.frag.glsl")
        program["clip"] = tuple(matrix.T.ravel())
        indices = np.empty((height, width), np.int32)
        with self._drawing_to(indices, "i4", far=1.0):
            self._context.enable_only(moderngl.DEPTH_TEST)
            self._context.depth_func = "<"
            self._context.vertex_array(program, self._corners, "in_position").render(moderngl.TRIANGLES)
        indices -= 1
        return indices

    def count_shadows(self, directions: Float64Array, ground: float, window: Float64Array, size: int) -> Float32Array:
        """Return how many of the directions towards light are blocked at points of the ground, (size, size) float32.

        directions   (d, 3) unit vectors, y > 0
        ground       the height y of the ground
        window       x and z of the first corner of the square, and its side, (3,); rows along z, columns along x
        """
        import moderngl

        context = self._context
        program = draw_program(context, _PACKAGE, "shadow.vert.glsl", "shadow.frag.glsl")
        program["ground"] = ground
        program["window"] = tuple(window)
        shadows = context.vertex_array(program, self._casters, "in_position")
        counts = np.empty((size, size), np.float32)
        with self._drawing_to(counts, "f4", far=0.0):
            # Each direction is drawn at a depth of its own, nearer than all before: its first fragment in a pixel alone
            # passes the depth test, and counts.
            context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
            context.depth_func = ">"
            context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
            context.blend_func = moderngl.ONE, moderngl.ONE
            for number, direction in enumerate(directions):
                program["light"] = tuple(direction)
                program["depth"] = 2 * (number + 1) / (len(directions) + 1) - 1
                shadows.render(moderngl.TRIANGLES)
        return counts

    @contextmanager
    def _drawing_to(self, pixels: NDArray[Any], dtype: str, far: float) -> Iterator[None]:
        """Draw into a target of zeros with depths `far`; at the end read it into (h, w) pixels and free its memory."""
        size = pixels.shape[1], pixels.shape[0]
        target, depths = self._context.texture(size, 1, dtype=dtype), self._context.depth_renderbuffer(size)
        framebuffer = self._context.framebuffer([target], depths)
        framebuffer.use()
        framebuffer.clear(depth=far)
        yield
        target.read_into(pixels)
        del framebuffer, depths, target
        self._context.gc()
