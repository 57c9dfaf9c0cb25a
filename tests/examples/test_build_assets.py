"""examples/build_assets.py, run as a script."""

import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from PIL import Image, ImageOps

SCRIPT = Path(__file__).parents[2] / "examples" / "build_assets.py"


@pytest.fixture
def project(tmp_path):
    (tmp_path / "assets" / "props").mkdir(parents=True)
    trimesh.creation.box().export(tmp_path / "assets" / "props" / "crate.obj")
    trimesh.creation.icosphere(1).export(tmp_path / "assets" / "hill.ply")
    return tmp_path


def build(project, *words):
    """Run the script in the project; returns its exit code, its lines, and its errors."""
    command = [sys.executable, SCRIPT, *words, "-o", "build", "--size", "64", "--directions", "32"]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout.splitlines(), done.stderr


@pytest.mark.slow
def test_it_makes_each_asset_once_and_holds_one_to_a_golden_texture(project):
    code, lines, errors = build(project, "assets")
    assert (code, errors) == (0, "")
    assert sorted(line.split()[4] for line in lines[:2]) == ["hill", "props/crate"]
    assert [line.split()[:3] for line in lines[:2]] == [["1", "of", "2"], ["2", "of", "2"]]
    assert lines[2:] == ["2 made"]
    output, golden = project / "build" / "props" / "crate_ao.png", project / "crate_ao.png"
    assert output.with_name("crate_spheres.json").exists()

    golden.write_bytes(output.read_bytes())
    code, lines, _ = build(project, "assets", "--golden", "crate_ao.png")
    assert (code, lines[-2:]) == (0, ["2 unchanged", "build/props/crate_ao.png and crate_ao.png: equal"])

    ImageOps.invert(Image.open(golden)).save(golden)
    code, lines, _ = build(project, "assets", "--golden", "crate_ao.png")
    assert (code, lines[-1]) == (1, "build/props/crate_ao.png and crate_ao.png: different")


@pytest.mark.slow
def test_a_mesh_that_fails_costs_the_others_nothing(project):
    (project / "assets" / "broken.obj").write_text("v 0 0 0\n", encoding="utf-8")
    code, lines, _ = build(project, "assets", "--golden", "broken_ao.png")
    assert code == 1
    assert any("failed" in line and "assets/broken.obj: " in line for line in lines)
    assert lines[-2:] == ["2 made, 1 failed", "no output is called broken_ao.png"]


def test_it_says_what_is_wrong(project):
    code, lines, errors = build(project, "nothing/*.obj")
    assert (code, lines) == (4, [])
    assert errors.startswith("error: ")
    assert not (project / "build").exists()
