"""`--measure` printed keys without units, a fit with `--levels` only its finest level."""

from dataclasses import fields

import pytest

from aoprecalc.api.sphere_quality import MEASURES, SphereQuality
from pipeline.helpers import write_ring


@pytest.fixture
def ring(tmp_path):
    return write_ring(tmp_path / "ring.obj")


def test_measuring_prints_the_line_of_the_fit_and_then_words(ring, tmp_path, command):
    file = tmp_path / "set.json"
    fit = command("spheres", ring, "-n", "6", "-s", "500", "-o", file)
    done = command("spheres", ring, "--measure", file, "-s", "500")
    first, summary, *rows = done.stdout.splitlines()
    assert first == f"{file}  6 spheres"
    assert summary == fit.stdout.splitlines()[1]
    assert summary.startswith("silhouette IoU 0.")
    for row in rows:
        name, value, words = row.split(maxsplit=2)
        assert float(value) >= 0 or name == "area_bias"
        assert words == MEASURES[name]
    assert len(rows) > 10


def test_every_measure_has_words():
    assert list(MEASURES) == [field.name for field in fields(SphereQuality)]


def test_levels_are_counted_and_the_finest_is_measured(ring, tmp_path, command):
    file = tmp_path / "set.json"
    fit = command("spheres", ring, "--levels", "2,4,8", "-s", "500", "-o", file)
    assert fit.returncode == 0, fit.stderr
    assert fit.stdout.startswith(f"{file}  2, 4 and 8 spheres, ")
    done = command("spheres", ring, "--measure", file, "-s", "500")
    assert f"{file}: has levels of 2, 4 and 8 spheres; the finest is measured, 8 spheres\n" in done.stderr
    assert done.stdout.startswith(f"{file}  8 spheres\n")
