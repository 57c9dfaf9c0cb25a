"""`output` in a manifest, and `--bake '-o .glb'`: the kinds of files that a batch makes."""

import json

import pytest

from aoprecalc.io import load_scene
from aoprecalc.io.occlusion import find_occlusion
from pipeline.helpers import write_ring


@pytest.fixture
def rock(tmp_path):
    return write_ring(tmp_path / "rock.obj")


def made(folder):
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


def check(folder):
    assert made(folder) == ["rock_ao.glb", "rock_report.json", "rock_spheres.csv", "rock_spheres.urdf"]
    outputs = json.loads((folder / "rock_report.json").read_text())["outputs"]
    assert (outputs["texture"], outputs["mesh"], outputs["others"]) == (None, "rock_ao.glb", [])
    assert outputs["references"][0]["slot"] == "occlusionTexture"
    assert find_occlusion(load_scene(folder / "rock_ao.glb")).values.shape == (32, 32)


def test_options_name_extensions(rock, tmp_path, command):
    words = ["batch", rock, "-o", tmp_path / "out", "--no-cache"]
    words += ["--bake", "--size 32 -n 64 -o .glb", "--spheres", "-n 3 -s 100 -o .urdf -o .csv"]
    done = command(*words)
    assert done.returncode == 0, done.stderr
    check(tmp_path / "out")
    assert "1 unchanged" in command(*words).stdout
    report = command(*words, "--json").stdout
    bake, spheres = json.loads(report)["assets"][0]["commands"]
    assert "-o rock_ao.glb" in bake
    assert "-o rock_spheres.urdf -o rock_spheres.csv" in spheres


def test_a_manifest_names_them_too(rock, tmp_path, command):
    (tmp_path / "batch.toml").write_text(
        'inputs = "rock.obj"\noutput = "out"\n[bake]\nsize = 32\ndirections = 64\noutput = ".glb"\n'
        '[spheres]\nspheres = 3\nsamples = 100\noutput = [".urdf", ".csv"]\n'
    )
    done = command("batch", tmp_path / "batch.toml", "--no-cache")
    assert done.returncode == 0, done.stderr
    check(tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--bake", "-o car.glb"], "is 'car.glb'; for the results of a batch an extension was expected"),
        (["--bake", "-o .png -o .exr"], "names the images <name>_ao.png and <name>_ao.exr"),
        (["--bake", "-o .glb --mesh-output a.obj"], "--bake has --mesh-output, which batch"),
        (["--spheres", "-o .txt"], "is '.txt'; for the results of a batch an extension was expected"),
    ],
)
def test_what_is_no_kind_of_file_is_refused(rock, tmp_path, command, words, message):
    done = command("batch", rock, "-o", tmp_path / "out", *words)
    assert done.returncode == 2
    assert message in done.stderr
    assert made(tmp_path) == ["rock.obj"]
