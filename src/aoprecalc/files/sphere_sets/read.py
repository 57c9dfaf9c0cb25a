"""Reads the spheres of a set for measuring or comparing them, whatever made it."""

from pathlib import Path

from aoprecalc.errors import InputError
from aoprecalc.files.sphere_sets.csv_table import read_csv
from aoprecalc.files.sphere_sets.json_document import read_coarser, read_json
from aoprecalc.files.sphere_sets.npz import read_npz
from aoprecalc.files.sphere_sets.source import check_spheres
from aoprecalc.model import Doubles

_READERS = {".json": read_json, ".csv": read_csv, ".npz": read_npz}


def read_spheres(path: Path) -> tuple[Doubles, Doubles]:
    """Read (centers, radii), (n, 3) and (n,) float64, n >= 1, from .json, .csv or .npz.

    Of a JSON only its "spheres" count, and its "schema" where it has one.
    Raises InputError where the file is missing, has another extension, is not as `write_sphere_set` writes it or holds
    a number that no sphere can have.
    """
    read = _READERS.get(path.suffix.lower())
    if read is None:
        found = f"the extension {path.suffix}" if path.suffix else "no extension"
        raise InputError(
            f"{path}: has {found}; spheres are read from {', '.join(_READERS)}, write them as one of these"
        )
    centers, radii = read(path)
    check_spheres(path, centers, radii)
    return centers, radii


def read_levels(path: Path) -> list[tuple[Doubles, Doubles]]:
    """Read (centers, radii) of every level of a set, the coarsest first; only .json has more than one.

    Raises InputError as `read_spheres` does.
    """
    levels = read_coarser(path) if path.suffix.lower() == ".json" else []
    for centers, radii in levels:
        check_spheres(path, centers, radii)
    return [*levels, read_spheres(path)]
