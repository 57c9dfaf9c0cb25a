"""How all readers say that a file is damaged."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from aoprecalc.errors import InputError


def damaged(path: Path, found: str) -> InputError:
    """Return the error for a file in which `found` was found, which says what was expected as well."""
    return InputError(f"{path}: {found}; the file is damaged, export it again")


def check_indices(path: Path, indices: NDArray[Any], count: int) -> None:
    """Raise InputError unless all vertices that faces refer to are among the `count` that there are."""
    wrong = indices[(indices < 0) | (indices >= count)]
    if wrong.size:
        raise damaged(path, f"a face refers to vertex {wrong.flat[0]}, but there are {count} (counted from 0)")
