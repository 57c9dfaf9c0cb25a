"""`--max-error` and the certificates that `verify` confirms: lines and exit codes."""

import json

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.io import read_image, write_image
from aoprecalc.io.images import read_text
from shapes import torus

BAKE = ("--size", 64, "--backend", "ray", "-o", "out.png")
VERIFY = ("--points", 500, "--rays", 64)


@pytest.fixture
def ring(tmp_path):
    ao.bake(ao.Mesh(*torus(around=24, across=12)), ao.BakeOptions(size=64, directions=2, backend="ray")).save(
        tmp_path / "x.png", mesh_output=tmp_path / "ring.obj"
    )
    return tmp_path


def test_it_is_certain_and_confirmed(ring, run):
    done = run(ring, "bake", "ring.obj", *BAKE, "--max-error", 0.05, "--report", "out.json")
    assert done.returncode == 0, done.stderr
    certificate = json.loads((ring / "out.json").read_text())["certificate"]
    assert certificate["certified"]
    assert f"as rendered, RMS error at most {certificate['bound']:.4g} with 95% confidence" in done.stdout
    done = run(ring, "verify", "out.obj", *VERIFY)
    assert done.returncode == 0, done.stderr
    assert "certificate confirmed at other points: RMS error at most 0.0" in done.stdout


def test_a_picture_that_was_changed_fails(ring, run):
    assert run(ring, "bake", "ring.obj", *BAKE, "--max-error", 0.05).returncode == 0
    lighter = np.clip(read_image(ring / "out.png") + 0.1, 0, 1)
    write_image(ring / "out.png", lighter, "8", read_text(ring / "out.png"))
    done = run(ring, "verify", "out.obj", *VERIFY)
    assert done.returncode == 1
    assert "its certificate, an RMS error of at most 0.05, is not confirmed" in done.stderr


def test_where_it_is_not_certain_the_command_fails_and_keeps_its_files(ring, run):
    done = run(ring, "bake", "ring.obj", *BAKE, "-n", 20, "--max-error", 0.01)
    assert done.returncode == 1
    assert "0.01 was wanted" in done.stderr
    assert "allow more --directions" in done.stderr
    assert (ring / "out.png").is_file()
    assert run(ring, "verify", "out.obj", *VERIFY).returncode == 0  # it claims nothing
