"""Sphere sets as JSON."""

import json
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.model import SphereSet

SCHEMA = 1
KINDS = (".json",)


def check_kind(path: Path) -> None:
    """Raise UsageError where a sphere set cannot be written to a file of this name; to be asked before the work."""
    if path.suffix.lower() not in KINDS:
        found = f"the extension {path.suffix}" if path.suffix else "no extension"
        raise UsageError(f"{path}: has {found}; sphere sets are written as {', '.join(KINDS)}, rename the output")


def write_sphere_set(path: Path, spheres: SphereSet, quality: dict[str, float]) -> None:
    """Write spheres, and what was measured about them, as a document of schema 1, one sphere a line.

        {"schema": 1, "spheres": [{"center": [x, y, z], "radius": r}, ...], "method", "radius_rule", "samples",
         "seed", "iterations", "converged", "quality": {...}}

    Numbers have the digits that give the same float64 back; the same values give the same bytes.
    Raises UsageError for another extension than .json, OutputError where a number is not finite (JSON has no such
    numbers) or the file cannot be written.
    """
    check_kind(path)
    try:
        text = _document(spheres, quality)
    except ValueError as error:
        raise OutputError(
            f"{path}: a centre, a radius or a quality is not a finite number; bring the mesh to a size near 1"
        ) from error
    try:
        path.write_bytes(text.encode())
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def read_sphere_set(path: Path) -> tuple[SphereSet, dict[str, float]]:
    """Read what `write_sphere_set` wrote.

    Raises InputError where the file is missing, is not such a document or holds a number that no sphere can have.
    """
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a sphere set") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON; expected a sphere set as `aoprecalc spheres` writes it") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path}: has the schema {schema!r}, expected {SCHEMA}; write it with `aoprecalc spheres`")
    try:
        spheres = SphereSet(
            centers=np.array([sphere["center"] for sphere in document["spheres"]], np.float64),
            radii=np.array([sphere["radius"] for sphere in document["spheres"]], np.float64),
            iterations=int(document["iterations"]),
            converged=bool(document["converged"]),
            method=str(document["method"]),
            radius_rule=str(document["radius_rule"]),
            samples=int(document["samples"]),
            seed=int(document["seed"]),
        )
        quality = {str(name): float(value) for name, value in document["quality"].items()}
    except KeyError as error:
        raise InputError(f"{path}: lacks {error}; write it again with `aoprecalc spheres`") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: is not a sphere set ({error}); write it with `aoprecalc spheres`") from error
    _check(path, spheres)
    return spheres, quality


def _document(spheres: SphereSet, quality: dict[str, float]) -> str:
    """Lay the document out; raises ValueError where a number is not finite."""
    rows = (
        {"center": center, "radius": radius}
        for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True)
    )
    facts = {
        "method": spheres.method,
        "radius_rule": spheres.radius_rule,
        "samples": spheres.samples,
        "seed": spheres.seed,
        "iterations": spheres.iterations,
        "converged": spheres.converged,
        "quality": quality,
    }
    lines = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in rows)
    rest = ",\n".join(f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in facts.items())
    return f'{{\n  "schema": {SCHEMA},\n  "spheres": [\n{lines}\n  ],\n{rest}\n}}\n'


def _check(path: Path, spheres: SphereSet) -> None:
    if spheres.centers.shape != (len(spheres), 3) or spheres.radii.ndim != 1 or len(spheres) == 0:
        raise InputError(f"{path}: expected at least one sphere, each with a center [x, y, z] and a radius")
    if not np.isfinite(spheres.centers).all() or not (np.isfinite(spheres.radii) & (spheres.radii >= 0)).all():
        raise InputError(f"{path}: expected finite centers and finite radii >= 0, found others; mend the file")
