"""Sphere sets as NumPy archives: the arrays centers and radii."""

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.files.sphere_sets.source import source_bytes
from aoprecalc.model import Doubles, SphereSet


def npz_archive(spheres: SphereSet) -> bytes:
    """Pack centers (n, 3) and radii (n,), float64, as np.savez does.

    np.savez leaves the time in the archive to zipfile; here it is fixed, at the least that a ZIP can hold.
    """
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as members:
        for name, values in (("centers", spheres.centers), ("radii", spheres.radii)):
            array = io.BytesIO()
            np.lib.format.write_array(array, np.ascontiguousarray(values, "<f8"), allow_pickle=False)
            members.writestr(zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0)), array.getvalue())
    return archive.getvalue()


def read_npz(path: Path) -> tuple[Doubles, Doubles]:
    """Read (centers, radii) as float64, of the shapes that are in the file, unchecked.

    Raises InputError where the file is missing, is no such archive, or its arrays are not of real numbers.
    """
    data = source_bytes(path)
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
