"""Sphere sets as tables: CSV (x,y,z,radius), NumPy archives (centers, radii) and PLY points (x, y, z, radius)."""

import csv
import io
import zipfile
import zlib
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.sphere_files.json_format import read_file
from aoprecalc.types import Float64Array, SphereSet

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
                    f"{path}:{table.line_num}: has {len(row)} values, expected {len(HEADER)}; mend the file"
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

    Raises InputError where the file is missing, is no such archive, or its arrays are not of real numbers.
    """
    data = read_file(path)
    try:
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
