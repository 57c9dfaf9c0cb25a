"""Reads the spheres of a set for measuring or comparing them, whatever made it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.io.sphere_files.json_format import check_spheres, read_coarser, read_json, sphere_document
from aoprecalc.io.sphere_files.scenes import (
    curobo_yaml,
    identifier,
    printable,
    spheres_glb,
    spheres_obj,
    urdf_robot,
    usda_stage,
)
from aoprecalc.io.sphere_files.tables import csv_table, npz_archive, ply_points, read_csv, read_npz
from aoprecalc.types import Float64Array, Scene, SphereSet

_READERS = {".json": read_json, ".csv": read_csv, ".npz": read_npz}


def read_spheres(path: Path) -> tuple[Float64Array, Float64Array]:
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


def read_levels(path: Path) -> list[tuple[Float64Array, Float64Array]]:
    """Read (centers, radii) of every level of a set, the coarsest first; only .json has more than one.

    Raises InputError as `read_spheres` does.
    """
    levels = read_coarser(path) if path.suffix.lower() == ".json" else []
    for centers, radii in levels:
        check_spheres(path, centers, radii)
    return [*levels, read_spheres(path)]


# Writes a sphere set in the format that the extension of its file names.

_FORMATS: dict[str, Callable[[SphereSet, dict[str, float], Scene | None], str | bytes]] = {
    ".json": lambda spheres, quality, scene: sphere_document(spheres, quality),
    ".csv": lambda spheres, quality, scene: csv_table(spheres),
    ".npz": lambda spheres, quality, scene: npz_archive(spheres),
    ".ply": lambda spheres, quality, scene: ply_points(spheres),
    ".obj": lambda spheres, quality, scene: spheres_obj(spheres),
    ".glb": lambda spheres, quality, scene: spheres_glb(spheres, scene),
    ".yml": lambda spheres, quality, scene: curobo_yaml(spheres, printable(scene)),
    ".yaml": lambda spheres, quality, scene: curobo_yaml(spheres, printable(scene)),
    ".urdf": lambda spheres, quality, scene: urdf_robot(spheres, printable(scene)),
    ".usda": lambda spheres, quality, scene: usda_stage(spheres, identifier(scene)),
}
SPHERE_EXTENSIONS = tuple(_FORMATS)


def check_sphere_extension(path: Path) -> None:
    """Raise UsageError where a sphere set cannot be written to a file of this name; to be asked before the work."""
    if path.suffix.lower() not in SPHERE_EXTENSIONS:
        found = f"the extension {path.suffix}" if path.suffix else "no extension"
        raise UsageError(
            f"{path}: has {found}; sphere sets are written as {', '.join(SPHERE_EXTENSIONS)}, rename the output"
        )


def write_sphere_set(path: Path, spheres: SphereSet, quality: dict[str, float], scene: Scene | None = None) -> None:
    """Write spheres in the format of the extension; only JSON also holds what was measured about them.

    scene   what they stand for: its mesh is shown in a .glb, its name given to links and prims

    Numbers have the digits that give the same float64 back; the same values give the same bytes.
    Raises UsageError for an unknown extension, OutputError where a number is not finite (the mesh's positions in a
    .glb are float32) or the file cannot be written.
    """
    check_sphere_extension(path)
    try:
        _require_finite(spheres, quality)
        content = _FORMATS[path.suffix.lower()](spheres, quality, scene)
    except ValueError as error:
        raise OutputError(
            f"{path}: a centre, a radius or a quality is not a finite number; bring the mesh to a size near 1"
        ) from error
    try:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def _require_finite(spheres: SphereSet, quality: dict[str, float]) -> None:
    """Raise ValueError where JSON could not hold a number, whatever the format: a set is fit for all or for none."""
    json.dumps(quality, allow_nan=False)
    if not (np.isfinite(spheres.centers).all() and np.isfinite(spheres.radii).all()):
        raise ValueError("not a finite number")
