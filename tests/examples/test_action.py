"""The scripts of action.yml, run as GitHub runs them on a small project: what has changed is named, and fails."""

import json
import re
import shutil
import sys
from xml.etree import ElementTree

import pytest
import trimesh
from PIL import Image, ImageOps

from github_kit import ACTION, DEFAULTS, ROOT, Workflow

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the commands are those of a POSIX shell")

MANIFEST = """
inputs = ["assets"]
output = "build"
[bake]
size = 64
directions = 64
backend = "ray"
[[asset]]
mesh = "assets/rock.ply"
bake = false
spheres = { spheres = 4, samples = 300 }
"""


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """A project with a crate and a rock, baked once; its results are golden, and in the cache."""
    home = tmp_path_factory.mktemp("job")
    project = home / "project"
    (project / "assets" / "props").mkdir(parents=True)
    trimesh.creation.box().export(project / "assets" / "props" / "crate.obj")
    trimesh.creation.icosphere(1).export(project / "assets" / "rock.ply")
    (project / "aoprecalc.toml").write_text(MANIFEST, encoding="utf-8")
    job = Workflow(project)
    assert job.run("Bake") == 0, job.said
    for name in ("props/crate_ao.png", "props/crate_ao.obj", "props/crate_ao.mtl", "rock_spheres.json"):
        (project / "golden" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(project / "build" / name, project / "golden" / name)
    shutil.rmtree(project / "build")
    return home


@pytest.fixture
def project(baked, tmp_path):
    """A copy of that project, as a new job has it."""
    return shutil.copytree(baked, tmp_path / "job") / "project"


@pytest.fixture
def job(project):
    return Workflow(project, golden="golden/")


def test_the_same_results_pass_and_come_from_the_cache(job, project):
    assert job.run("Bake") == 0, job.said
    assert job.outputs == {"output": "build", "report": "aoprecalc-reports/batch.json"}
    report = json.loads((project / job.outputs["report"]).read_bytes())
    assert report["counts"]["cached"] == 2
    assert len(list(ElementTree.parse(project / "aoprecalc-reports" / "batch.xml").iter("testcase"))) == 2
    assert "props/crate" in (project / "aoprecalc-reports" / "batch.html").read_text(encoding="utf-8")
    assert job.run("Compare with golden files") == 0, job.said
    assert "0 of 3 results changed" in job.summary
    compared = {file.relative_to(project).as_posix() for file in project.glob("aoprecalc-reports/compare/**/*.*")}
    assert compared == {
        "aoprecalc-reports/compare/props/crate_ao.obj.report.json",
        "aoprecalc-reports/compare/props/crate_ao.png.difference.png",
        "aoprecalc-reports/compare/props/crate_ao.png.report.json",
        "aoprecalc-reports/compare/rock_spheres.json.report.json",
    }


@pytest.mark.slow
def test_golden_files_may_be_all_that_a_batch_leaves(project):
    job = Workflow(project, golden="./golden")
    assert job.run("Bake") == 0, job.said
    shutil.rmtree(project / "golden")
    shutil.copytree(project / "build", project / "golden")
    assert (project / "golden" / ".aoprecalc" / "assets").is_dir()
    assert job.run("Compare with golden files") == 0, job.said
    assert "0 of 4 results changed" in job.summary  # with the report of the crate


def test_a_changed_result_fails_and_is_named(job, project):
    golden = project / "golden" / "props" / "crate_ao.png"
    ImageOps.invert(Image.open(golden)).save(golden)
    assert job.run("Bake") == 0, job.said
    assert job.run("Compare with golden files") == 1
    assert "Results changed: props/crate_ao.png props/crate_ao.obj." in job.said.replace(
        "props/crate_ao.obj props/crate_ao.png", "props/crate_ao.png props/crate_ao.obj"
    )
    assert "::error::build/props/crate_ao.png: differs from golden/props/crate_ao.png" in job.said
    assert "- `props/crate_ao.png`\n" in job.summary


@pytest.mark.slow
def test_a_greater_tolerance_lets_it_pass(project):
    golden = project / "golden" / "rock_spheres.json"
    golden.write_text(golden.read_text(encoding="utf-8").replace('"radius": 0.', '"radius": 0.0'), encoding="utf-8")
    for tolerance, code in (("0.005", 1), ("1", 0)):
        job = Workflow(project, golden="golden", tolerance=tolerance)
        assert job.run("Bake") == 0, job.said
        assert job.run("Compare with golden files") == code, job.said


@pytest.mark.slow
def test_a_result_that_is_no_longer_made_is_named(job, project):
    (project / "assets" / "rock.ply").rename(project / "assets" / "stone.ply")
    manifest = project / "aoprecalc.toml"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("rock.ply", "stone.ply"), encoding="utf-8")
    assert job.run("Bake") == 0, job.said
    assert job.run("Compare with golden files") == 1
    assert "::error::rock_spheres.json is in golden/, but the batch made no such file" in job.said


