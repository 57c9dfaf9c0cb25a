"""`aoprecalc spheres`: several outputs at once, and measuring what was written."""

import json

import pytest

from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS
from pipeline.helpers import write_ring

QUICK = ["-n", "6", "-s", "500"]


@pytest.fixture
def ring(tmp_path):
    return write_ring(tmp_path / "ring.obj")


def made(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_each_output_is_written(ring, tmp_path, run):
    done = run(tmp_path, "spheres", "ring.obj", *QUICK, "-o", "x.urdf", "-o", "x.glb", "-o", "made/")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("x.urdf + x.glb + made/ring_spheres.json  6 spheres, ")
    assert made(tmp_path) == ["made/ring_spheres.json", "ring.obj", "x.glb", "x.urdf"]


def test_what_was_written_has_the_quality_that_was_told(ring, tmp_path, run):
    """In every format: it is read back, and measured with the same samples."""
    words = [word for kind in SPHERE_EXTENSIONS for word in ("-o", f"set{kind}")]
    done = run(tmp_path, "spheres", "ring.obj", *QUICK, *words, "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["quality"]
    for kind in SPHERE_EXTENSIONS:
        done = run(tmp_path, "spheres", "ring.obj", "--measure", f"set{kind}", "-s", "500", "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["quality"] == pytest.approx(told, abs=2e-5), kind


@pytest.mark.parametrize(
    ("outputs", "code", "message"),
    [
        (["a.urdf", "b.xyz"], 2, "b.xyz: has the extension .xyz"),
        (["a.urdf", "./a.urdf"], 2, "two outputs have this name"),
        (["a.urdf", "ring.obj"], 2, "ring.obj: belongs to the input itself"),
        (["a.urdf", "none/b.csv"], 1, "there is no folder none"),
    ],
)
def test_all_outputs_or_none(ring, tmp_path, run, monkeypatch, outputs, code, message):
    monkeypatch.setattr("aoprecalc.api.spheres.fit_sphere_set", None)  # refused before the work
    words = [word for output in outputs for word in ("-o", output)]
    done = run(tmp_path, "spheres", "ring.obj", *QUICK, *words)
    assert (done.returncode, done.stderr.count("\n")) == (code, 1)
    assert message in done.stderr
    assert made(tmp_path) == ["ring.obj"]


def test_levels_are_for_json_alone(ring, tmp_path, run):
    done = run(tmp_path, "spheres", "ring.obj", "--levels", "2,6", "-o", "a.json", "-o", "a.csv")
    assert done.returncode == 2
    assert "kept by .json alone, not by a.csv" in done.stderr
    assert made(tmp_path) == ["ring.obj"]
