"""Sphere sets as CSV: one row a sphere under the header x,y,z,radius."""

import csv
import io
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.files.sphere_sets.source import source_bytes
from aoprecalc.model import Doubles, SphereSet

HEADER = ["x", "y", "z", "radius"]


def csv_table(spheres: SphereSet) -> str:
    """Lay the table out, without a carriage return at the ends of its lines."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEADER)
    table.writerows(np.column_stack([spheres.centers, spheres.radii]).tolist())
    return text.getvalue()


def read_csv(path: Path) -> tuple[Doubles, Doubles]:
    """Read (centers, radii), (n, 3) and (n,) float64, unchecked; n may be 0.

    Raises InputError where the file is missing, has another header or a row that is not four numbers.
    """
    data = source_bytes(path)
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
