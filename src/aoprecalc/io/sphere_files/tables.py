"""Sphere sets as JSON, which tells how they were fitted, and as tables: CSV, NumPy archives, PLY points, YAML."""

import csv
import io
import json
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import InputError, counted, format_bytes
from aoprecalc.io.formats.ply_table import read_header, read_table
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.types import Float64Array, SphereSet

_SCHEMA = SCHEMAS["spheres"]


def read_file(path: Path) -> bytes:
    """Return the bytes of a file; raises InputError where it cannot be read, also for devices and pipes."""
    if os.path.exists(path) and not os.path.isfile(path):
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
    except TypeError as error:
        raise _not_a_sphere_set(path, "`spheres` is no list of spheres, each with a center and a radius") from error
    except (ValueError, OverflowError) as error:
        raise _not_a_sphere_set(path, error) from error
    return centers, radii


def _missing_key(path: Path, error: KeyError) -> InputError:
    return InputError(f"{path}: lacks {error}; write it again with `aoprecalc spheres`")


def _not_a_sphere_set(path: Path, error: Exception | str) -> InputError:
    return InputError(f"{path}: is not a sphere set ({error}); write it with `aoprecalc spheres`")


_MAX_SPHERES = 1_000_000  # in an archive, as in a fit
_MAX_MEMBER = _MAX_SPHERES * 3 * 16 + 4096  # bytes: three of the widest numbers of NumPy each, and the header

HEADER = ["x", "y", "z", "radius"]


def csv_table(spheres: SphereSet) -> str:
    """Return the spheres as CSV; lines end without a carriage return."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEADER)
    table.writerows(np.column_stack([spheres.centers, spheres.radii]).tolist())
    return text.getvalue()


def read_csv(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii), (n, 3) and (n,) float64, unchecked; n may be 0.

    Raises InputError where the file is missing, has another header or a row that is not four numbers.
    """
    data = read_file(path)
    try:
        table = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""))  # spreadsheets put a mark in front
        header = [name.strip() for name in next(table, [])]
        if header != HEADER:
            raise InputError(f"{path}: begins with {','.join(header)[:60]!a}, expected the header {','.join(HEADER)}")
        rows = []
        for row in table:
            if row and len(row) != len(HEADER):
                raise InputError(
                    f"{path}:{table.line_num}: has {counted(len(row), 'value')}, expected {len(HEADER)}; mend the file"
                )
            if row:
                rows.append([float(value) for value in row])
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path}: is not a table of numbers ({error}); mend the file") from error
    values = np.array(rows, np.float64).reshape(-1, len(HEADER))
    return values[:, :3], values[:, 3]


def npz_archive(spheres: SphereSet) -> bytes:
    """Return centers (n, 3) and radii (n,), float64, as the archive that np.savez writes.

    np.savez stores the current time; here it is the earliest that a ZIP can hold, so that equal sets give equal bytes.
    """
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as members:
        for name, values in (("centers", spheres.centers), ("radii", spheres.radii)):
            array = io.BytesIO()
            np.lib.format.write_array(array, np.ascontiguousarray(values, "<f8"), allow_pickle=False)
            members.writestr(zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0)), array.getvalue())
    return archive.getvalue()


