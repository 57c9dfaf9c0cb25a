"""Where outputs go: the paths that options name, made definite."""

import os
from os import PathLike
from pathlib import Path

from aoprecalc.files.atomic import Outputs


def output_place(wanted: str | PathLike[str] | None, default: str | Path) -> Path:
    """Return the file that an output option means.

    wanted    a file; a folder (existing, or ending in a slash), which takes the default's name; or None: the default
    default   a file name, or a path, relative to the current folder
    """
    if wanted is None:
        return Path(default)
    path = Path(wanted)
    return path / Path(default).name if path.is_dir() or _says_folder(wanted) else path


def claim(outputs: Outputs, wanted: str | PathLike[str] | None, place: Path) -> None:
    """Make sure, before long work, that the output `place`, which `wanted` means, can be written.

    Makes its folder where it is missing and `wanted` ends in a slash. Raises what Outputs.claim does.
    """
    if wanted is not None and _says_folder(wanted):
        outputs.folder(place.parent)
    outputs.claim(place)


def _says_folder(wanted: str | PathLike[str]) -> bool:
    return os.fspath(wanted).endswith(("/", os.sep))
