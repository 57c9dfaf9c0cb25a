"""Sphere sets on disk, as tables, as scenes and as JSON: reading, writing and the table of formats, SPHERE_FORMATS."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.io.sphere_files.scenes import (
    printable_name,
    read_balls,
    read_urdf,
    read_usda,
    spheres_glb,
    spheres_obj,
    urdf_robot,
    usda_stage,
)
from aoprecalc.io.sphere_files.tables import (
    check_spheres,
    csv_table,
    curobo_yaml,
    npz_archive,
    ply_points,
    quality_document,
    read_coarser,
    read_csv,
    read_curobo_yaml,
    read_json,
    read_npz,
    read_ply_points,
    read_sphere_set,
    sphere_document,
)
from aoprecalc.types import Float64Array, Scene, SphereSet

__all__ = [
    "SPHERE_EXTENSIONS",
    "SPHERE_FORMATS",
    "check_sphere_extension",
    "quality_document",
    "read_levels",
    "read_sphere_set",
    "read_spheres",
    "sphere_document",
    "write_sphere_set",
]

Spheres = tuple[Float64Array, Float64Array]  # centers (n, 3) and radii (n,)
Quality = dict[str, float]


@dataclass(frozen=True)
class SphereFormat:
    """A format of sphere sets.

    write   (spheres, quality, scene) -> the content of the file
    read    file -> (centers, radii), unchecked
    """

    write: Callable[[SphereSet, Quality, Scene | None], str | bytes]
    read: Callable[[Path], Spheres]


_CUROBO = SphereFormat(lambda spheres, quality, scene: curobo_yaml(spheres, printable_name(scene)), read_curobo_yaml)

SPHERE_FORMATS = {
    ".json": SphereFormat(lambda spheres, quality, scene: sphere_document(spheres, quality), read_json),
    ".csv": SphereFormat(lambda spheres, quality, scene: csv_table(spheres), read_csv),
    ".npz": SphereFormat(lambda spheres, quality, scene: npz_archive(spheres), read_npz),
    ".ply": SphereFormat(lambda spheres, quality, scene: ply_points(spheres), read_ply_points),
    ".obj": SphereFormat(lambda spheres, quality, scene: spheres_obj(spheres), read_balls),
    ".glb": SphereFormat(lambda spheres, quality, scene: spheres_glb(spheres, scene), read_balls),
    ".yml": _CUROBO,
    ".yaml": _CUROBO,
    ".urdf": SphereFormat(lambda spheres, quality, scene: urdf_robot(spheres, printable_name(scene)), read_urdf),
    ".usda": SphereFormat(lambda spheres, quality, scene: usda_stage(spheres, scene), read_usda),
}
SPHERE_EXTENSIONS = tuple(SPHERE_FORMATS)


def read_spheres(path: Path) -> Spheres:
    """Read (centers, radii), (n, 3) and (n,) float64, n >= 1, from a file of any of the formats.

    Files of other programs are read too: a JSON needs only "spheres", and its "schema" is checked where it has one; for
    the others see the readers.
    Raises InputError where the file is missing, has another extension, is damaged or holds an impossible sphere.
    """
    known = SPHERE_FORMATS.get(path.suffix.lower())
    if known is None:
        found = f"the extension {path.suffix}" if path.suffix else "no extension"
        known_extensions = ", ".join(SPHERE_EXTENSIONS)
        raise InputError(f"{path}: has {found}; spheres are read from {known_extensions}, write them as one of these")
    centers, radii = known.read(path)
    check_spheres(path, centers, radii)
    return centers, radii


def read_levels(path: Path) -> list[Spheres]:
    """Read (centers, radii) of every level of a set, the coarsest first; only .json holds more than one.

    Raises InputError as `read_spheres` does.
    """
    levels = read_coarser(path) if path.suffix.lower() == ".json" else []
    for centers, radii in levels:
        check_spheres(path, centers, radii)
    return [*levels, read_spheres(path)]


def check_sphere_extension(path: Path) -> None:
    """Raise UsageError where no format of sphere sets has the extension of `path`; to be called before the work."""
    if path.suffix.lower() not in SPHERE_FORMATS:
        found = f"the extension {path.suffix}" if path.suffix else "no extension"
        known = ", ".join(SPHERE_EXTENSIONS)
        raise UsageError(f"{path}: has {found}; sphere sets are written as {known}, rename the output")


def write_sphere_set(path: Path, spheres: SphereSet, quality: Quality, scene: Scene | None = None) -> None:
    """Write spheres in the format of the extension; only JSON also holds the quality.

    scene   the mesh that the spheres stand for: a .glb shows it, and links and prims have its name

    Numbers have the digits that give the same float64 back; the same values give the same bytes.
    Raises UsageError for an unknown extension, OutputError where a number is not finite (the mesh's positions in a .glb
    are float32) or the file cannot be written.
    """
    check_sphere_extension(path)
    try:
        _require_finite(spheres, quality)
        content = SPHERE_FORMATS[path.suffix.lower()].write(spheres, quality, scene)
    except ValueError as error:
        raise OutputError(
            f"{path}: a centre, a radius or a quality is not a finite number; bring the mesh to a size near 1"
        ) from error
    try:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def _require_finite(spheres: SphereSet, quality: Quality) -> None:
    """Raise ValueError where a number is not finite, in every format alike, for JSON cannot hold it."""
    json.dumps(quality, allow_nan=False)
    if not (np.isfinite(spheres.centers).all() and np.isfinite(spheres.radii).all()):
        raise ValueError("not a finite number")
