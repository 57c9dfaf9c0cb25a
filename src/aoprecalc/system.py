"""How many cores and how much memory this process may use; a container's limits count."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_CGROUP = Path("/sys/fs/cgroup")  # what the container that this runs in may use (version 2)


def usable_cores() -> float:
    """Return how many cores may be used, perhaps a fraction."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = _limit("cpu.max")  # "max 100000", or microseconds that may be used in so many
    return min(cores, round(int(quota[0]) / int(quota[1]), 2)) if quota else cores


def whole_cores() -> int:
    """Return the same as a number of threads, at least 1."""
    return max(1, int(usable_cores()))


def usable_memory() -> int | None:
    """Return how many bytes of memory may be used; None where the system does not tell."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    limit = _limit("memory.max")
    return min(memory, int(limit[0])) if limit else memory


def _limit(name: str) -> list[str]:
    """Return the numbers of a limit of the container; none where there is no such limit."""
    try:
        words = (_CGROUP / name).read_text(encoding="ascii").split()
    except OSError:
        return []
    return words if words and words[0] != "max" else []


# The machine and what is installed on it, as far as it matters to a bake; plain JSON values.

LIBRARIES = (
    "numpy", "scipy", "moderngl", "glcontext", "trimesh", "xatlas", "uvunwrap", "OpenImageIO", "click", "msgspec",
    "rich",
)  # fmt: skip
# The extras of the package and what each brings.
EXTRAS = {
    "ray": ("embreex",),
    "compressed": ("DracoPy", "meshoptimizer"),
    "formats": ("lxml", "networkx", "pycollada"),
    "cluster": ("distributed",),
}

# Variables that steer the drivers and the loaders of libraries.
_STARTS = ("EGL_", "GALLIUM_", "GLCONTEXT_", "LIBGL_", "LP_", "MESA_", "NVIDIA_", "__EGL_", "__GLX_", "__NV_")
_NAMES = ("DISPLAY", "LD_LIBRARY_PATH", "LD_PRELOAD", "WAYLAND_DISPLAY")


def machine() -> dict[str, Any]:
    """Return `python`, `platform`, `cores` that may be used, and `memory` in bytes (None where it is not known).

    A container's limits count: `cores` may then be a fraction.
    """
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": usable_cores(),
        "memory": usable_memory(),
    }


def versions(names: tuple[str, ...]) -> dict[str, str | None]:
    """Return the version of each package, None where it is not installed."""
    return {name: _version(name) for name in names}


def environment() -> dict[str, str]:
    """Return the variables that are set and that steer what a bake runs on."""
    return {name: os.environ[name] for name in sorted(os.environ) if name in _NAMES or name.startswith(_STARTS)}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
