"""`compare` counted padding and fill: a root mean square of 0.026 where the surface's own texels differed by 0.014."""

import numpy as np
import pytest

import aoprecalc as ao
from shapes import torus


@pytest.fixture(scope="module")
def bakes(tmp_path_factory):
    """The folder with three bakes of a ring: but for `c`, they differ in padding and fill alone."""
    folder, mesh = tmp_path_factory.mktemp("bakes"), ao.Mesh(*torus(around=24, across=12), name="ring")
    for name, padding, fill, directions in (("a", 8, "mean", 128), ("b", 0, "none", 128), ("c", 0, "none", 16)):
        options = ao.BakeOptions(size=64, directions=directions, backend="ray", padding=padding, fill=fill)
        result = ao.bake(mesh, options)
        result.save(folder / f"{name}_ao.png", mesh_output=folder / f"{name}_ao.glb")
        np.save(folder / f"{name}.npy", result.valid)
    return folder


def test_texels_beside_the_surface_do_not_count(bakes):
    report = ao.compare(bakes / "a_ao.png", bakes / "b_ao.png")
    surface, picture = report.details["surface"], report.details["picture"]
    assert (report.answer, report.difference, surface["rms"]) == ("near", 0, 0)
    assert picture["rms"] > 0.2


def test_what_counts_is_the_error_of_the_texels_that_were_measured(bakes):
    report = ao.compare(bakes / "a_ao.png", bakes / "c_ao.png")
    values = [np.asarray(picture(bakes / f"{name}_ao.png"), float) for name in "ac"]
    valid = np.load(bakes / "a.npy") & np.load(bakes / "c.npy")
    expected = np.sqrt(np.mean((values[1] - values[0])[valid] ** 2)) / 255
    assert report.difference == pytest.approx(expected, rel=1e-3)
    assert report.details["surface"]["texels"] == pytest.approx(np.count_nonzero(valid), rel=1e-2)
    meshes = ao.compare(bakes / "a_ao.glb", bakes / "c_ao.glb")
    assert meshes.details["texture"] == report.details


def picture(path):
    from PIL import Image

    return Image.open(path)
