"""`bake --figures`: which files appear, what the report says of them, what is refused and leaves nothing behind."""

import json

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api import figures
from aoprecalc.io.images import read_pixels
from pipeline.helpers import write_ring

QUICK = ["--size", "32", "-n", "64", "--shadow-size", "64"]
NAMES = ["1_1_far", "1_1_near", "1_2", "1_3", "1_4", "1_4_without"]


@pytest.fixture
def ring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(figures, "_SIDE", 96)  # pixels of figure 1.4, for speed
    monkeypatch.setattr(figures, "_PANEL", (120, 96))  # of figure 1.5
    return write_ring(tmp_path / "ring.obj")


def made(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_the_figures_appear_and_the_report_lists_them(ring, tmp_path, command):
    done = command("bake", ring, *QUICK, "--figures", "new/figures", "--report", "r.json")
    assert done.returncode == 0, done.stderr
    files = [f"ring_figure_{name}.png" for name in NAMES] + ["ring_figures.png"]
    assert made(tmp_path / "new") == ["figures", *(f"figures/{name}" for name in files)]
    outputs = json.loads((tmp_path / "r.json").read_text())["outputs"]
    assert sorted(outputs["figures"]) == [f"new/figures/{name}" for name in files]
    assert outputs["figures"][-1] == "new/figures/ring_figures.png"
    assert outputs["others"] == ["ring_ao.mtl"]
    assert "new/figures/ring_figures.png" in done.stdout
    texture = np.round(255 * read_pixels(tmp_path / "ring_ao.png"))
    figure = np.round(255 * read_pixels(tmp_path / "new/figures/ring_figure_1_3.png"))
    np.testing.assert_array_equal(figure, texture.repeat(3, axis=2))


def test_without_figures_none_are_listed(ring, tmp_path, command):
    assert command("bake", ring, *QUICK, "--report", "r.json").returncode == 0
    assert json.loads((tmp_path / "r.json").read_text())["outputs"]["figures"] == []


def test_equal_runs_give_equal_bytes_and_python_gives_the_same(ring, tmp_path, command):
    direction = (-1.0, 0.5, 2e-3)
    for folder in ("one", "two"):
        words = ["--figures", folder, "--figure-direction", "-1,0.5,2e-3"]
        assert command("bake", ring, *QUICK, *words, "-o", f"{folder}/").returncode == 0
    result = ao.bake(ring, ao.BakeOptions(size=32, directions=64, shadow_size=64))
    paths = result.figures(direction).save(tmp_path / "three")
    assert len(paths) == 7
    for path in paths:
        assert (
            path.read_bytes()
            == (tmp_path / "one" / path.name).read_bytes()
            == (tmp_path / "two" / path.name).read_bytes()
        )


def test_the_values_behind_the_figures(ring):
    found = ao.bake(ring, ao.BakeOptions(size=32, directions=64, shadow_size=64)).figures([0, 0, 8])
    np.testing.assert_array_equal(found.direction, [0, 0, 1])
    assert list(found.pictures) == ["1_1_near", "1_1_far", "1_2", "1_3", "1_4_without", "1_4"]
    assert found.depths.shape == (2, 64, 64)
    # The ring lies about the z axis, 1.4 in radius and 0.4 high: open in the middle, as thick as its tube elsewhere.
    assert np.isnan(found.depths[:, 31:33, 31:33]).all()
    assert np.nanmax(found.depths[0]) == pytest.approx(0.4, abs=0.01)
    assert np.nanmin(found.depths[1]) == pytest.approx(-0.4, abs=0.01)
    assert np.isfinite(found.depths[0]).any(axis=0).sum() * found.pixel == pytest.approx(2.8, abs=2 * found.pixel)
    assert found.visibility.max() <= 1
    assert found.sheet.shape[2] == 3


WRONG = {
    "no direction": ("0,0,0", 2, "three numbers, not all 0"),
    "not a number": ("1,nan,0", 2, "three numbers, not all 0"),
    "infinite": ("1,inf,0", 2, "three numbers, not all 0"),
    "beyond numbers": ("1,1e999,0", 2, "three numbers, not all 0"),
    "two numbers": ("1,2", 2, "three numbers, not all 0"),
    "four numbers": ("1,2,3,4", 2, "three numbers, not all 0"),
    "words": ("up", 2, "three numbers, not all 0"),
    "nothing": ("", 2, "three numbers, not all 0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_directions_cost_one_line(ring, tmp_path, command, case):
    direction, code, words = WRONG[case]
    done = command("bake", ring, *QUICK, "--figures", "figures", "--figure-direction", direction)
    assert done.returncode == code
    assert words in done.stderr
    assert "--figure-direction" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert made(tmp_path) == ["ring.obj"]


def test_a_direction_without_figures_is_refused(ring, tmp_path, command):
    done = command("bake", ring, *QUICK, "--figure-direction", "0,0,1")
    assert done.returncode == 2
    assert "--figures, which was not given" in done.stderr
    assert made(tmp_path) == ["ring.obj"]


@pytest.mark.parametrize("direction", [(0, 0, 0), (1, float("nan"), 0), (1, 2), "up", None.__class__, [[1, 2, 3]]])
def test_wrong_directions_from_python(ring, direction):
    result = ao.bake(ring, ao.BakeOptions(size=16, directions=2))
    with pytest.raises(ao.ArgumentError, match="direction"):
        result.figures(direction)


def test_a_file_in_place_of_the_folder(ring, tmp_path, command):
    (tmp_path / "figures").write_text("mine")
    done = command("bake", ring, *QUICK, "--figures", "figures")
    assert done.returncode == 1
    assert "figures: is a file, a folder for figures was expected" in done.stderr
    assert made(tmp_path) == ["figures", "ring.obj"]
    assert (tmp_path / "figures").read_text() == "mine"


def test_a_failed_run_leaves_the_earlier_figures_and_no_folder(ring, tmp_path, command):
    assert command("bake", ring, *QUICK, "--figures", "kept").returncode == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "kept").iterdir()}
    broken = tmp_path / "broken.obj"
    broken.write_text("v 0 0 0\nf 1 2 9\n")
    for folder in ("kept", "new/folder"):
        assert command("bake", broken, *QUICK, "--figures", folder).returncode == 4
    assert {path.name: path.read_bytes() for path in (tmp_path / "kept").iterdir()} == before
    assert not (tmp_path / "new").exists()


def test_figures_never_replace_the_texture(ring, tmp_path, command):
    done = command("bake", ring, *QUICK, "-o", "ring_figure_1_3.png", "--figures", ".")
    assert done.returncode == 2
    assert "two outputs have this name" in done.stderr
    assert made(tmp_path) == ["ring.obj"]


SPHERES = ["-n", "4", "-s", "300"]


def test_figures_of_spheres(ring, tmp_path, command):
    (tmp_path / "figures").mkdir()
    kept = {tmp_path / "figures" / f"ring_figure_{name}.png": name.encode() for name in NAMES}  # those of a bake
    for path, data in kept.items():
        path.write_bytes(data)
    done = command("spheres", ring, *SPHERES, "--figures", "figures/", "--method", "shadow")
    assert done.returncode == 0, done.stderr
    assert "figures/ring_sphere_figures.png" in done.stdout.replace("\\", "/")
    names = ["algebraic", "lloyd", "mesh", "samples", "shadow"]
    of_spheres = [f"figures/ring_figure_1_5_{name}.png" for name in names] + ["figures/ring_sphere_figures.png"]
    assert [name for name in made(tmp_path) if "1_5" in name or "sphere_figures" in name] == of_spheres
    assert {path: path.read_bytes() for path in kept} == kept  # both fit in one folder
    drawn = ao.fit_spheres(ring, ao.SphereOptions(4, samples=300, method="shadow")).figures()
    for path in drawn.save(tmp_path / "again"):
        assert path.read_bytes() == (tmp_path / "figures" / path.name).read_bytes()
    assert list(drawn.pictures) == ["1_5_samples", "1_5_mesh", "1_5_shadow", "1_5_lloyd", "1_5_algebraic"]


def test_the_methods_of_the_source_are_drawn_once(ring, tmp_path, command):
    assert command("spheres", ring, *SPHERES, "--figures", "f", "--method", "algebraic").returncode == 0
    names = ["figure_1_5_algebraic", "figure_1_5_lloyd", "figure_1_5_mesh", "figure_1_5_samples", "sphere_figures"]
    assert made(tmp_path / "f") == [f"ring_{name}.png" for name in names]


def test_failures_of_spheres_leave_no_figures(ring, tmp_path, command):
    done = command("spheres", ring, "-s", "500", "--tolerance", "0", "--figures", "f")
    assert done.returncode == 1
    assert made(tmp_path) == ["ring.obj"]
    done = command("spheres", ring, "--measure", "s.csv", "--figures", "f")
    assert done.returncode == 2
    assert "--figures was given as well" in done.stderr
