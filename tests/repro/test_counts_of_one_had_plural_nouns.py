""" "1 materials", "1 triangles": a count of one has the singular noun."""

import pytest

import aoprecalc as ao
from aoprecalc.errors import counted, one_or_many
from pipeline.helpers import write_ring

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((0, "mesh", "meshes"), "0 meshes"),
        ((1, "mesh", "meshes"), "1 mesh"),
        ((1, "triangle"), "1 triangle"),
        ((2, "triangle"), "2 triangles"),
    ],
)
def test_counts(words, expected):
    assert counted(*words) == expected


def test_words_agree():
    assert [one_or_many(count, "is", "are") for count in (0, 1, 2)] == ["are", "is", "are"]


def test_a_bake_of_one_triangle(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.obj").write_text(f"{TRIANGLE}f 1 2\n")
    done = command("bake", "one.obj", "--size", "32", "-n", "64")
    assert done.returncode == 0
    assert "1 chart\n" in done.stderr
    assert "1 face of fewer than 3 corners is skipped" in done.stderr
    assert "  1 triangle\n" in done.stdout
    assert "map_Kd of 1 material, vt" in done.stdout
    assert repr(ao.load("one.obj")) == "Mesh('one', 3 vertices, 1 face)"


def test_a_batch_of_one_sphere(command, tmp_path):
    mesh = write_ring(tmp_path / "ring.obj")
    done = command("batch", mesh, "-o", tmp_path / "out", "--no-cache", "--spheres", "-n 1 -s 100")
    assert done.returncode == 0
    assert "1 sphere, silhouette IoU" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("1 asset: 1 made")
