"""What a result is, by the name of its file, and what is in it where several have one extension."""

from pathlib import Path
from typing import Literal

from aoprecalc.errors import InputError
from aoprecalc.files.meshes import READERS
from aoprecalc.files.reports import read_document

Kind = Literal["texture", "mesh", "spheres", "report"]


def kind_of(path: Path) -> Kind:
    """Return what a file is to hold: of .json what it does hold, of an extension that no other kind has a texture.

    Raises InputError for a .json that cannot be read, or holds neither a sphere set nor a report.
    """
    suffix = path.suffix.lower()
    if suffix.removeprefix(".") in READERS:
        return "mesh"
    if suffix in (".csv", ".npz"):
        return "spheres"
    if suffix != ".json":
        return "texture"
    document = read_document(path)
    if isinstance(document.get("spheres"), list):
        return "spheres"
    if "schema" not in document:
        raise InputError(f'{path}: has neither "spheres" nor a "schema"; a sphere set or a report was expected')
    return "report"
