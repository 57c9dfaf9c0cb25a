"""`--measure` was held to options of a fit, and numbers that overflow ended as a fault of the program."""

import json
import subprocess
import sys

import pytest
import trimesh


@pytest.fixture
def measure(tmp_path):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.ply")

    def run(center, *words):
        (tmp_path / "s.json").write_text(json.dumps({"spheres": [{"center": center, "radius": 1}]}))
        return subprocess.run(
            [sys.executable, "-m", "aoprecalc", "spheres", "ball.ply", "--measure", "s.json", *words],
            cwd=tmp_path, capture_output=True, text=True,
        )  # fmt: skip

    return run


def test_fewer_samples_than_the_default_number_of_spheres(measure):
    done = measure([0, 0, 0], "-s", "50", "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["quality"]["silhouette_iou"] > 0.9


def test_a_sphere_at_the_end_of_float64_is_refused(measure):
    done = measure([1e200, 0, 0])
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1
    assert "so far from" in done.stderr


@pytest.mark.parametrize(
    "words", [("-n", "5"), ("--method", "shadow"), ("-o", "x.json"), ("--levels", "2,4")], ids="_".join
)
def test_what_would_be_ignored_is_refused(measure, words):
    done = measure([0, 0, 0], *words)
    assert done.returncode == 2
    assert done.stderr.startswith("error: --measure fits nothing, but --")
