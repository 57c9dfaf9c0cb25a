"""The machine and what is installed on it, as far as it matters to a bake; plain JSON values."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from aoprecalc.limits import usable_cores, usable_memory

LIBRARIES = (
    "numpy", "scipy", "moderngl", "glcontext", "trimesh", "xatlas", "uvunwrap", "OpenImageIO", "click", "rich",
)  # fmt: skip
# The extras of the package and what each brings.
EXTRAS = {"ray": ("embreex",), "compressed": ("DracoPy", "meshoptimizer"), "cluster": ("distributed",)}

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
