"""Sphere sets on disk."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.io.sphere_files import check_sphere_extension, read_sphere_set, write_sphere_set
from aoprecalc.types import SphereSet

SPHERES = SphereSet(
    centers=np.array([[0.1, -2, 1e-7], [1 / 3, 4e20, 0]]),
    radii=np.array([0.5, 2 / 3]),
    iterations=17,
    converged=True,
    method="lloyd",
    radius_rule="mean",
    samples=1000,
    seed=2**63 - 1,
)
QUALITY = {"radius_min": 0.5, "coverage": 0.25}
TEXT = """\
{
  "schema": 1,
  "spheres": [
    {"center": [0.1, -2.0, 1e-07], "radius": 0.5},
    {"center": [0.3333333333333333, 4e+20, 0.0], "radius": 0.6666666666666666}
  ],
  "method": "lloyd",
  "radius_rule": "mean",
  "samples": 1000,
  "seed": 9223372036854775807,
  "iterations": 17,
  "converged": true,
  "quality": {"radius_min": 0.5, "coverage": 0.25}
}
"""


def test_bytes(tmp_path):
    write_sphere_set(tmp_path / "a.json", SPHERES, QUALITY)
    assert (tmp_path / "a.json").read_bytes() == TEXT.encode()


def test_back_as_written(tmp_path):
    write_sphere_set(tmp_path / "a.JSON", SPHERES, QUALITY)
    back, quality = read_sphere_set(tmp_path / "a.JSON")
    assert quality == QUALITY
    for field in fields(SphereSet):
        assert np.array_equal(getattr(back, field.name), getattr(SPHERES, field.name)), field.name
    assert back.centers.dtype == back.radii.dtype == np.float64


@pytest.mark.parametrize("name", ["a.jsn", "a", "json", "a.json.gz"])
def test_other_extensions_are_refused(tmp_path, name):
    with pytest.raises(UsageError, match=r"written as \.json"):
        check_sphere_extension(tmp_path / name)
    with pytest.raises(UsageError, match=r"written as \.json"):
        write_sphere_set(tmp_path / name, SPHERES, QUALITY)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_json_lacks_are_refused(tmp_path, value):
    for spheres, quality in [
        (replace(SPHERES, radii=np.array([1, value])), QUALITY),
        (replace(SPHERES, centers=np.full((2, 3), value)), QUALITY),
        (SPHERES, {"inertia": float(value)}),
    ]:
        with pytest.raises(OutputError, match="not a finite number"):
            write_sphere_set(tmp_path / "a.json", spheres, quality)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_missing(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_sphere_set(tmp_path / "none" / "a.json", SPHERES, QUALITY)


def changed(**values):
    return json.dumps({**json.loads(TEXT), **values})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is not JSON"),
        ("\xff", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "schema None"),
        ("{}", "schema None"),
        (changed(schema=2), "schema 2, expected 1"),
        ('{"schema": 1}', "lacks 'spheres'"),
        (changed(spheres=[]), "at least one sphere"),
        (changed(spheres=3), "not a sphere set"),
        (changed(spheres=[{"center": [0, 0, 0]}]), "lacks 'radius'"),
        (changed(spheres=[{"center": [0, 0], "radius": 1}]), "at least one sphere, each with"),
        (changed(spheres=[{"center": [0, 0, 0], "radius": [1]}]), "at least one sphere, each with"),
        (changed(spheres=[{"center": [0, 0, "x"], "radius": 1}]), "not a sphere set"),
        (changed(spheres=[{"center": [0, 0, 0], "radius": -1}]), "finite radii >= 0"),
        (changed(spheres=[{"center": [0, 0, float("nan")], "radius": 1}]), "finite centers"),
        (changed(spheres=[{"center": [0, 0, 0], "radius": float("inf")}]), "finite radii"),
        (changed(iterations=None), "not a sphere set"),
        (changed(quality=[]), "not a sphere set"),
    ],
)
def test_what_is_no_sphere_set_is_refused(tmp_path, text, complaint):
    path = tmp_path / "a.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=complaint) as caught:
        read_sphere_set(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_sphere_set(tmp_path / "none.json")
