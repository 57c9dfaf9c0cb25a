"""What all readers of sphere sets ask of a file: that it is there, and that its numbers are spheres."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.types import Float64Array, SphereSet


def source_bytes(path: Path) -> bytes:
    """Return what is in a file; raises InputError where it cannot be read."""
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


_SCHEMA = SCHEMAS["spheres"]

# Sphere sets as JSON: the spheres, how they were made and what was measured about them.


def sphere_document(spheres: SphereSet, quality: dict[str, float]) -> str:
    """Lay out spheres, and what was measured about them, as a document of schema 1, one sphere a line.

        {"schema": 1, "spheres": [{"center": [x, y, z], "radius": r}, ...], "method", "radius_rule", "samples",
         "seed", "iterations", "converged", "quality": {...}}

    With levels each sphere of a finer one has a "parent", the number of a sphere of the next coarser level; "levels"
    are [{"spheres": [...]}, ...], the coarsest first, without the finest, which is "spheres". "guarded" is there for
    the method algebraic.
    Raises ValueError where a number is not finite: JSON has no such numbers.
    """
    facts = {
        "method": spheres.method,
        "radius_rule": spheres.radius_rule,
        "samples": spheres.samples,
        "seed": spheres.seed,
        "iterations": spheres.iterations,
        "converged": spheres.converged,
        "quality": quality,
    }
    if spheres.method == "algebraic":
        facts["guarded"] = spheres.guarded
    if spheres.coarser is not None:
        facts["levels"] = [{"spheres": _rows(level)} for level in _coarser(spheres)]
    lines = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in _rows(spheres))
    rest = ",\n".join(f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in facts.items())
    return f'{{\n  "schema": {_SCHEMA},\n  "spheres": [\n{lines}\n  ],\n{rest}\n}}\n'


def _rows(spheres: SphereSet) -> list[dict[str, Any]]:
    """Return what the document holds of each sphere."""
    numbers = zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True)
    rows: list[dict[str, Any]] = [{"center": center, "radius": radius} for center, radius in numbers]
    if spheres.parents is not None:
        rows = [row | {"parent": parent} for row, parent in zip(rows, spheres.parents.tolist(), strict=True)]
    return rows


def _coarser(spheres: SphereSet) -> list[SphereSet]:
    """Return the levels above one, the coarsest first."""
    return [] if spheres.coarser is None else [*_coarser(spheres.coarser), spheres.coarser]


def quality_document(count: int, quality: dict[str, float]) -> str:
    """Lay out what was measured about `count` spheres: {"schema": 1, "spheres": count, "quality": {...}}."""
    return json.dumps({"schema": _SCHEMA, "spheres": count, "quality": quality}, indent=2, allow_nan=False) + "\n"


def read_sphere_set(path: Path) -> tuple[SphereSet, dict[str, float]]:
    """Read the whole of what `sphere_document` laid out, but for coarser levels.

    Raises InputError where the file is missing, is not such a document or holds a number that no sphere can have.
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
        raise _lacks(path, error) from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _is_none(path, error) from error
    check_spheres(path, centers, radii)
    return spheres, quality


def read_json(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, of the shapes that are in the file, unchecked.

    Raises InputError where the file is missing, is not JSON, has another schema or no "spheres" of numbers.
    """
    document = _load(path)
    _require_schema(path, document.get("schema", _SCHEMA))
    return _spheres(path, document)


def read_coarser(path: Path) -> list[tuple[Float64Array, Float64Array]]:
    """Read what `read_json` does of each of the coarser levels, the coarsest first; there may be none."""
    levels = _load(path).get("levels", [])
    if not (isinstance(levels, list) and all(isinstance(level, dict) for level in levels)):
        raise InputError(f'{path}: has "levels" that are no sphere sets; write it again with `aoprecalc spheres`')
    return [_spheres(path, level) for level in levels]


def _load(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(source_bytes(path))
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
        raise _lacks(path, error) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise _is_none(path, error) from error
    return centers, radii


def _lacks(path: Path, error: KeyError) -> InputError:
    return InputError(f"{path}: lacks {error}; write it again with `aoprecalc spheres`")


def _is_none(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: is not a sphere set ({error}); write it with `aoprecalc spheres`")
