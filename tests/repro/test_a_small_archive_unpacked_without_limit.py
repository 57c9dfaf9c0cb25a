"""An NPZ of a few kilobytes could hold arrays of any size, all of which was unpacked into memory."""

import io
import zipfile

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io.sphere_files import read_spheres


def archive(path, **sizes):
    """An NPZ with float64 arrays of zeros of these numbers of rows; of "centers" three numbers a row."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as members:
        for name, rows in sizes.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, np.zeros((rows, 3) if name == "centers" else rows))
            members.writestr(f"{name}.npy", array.getvalue())
    return path


@pytest.mark.parametrize("sizes", [{"centers": 2_100_000, "radii": 1}, {"centers": 1, "radii": 6_100_000}], ids=str)
def test_what_is_too_large_is_not_unpacked(sizes, tmp_path, monkeypatch):
    monkeypatch.setattr(np, "load", None)  # calling it would fail
    path = archive(tmp_path / "bomb.npz", **sizes)
    assert path.stat().st_size < 100_000
    with pytest.raises(InputError, match=r"when unpacked; at most 45.8M was expected, for 1000000 spheres"):
        read_spheres(path)


def test_a_million_spheres_are_read(tmp_path):
    centers, radii = read_spheres(archive(tmp_path / "many.npz", centers=1_000_000, radii=1_000_000))
    assert (centers.shape, radii.shape) == ((1_000_000, 3), (1_000_000,))