def read_npz(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked.

    Raises InputError where the file is missing, is not such an archive, or its arrays are not of real numbers.
    """
    data = read_file(path)
    try:
        _refuse_large_members(path, data)
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = archive["centers"], archive["radii"]
    except KeyError as error:
        raise InputError(f"{path}: lacks an array ({error.args[0]}), expected centers and radii") from error
    except (ValueError, TypeError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: is not a NumPy archive of centers and radii ({error}); write it anew") from error
    for array in arrays:
        if array.dtype.kind not in "iuf":
            raise InputError(f"{path}: holds an array of {array.dtype}, expected real numbers; write it anew")
    centers, radii = arrays
    return centers.astype(np.float64), radii.astype(np.float64)


def _refuse_large_members(path: Path, data: bytes) -> None:
    """Raise InputError where an array is larger, unpacked, than any set needs: a small archive can hold a huge one."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for member in archive.infolist():
            if member.filename.removesuffix(".npy") in ("centers", "radii") and member.file_size > _MAX_MEMBER:
                found = f"{path}: {member.filename} in it has {format_bytes(member.file_size)} when unpacked"
                raise InputError(
                    f"{found}; at most {format_bytes(_MAX_MEMBER)} was expected, for {_MAX_SPHERES} spheres"
                )


PROPERTIES = ("x", "y", "z", "radius")


def ply_points(spheres: SphereSet) -> bytes:
    """Return the spheres as a binary PLY: one vertex a sphere, with four float64 properties."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(spheres)}",
        *(f"property double {name}" for name in PROPERTIES),
        "end_header\n",
    ]
    rows = np.column_stack([spheres.centers, spheres.radii]).astype("<f8")
    return "\n".join(header).encode() + rows.tobytes()


def read_ply_points(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked, from the vertices of a PLY, ASCII or binary.

    Raises InputError where the file is missing or damaged, or its vertices lack one of the properties.
    """
    data = read_file(path)
    try:
        header = read_header(path, data)
        tables = read_table(path, header.elements, header.body, header.order)
        columns = tables["vertex"].columns if "vertex" in tables else {}
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file provokes
        raise InputError(f"{path}: is not a PLY of spheres ({error}); write it anew") from error
    lacking = [name for name in PROPERTIES if name not in columns]
    if lacking:
        expected = ", ".join(PROPERTIES)
        raise InputError(f"{path}: its vertices lack {', '.join(lacking)}; expected {expected}, as of a sphere set")
    values = [np.asarray(columns[name], np.float64) for name in PROPERTIES]
    return np.column_stack(values[:3]), values[3]


# YAML of cuRobo's collision spheres.

_PLACES = ((), ("kinematics",), ("robot_cfg", "kinematics"))  # where robot files of cuRobo have "collision_spheres"


def curobo_yaml(spheres: SphereSet, link: str) -> str:
    """Return the YAML of cuRobo's collision spheres: all spheres belong to one link of the given name."""
    # Quoted, because a bare `12` or `no` is no string in YAML; a printable JSON string is a YAML string.
    lines = ["collision_spheres:", f"  {json.dumps(link, ensure_ascii=False)}:"]
    for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True):
        lines.append(f"    - center: [{', '.join(map(_number, center))}]")
        lines.append(f"      radius: {_number(radius)}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return the shortest digits of a float64; 1e-07 gets a point, without which YAML 1.1 reads it as a string."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")


def read_curobo_yaml(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked: the spheres of the one link that has any.

    Raises InputError where the file is missing or damaged, or where several links have spheres: each has its own
    coordinates.
    """
    document = _load_yaml(path, read_file(path))
    found: Any = None
    for place in _PLACES:
        table = document
        for key in place:
            table = table.get(key) if isinstance(table, dict) else None
        if found is None and isinstance(table, dict):
            found = table.get("collision_spheres")
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds no collision_spheres, a table of links and their spheres was expected")
    links = {name: rows for name, rows in found.items() if rows}
    if len(links) > 1:
        names = ", ".join(f"{str(name)[:40]!a}" for name in list(links)[:5]) + (", ..." if len(links) > 5 else "")
        raise InputError(
            f"{path}: {len(links)} links have spheres ({names}), each in its own coordinates; keep the one of the mesh"
        )
    try:
        rows = [row for rows in links.values() for row in rows]
        centers = np.array([[float(value) for value in row["center"]] for row in rows], np.float64)
        radii = np.array([float(row["radius"]) for row in rows], np.float64)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: a sphere has no center [x, y, z] and radius ({error}); mend the file") from error
    return centers, radii


def _load_yaml(path: Path, data: bytes) -> Any:
    """Return the document of a YAML file; aliases, which can make a small file huge, are refused."""
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("it has an alias (*name), which is not read")
            return super().compose_node(parent, index)

    try:
        return yaml.load(data, Loader)
    except Exception as error:  # for some values PyYAML raises KeyError, IndexError, AttributeError
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: cannot be read as YAML ({reason}); mend the file") from error
