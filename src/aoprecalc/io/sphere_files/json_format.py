"""Sphere sets as JSON: the spheres, how they were fitted and their quality; and the checks of all readers."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.types import Float64Array, SphereSet

_SCHEMA = SCHEMAS["spheres"]


def read_file(path: Path) -> bytes:
    """Return the bytes of a file; raises InputError where it cannot be read, also for devices and pipes."""
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file; expected a sphere set")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a sphere set") from error


def check_spheres(path: Path, centers: Float64Array, radii: Float64Array) -> None:
    """Raise InputError unless there are n >= 1 centers (n, 3) and radii (n,), all finite, no radius below 0."""
    if radii.ndim != 1 or len(radii) == 0 or centers.shape != (len(radii), 3):
        raise InputError(f"{path}: expected at least one sphere, each with a center [x, y, z] and a radius")
    if not np.isfinite(centers).all() or not (np.isfinite(radii) & (radii >= 0)).all():
        raise InputError(f"{path}: expected finite centers and finite radii >= 0, found others; mend the file")


def sphere_document(spheres: SphereSet, quality: dict[str, float]) -> str:
    """Return a sphere set and its quality as JSON of schema 1, one sphere a line.

        {"schema": 1, "spheres": [{"center": [x, y, z], "radius": r}, ...], "method", "radius_rule", "samples",
         "seed", "iterations", "converged", "quality": {...}}

    In a set with levels, each sphere has a "parent": the index of a sphere of the next coarser level. "levels" lists
    the coarser levels, the coarsest first, as [{"spheres": [...]}, ...]. The method algebraic adds "guarded".
    Raises ValueError where a number is not finite, which JSON cannot hold.
    """
    fields = {
        "method": spheres.method,
        "radius_rule": spheres.radius_rule,
        "samples": spheres.samples,
        "seed": spheres.seed,
        "iterations": spheres.iterations,
        "converged": spheres.converged,
        "quality": quality,
    }
    if spheres.method == "algebraic":
        fields["guarded"] = spheres.guarded
    if spheres.coarser is not None:
        fields["levels"] = [{"spheres": _rows(level)} for level in _coarser(spheres)]
    lines = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in _rows(spheres))
    other_lines = ",\n".join(f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in fields.items())
    return f'{{\n  "schema": {_SCHEMA},\n  "spheres": [\n{lines}\n  ],\n{other_lines}\n}}\n'


def _rows(spheres: SphereSet) -> list[dict[str, Any]]:
    """Return the JSON object of each sphere."""
    numbers = zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True)
    rows: list[dict[str, Any]] = [{"center": center, "radius": radius} for center, radius in numbers]
    if spheres.parents is not None:
        rows = [row | {"parent": parent} for row, parent in zip(rows, spheres.parents.tolist(), strict=True)]
    return rows


def _coarser(spheres: SphereSet) -> list[SphereSet]:
    """Return the coarser levels of a set, the coarsest first."""
    return [] if spheres.coarser is None else [*_coarser(spheres.coarser), spheres.coarser]


def quality_document(count: int, quality: dict[str, float]) -> str:
    """Return the quality of `count` spheres as JSON: {"schema": 1, "spheres": count, "quality": {...}}."""
    return json.dumps({"schema": _SCHEMA, "spheres": count, "quality": quality}, indent=2, allow_nan=False) + "\n"


def read_sphere_set(path: Path) -> tuple[SphereSet, dict[str, float]]:
    """Read a sphere set and its quality from JSON; coarser levels are left out.

    Raises InputError where the file is missing, is not a sphere set or holds an impossible sphere.
    """
    document = _load(path)
    _require_schema(path, document.get("schema"))
    centers, radii = _spheres(path, document)
    try:
        spheres = SphereSet(
            centers=centers,
            radii=radii,
            iterations=int(document["iterations"]),
            converged=bool(document["converged"]),
            method=str(document["method"]),
            radius_rule=str(document["radius_rule"]),
            samples=int(document["samples"]),
            seed=int(document["seed"]),
            guarded=int(document.get("guarded", 0)),
        )
        quality = {str(name): float(value) for name, value in document["quality"].items()}
    except KeyError as error:
        raise _missing_key(path, error) from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _not_a_sphere_set(path, error) from error
    check_spheres(path, centers, radii)
    return spheres, quality


def read_json(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked.

    Raises InputError where the file is missing, is not JSON, has another schema or no "spheres" of numbers.
    """
    document = _load(path)
    _require_schema(path, document.get("schema", _SCHEMA))
    return _spheres(path, document)


def read_coarser(path: Path) -> list[tuple[Float64Array, Float64Array]]:
    """Read (centers, radii) of each coarser level, unchecked, the coarsest first; there may be none."""
    levels = _load(path).get("levels", [])
    if not (isinstance(levels, list) and all(isinstance(level, dict) for level in levels)):
        raise InputError(f'{path}: has "levels" that are not sphere sets; write it again with `aoprecalc spheres`')
    return [_spheres(path, level) for level in levels]


def _load(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_file(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON; expected a sphere set as `aoprecalc spheres` writes it") from error
    return document if isinstance(document, dict) else {}


def _require_schema(path: Path, schema: object) -> None:
    if schema != _SCHEMA:
        raise InputError(
            f"{path}: has the schema {schema!r}, expected {SCHEMAS['spheres']}; write it with `aoprecalc spheres`"
        )


def _spheres(path: Path, document: dict[str, Any]) -> tuple[Float64Array, Float64Array]:
    try:
        centers = np.array([sphere["center"] for sphere in document["spheres"]], np.float64)
        radii = np.array([sphere["radius"] for sphere in document["spheres"]], np.float64)
    except KeyError as error:
        raise _missing_key(path, error) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise _not_a_sphere_set(path, error) from error
    return centers, radii


def _missing_key(path: Path, error: KeyError) -> InputError:
    return InputError(f"{path}: lacks {error}; write it again with `aoprecalc spheres`")


def _not_a_sphere_set(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: is not a sphere set ({error}); write it with `aoprecalc spheres`")
