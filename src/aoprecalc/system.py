"""The machine that this process runs on: cores and memory within a container's limits, libraries, environment.

What systems do differently is here and in `subprocesses`; the rest of the package is the same everywhere.
"""

import os
import platform
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any

LIBRARIES = (
    "numpy", "scipy", "moderngl", "glcontext", "embreex", "trimesh", "xatlas", "uvunwrap", "OpenImageIO", "click",
    "jinja2", "mapbox_earcut", "msgspec", "numba", "opengl_decimate", "pillow", "pyyaml", "rich",
)  # fmt: skip
# The extras of the package and the libraries that each installs.
EXTRAS = {
    "compressed": ("DracoPy", "meshoptimizer"),
    "formats": ("lxml", "networkx", "pycollada"),
    "usd": ("usd-core",),
    "fbx": ("ufbx",),
    "cluster": ("distributed",),
}

_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{number}" for port in ("COM", "LPT") for number in range(1, 10))}

_CGROUP = Path("/sys/fs/cgroup")  # limits of the container (cgroup version 2)

# Environment variables that change how OpenGL drivers and the loader of libraries behave.
_PREFIXES = (
    "EGL_", "GALLIUM_", "GLCONTEXT_", "LIBGL_", "LP_", "MESA_", "NVIDIA_", "__EGL_", "__GLX_", "__NV_",
)  # fmt: skip
_VARIABLES = ("DISPLAY", "LD_LIBRARY_PATH", "LD_PRELOAD", "WAYLAND_DISPLAY")


def system_name() -> str:
    """Return the name of the operating system for messages: Linux, macOS, Windows ..."""
    return {"darwin": "macOS", "win32": "Windows"}.get(sys.platform) or platform.system()


def has_headless_opengl() -> bool:
    """Tell whether this system may have OpenGL without a display: macOS ends at 4.1, Windows has no EGL."""
    return sys.platform not in ("darwin", "win32")


def has_desktop() -> bool:
    """Tell whether there may be a desktop whose programs open files."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def usable_cores() -> float:
    """Return how many cores this process may use; a container may grant a fraction."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = _container_limit("cpu.max")  # microseconds of processor time, and the period that they are granted for
    return min(cores, round(int(quota[0]) / int(quota[1]), 2)) if quota else cores


def whole_cores() -> int:
    """Return the usable cores as a number of threads, at least 1."""
    return max(1, int(usable_cores()))


def usable_memory() -> int | None:
    """Return how many bytes of memory this process may use; None if the system does not tell."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    limit = _container_limit("memory.max")
    return min(memory, int(limit[0])) if limit else memory


def resident_memory() -> int | None:
    """Return how many bytes of memory this process holds; where the system tells only the most that it held, that.

    None where it tells neither.
    """
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, AttributeError):
        try:
            resource = import_module("resource")
        except ModuleNotFoundError:  # Windows
            return None
        peak: int = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else peak * 1024


def lock_file(file: IO[str]) -> None:
    """Lock a file until it is closed or this process ends; raises BlockingIOError if another process has locked it."""
    try:
        fcntl = import_module("fcntl")
    except ModuleNotFoundError:
        msvcrt = import_module("msvcrt")  # Windows
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(error.errno, error.strerror) from error
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def path_from(path: Path, folder: Path) -> str:
    """Return a path from a folder, with forward slashes; the absolute path where it is on another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(os.path.abspath(path)).as_posix()


def may_name_a_file(name: str) -> bool:
    """Tell whether files may have a name: Windows forbids some characters, and the names of its devices."""
    if sys.platform != "win32":
        return True
    device = name.partition(".")[0].rstrip().upper()
    return not (set(name) & set('<>:"|?*\\') or name.endswith((" ", ".")) or device in _DEVICES)


def machine() -> dict[str, Any]:
    """Return `python`, `platform`, usable `cores` (may be a fraction) and `memory` in bytes (None: unknown)."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": usable_cores(),
        "memory": usable_memory(),
    }


def versions(names: tuple[str, ...]) -> dict[str, str | None]:
    """Return the version of each package; None if it is not installed."""
    return {name: _version(name) for name in names}


def environment() -> dict[str, str]:
    """Return the environment variables that change how drivers and libraries are loaded, as far as they are set."""
    return {name: os.environ[name] for name in sorted(os.environ) if name in _VARIABLES or name.startswith(_PREFIXES)}


def _container_limit(name: str) -> list[str]:
    """Return the numbers of a cgroup limit; none if there is no such limit."""
    try:
        words = (_CGROUP / name).read_text(encoding="ascii").split()
    except OSError:
        return []
    return words if words and words[0] != "max" else []


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
