"""How one output file refers to another."""

import os
from pathlib import Path
from urllib.parse import quote


def relative_path(target: Path, file: Path) -> str:
    """Return the way to `target` from the folder of `file`, with forward slashes."""
    return Path(os.path.relpath(target, file.parent)).as_posix()


def relative_uri(target: Path, file: Path) -> str:
    """Return the same as a URI reference."""
    return quote(relative_path(target, file))