@pytest.mark.slow
def test_a_broken_mesh_fails_the_bake_and_the_report_stays(job, project):
    (project / "assets" / "broken.obj").write_text("v 0 0 0\n", encoding="utf-8")
    assert job.run("Bake") == 1
    assert "::error file=assets/broken.obj::" in job.said
    report = json.loads((project / "aoprecalc-reports" / "batch.json").read_bytes())
    assert report["counts"]["failed"] == 1
    assert job.run("Prune the cache") == 0


@pytest.mark.slow
def test_a_wrong_manifest_is_said_and_leaves_no_outputs(job, project):
    (project / "aoprecalc.toml").write_text("[bake]\nsizes = 3\n", encoding="utf-8")
    assert job.run("Bake") == 2
    assert "unknown key 'bake.sizes'; did you mean 'size'?" in job.said
    assert job.outputs == {}


@pytest.mark.slow
def test_an_empty_golden_folder_is_no_success(job, project):
    shutil.rmtree(project / "golden")
    (project / "golden").mkdir()
    assert job.run("Bake") == 0, job.said
    assert job.run("Compare with golden files") == 1
    assert "holds no golden files" in job.said


HOSTILE = "$(touch run)`touch run`\n; touch run #"


@pytest.mark.slow
@pytest.mark.parametrize("names", [["tolerance"], sorted(DEFAULTS)], ids=["tolerance", "all"])
def test_no_text_of_an_input_is_run(names, project):
    job = Workflow(project, **{"golden": "golden", **dict.fromkeys(names, HOSTILE)})
    for step in ("Bake", "Compare with golden files", "Prune the cache"):
        job.run(step)
    job.run("Install aoprecalc", stub_python(project))
    assert not list(project.rglob("run"))


def stub_python(folder):
    """A folder with a python that prints its arguments."""
    home = folder / "bin"
    home.mkdir()
    (home / "python").write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n', encoding="utf-8")
    (home / "python").chmod(0o755)
    return home


@pytest.mark.parametrize(
    ("inputs", "requirement"),
    [
        ({}, str(ROOT)),
        ({"extras": "formats,compressed"}, f"{ROOT}[formats,compressed]"),
        ({"version": "0.2.0"}, "aoprecalc==0.2.0"),
        ({"version": "0.2.0", "extras": "formats"}, "aoprecalc[formats]==0.2.0"),
    ],
)
def test_it_installs_its_own_version_or_the_one_asked_for(inputs, requirement, tmp_path):
    (tmp_path / "project").mkdir()
    job = Workflow(tmp_path / "project", **inputs)
    assert job.run("Install aoprecalc", stub_python(tmp_path)) == 0
    assert job.said.splitlines() == ["-m", "pip", "install", "--disable-pip-version-check", requirement]


def test_every_input_is_used_and_described():
    used = set(re.findall(r"inputs\.([\w-]+)", (ROOT / "action.yml").read_text(encoding="utf-8")))
    assert used == set(ACTION["inputs"])
    assert all(given["description"].endswith(".") for given in ACTION["inputs"].values())


def test_nothing_is_uploaded_or_cached_unless_asked_for():
    conditions = {step["uses"].split("@")[0]: step.get("if", "") for step in ACTION["runs"]["steps"] if "uses" in step}
    assert "inputs.artifact != ''" in conditions["actions/upload-artifact"]
    assert DEFAULTS["artifact"] == ""
    for name in ("restore", "save"):
        assert "inputs.cache-size != ''" in conditions[f"actions/cache/{name}"]
