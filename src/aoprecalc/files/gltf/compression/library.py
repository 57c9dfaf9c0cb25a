"""The packages that decode; they are extras, and loaded when a file needs them."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from aoprecalc.errors import InputError


def is_installed(package: str) -> bool:
    """Tell whether a package is there."""
    return find_spec(package) is not None


def load_library(path: Path, extension: str, package: str) -> ModuleType:
    """Return the package that decodes an extension; raises InputError, which names the file at `path`, without it."""
    needs = f"{path}: its meshes are compressed by {extension}, which needs the package {package}"
    if not is_installed(package):
        raise InputError(f"{needs}; `pip install 'aoprecalc[compressed]'`")
    try:
        return import_module(package)
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{needs}, but that cannot be loaded ({reason}); install it again") from error
