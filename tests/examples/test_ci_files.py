"""The files of examples/ci do in a project what they say: every command in them is run here, as their tools would.

What installs packages is not: it needs a network. The meshes are small, and so are the textures.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
import trimesh
import yaml
from PIL import Image, ImageOps

from aoprecalc import __version__
from aoprecalc.gl.context import INSTALLS
from aoprecalc.pipeline import plan_batch
from github_kit import DEFAULTS, Workflow

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the commands are those of a POSIX shell")

ROOT = Path(__file__).parents[2]
CI = ROOT / "examples" / "ci"
GITHUB = yaml.safe_load((CI / "github.yml").read_text(encoding="utf-8"))
GITLAB = yaml.safe_load((CI / "gitlab.yml").read_text(encoding="utf-8"))["ambient-occlusion"]
(HOOK,) = yaml.safe_load((CI / "pre-commit.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
STEPS = GITHUB["jobs"]["bake"]["steps"]
PACKAGES = shlex.split(INSTALLS["Debian, Ubuntu"])[2:]

CACHE = ".aoprecalc-cache"
NAMES = ["background/far/hill", "characters/statue", "props/crate"]
MADE = {f"{name}_ao.png" for name in NAMES} | {"characters/statue_spheres.json"}


def dockerfile():
    """The instructions of the Dockerfile: their names and what follows, in order."""
    text = re.sub(r"^#.*\n", "", (CI / "Dockerfile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [line.split(maxsplit=1) for line in text.replace("\\\n", " ").splitlines() if line]


def value(instruction):
    """What follows the last instruction of a kind."""
    return [rest for name, rest in dockerfile() if name == instruction][-1]


def make_meshes(folder):
    """A crate, a hill far away, a statue, and a draft that is not to be baked."""
    for name, mesh in {
        "props/crate.obj": trimesh.creation.box(),
        "background/far/hill.ply": trimesh.creation.icosphere(1),
        "statue.glb": trimesh.creation.annulus(0.5, 1, 1, sections=8),
        "drafts/old/box.stl": trimesh.creation.box(),
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        mesh.export(folder / name)


def run(folder, *words, **more):
    """Run words as a command in a folder, where `aoprecalc` is on the path."""
    ours = {"GITHUB_ACTIONS", "MAKEFLAGS", "MAKELEVEL"}  # what a build that runs these tests has set
    known = {name: text for name, text in os.environ.items() if name not in ours}
    path = os.pathsep.join([sysconfig.get_path("scripts"), known["PATH"]])
    environment = {**known, "PATH": path, "AOPRECALC_CACHE": CACHE, **more}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def batch_json(project):
    return json.loads((project / "build" / "batch.json").read_bytes())


def made(project):
    """The textures and sphere sets in build/ao."""
    home = project / "build" / "ao"
    found = {file.relative_to(home).as_posix() for file in home.rglob("*.*") if file.is_file()}
    return {name for name in found if name.endswith(("_ao.png", "_spheres.json"))}


def cases(file):
    """The number of test cases of a JUnit file, and the names of those that failed."""
    suites = ElementTree.parse(file).getroot()
    found = list(suites.iter("testcase"))
    return len(found), [case.get("name") for case in found if case.find("failure") is not None]


@pytest.fixture(scope="module")
def cached(tmp_path_factory):
    """A project whose results are in its cache and whose crate is golden, as after an earlier job; nothing is built."""
    project = tmp_path_factory.mktemp("project")
    make_meshes(project / "assets")
    text = (CI / "aoprecalc.toml").read_text(encoding="utf-8")
    for key, small in {"size": 64, "directions": 32, "spheres": 8}.items():
        text, count = re.subn(rf"\b{key} = \d+", f"{key} = {small}", text)
        assert count, key
    (project / "aoprecalc.toml").write_text(text, encoding="utf-8")
    done = run(project, "aoprecalc", "batch", "aoprecalc.toml", "-q")
    assert done.returncode == 0, done.stderr
    (project / "golden" / "props").mkdir(parents=True)
    shutil.copy(project / "build" / "ao" / "props" / "crate_ao.png", project / "golden" / "props")
    shutil.rmtree(project / "build")
    return project


@pytest.fixture
def project(cached, tmp_path):
    """A copy of that project, to work in."""
    return shutil.copytree(cached, tmp_path / "project")


def break_mesh(project):
    (project / "assets" / "props" / "broken.obj").write_text("v 0 0 0\n", encoding="utf-8")


def change_golden(project):
    golden = project / "golden" / "props" / "crate_ao.png"
    ImageOps.invert(Image.open(golden)).save(golden)


def test_the_manifest_asks_for_what_its_comments_say(tmp_path, monkeypatch):
    make_meshes(tmp_path / "assets")
    shutil.copy(CI / "aoprecalc.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    planned = plan_batch(["aoprecalc.toml"], None, None)
    assets, folder = planned.assets, planned.output
    assert folder == Path("build/ao")
    specs = {asset.name: asset.spec for asset in assets}
    assert sorted(specs) == NAMES
    assert {name: (spec.bake.width, spec.bake.height, spec.bake.directions) for name, spec in specs.items()} == {
        "background/far/hill": (256, 256, 256),
        "characters/statue": (2048, 2048, 1000),
        "props/crate": (1024, 1024, 1000),
    }
    assert {spec.bake.crease_angle for spec in specs.values()} == {40}
    spheres = specs.pop("characters/statue").spheres
    assert (spheres.spheres, spheres.method) == (64, "shadow")
    assert not any(spec.spheres for spec in specs.values())


# The GitHub workflow uses the action of this repository; tests/examples/test_action.py has more about it.


def test_the_github_workflow_uses_the_action_of_this_version():
    (uses,) = (step for step in STEPS if step["uses"].startswith("aoprecalc/"))
    assert uses["uses"] == f"aoprecalc/aoprecalc@v{__version__}"
    assert uses["with"].keys() <= DEFAULTS.keys()


def run_workflow(project):
    """Run the action's scripts as GitHub does until one fails; returns that one's name, and the job."""
    (uses,) = (step for step in STEPS if step["uses"].startswith("aoprecalc/"))
    job = Workflow(project, **uses["with"])
    shutil.copytree(project / CACHE, job.cache)
    failed = next((step for step in ("Bake", "Compare with golden files") if job.run(step)), None)
    return failed, job


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "step", "found"),
    [
        (lambda project: None, None, (3, [])),
        (break_mesh, "Bake", (4, ["broken"])),
        (change_golden, "Compare with golden files", (3, [])),
    ],
)
def test_the_github_workflow_says_what_is_wrong_and_keeps_what_there_is(project, change, step, found):
    change(project)
    failed, job = run_workflow(project)
    assert failed == step, job.said
    reports = project / "build" / "reports"
    assert json.loads((reports / "batch.json").read_bytes())["counts"]["cached"] == 3
    assert cases(reports / "batch.xml") == found
    assert made(project) == MADE
    assert (reports / "compare" / "props" / "crate_ao.png.difference.png").exists() is (step != "Bake")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "code", "found"), [(None, 0, (3, [])), (break_mesh, 1, (4, ["broken"])), (change_golden, 1, (3, []))]
)
def test_the_gitlab_job_says_what_is_wrong_and_keeps_what_there_is(project, change, code, found):
    if change:
        change(project)
    done = run(project, "sh", "-e", "-c", "\n".join(GITLAB["script"]), **GITLAB["variables"])
    assert done.returncode == code, done.stderr
    after = run(project, "sh", "-e", "-c", "\n".join(GITLAB["after_script"]), **GITLAB["variables"])
    assert after.returncode == 0, after.stderr
    assert batch_json(project)["counts"]["cached"] == 3
    assert cases(project / GITLAB["artifacts"]["reports"]["junit"]) == found
    assert made(project) == MADE
    assert all((project / path).exists() for path in [*GITLAB["artifacts"]["paths"], *GITLAB["cache"]["paths"]])


def test_the_gitlab_job_caches_the_folder_that_it_uses_also_after_a_failure():
    assert GITLAB["cache"]["paths"] == [GITLAB["variables"]["AOPRECALC_CACHE"]]
    assert GITLAB["cache"]["when"] == GITLAB["artifacts"]["when"] == "always"


def test_all_install_the_packages_that_a_bake_without_opengl_asks_for():
    setup = (ROOT / "scripts" / "setup-gl").read_text(encoding="utf-8").splitlines()  # the action runs it
    for lines in (setup, GITLAB["before_script"], [rest for _, rest in dockerfile()]):
        line = next(line for line in lines if "apt-get install" in line)
        found = re.search(r"apt-get install -y (?:-q )?--no-install-recommends ([^&\"]*)", line)
        assert found[1].split() == PACKAGES


def test_the_gitlab_job_installs_this_version():
    assert GITLAB["variables"]["AOPRECALC"] == f"aoprecalc=={__version__}"


@pytest.mark.slow
def test_the_hook_bakes_what_has_changed_and_names_stay(project):
    words = shlex.split(HOOK["entry"])
    assert HOOK["pass_filenames"] is False
    assert run(project, *words).returncode == 0
    trimesh.creation.icosphere(0).export(project / "assets" / "props" / "crate.obj")
    done = run(project, *words, "--json")
    assert done.returncode == 0, done.stderr
    assert {entry["name"]: entry["status"] for entry in json.loads(done.stdout)["assets"]} == {
        "background/far/hill": "unchanged",
        "characters/statue": "unchanged",
        "props/crate": "made",
    }
    assert made(project) == MADE


@pytest.mark.slow
def test_the_hook_stops_a_commit_of_a_broken_mesh(project):
    break_mesh(project)
    done = run(project, *shlex.split(HOOK["entry"]))
    assert done.returncode == 1
    assert "assets/props/broken.obj" in done.stdout


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("assets/props/crate.obj", True),
        ("assets/props/crate.mtl", True),
        ("aoprecalc.toml", True),
        ("docs/aoprecalc.toml", False),
        ("golden/crate_ao.png", False),
        ("pyproject.toml", False),
    ],
)
def test_the_hook_runs_for_meshes_and_what_they_refer_to(file, counts):
    assert bool(re.search(HOOK["files"], file)) is counts


@pytest.fixture
def makefile(project):
    """The project with a Makefile; returns what runs make in it with small textures."""
    shutil.copy(CI / "rules.mk", project)
    (project / "Makefile").write_text("game:\n\t@echo the game\ninclude rules.mk\n", encoding="utf-8")
    return lambda *targets: run(project, "make", *targets, "BAKE=--size 64 -n 32")


@pytest.mark.slow
def test_the_rules_leave_the_makefiles_first_target_alone(makefile):
    assert makefile().stdout == "the game\n"


@pytest.mark.slow
def test_one_bake_makes_texture_and_mesh_and_again_only_after_a_change(project, makefile):
    targets = ["build/props/crate_ao.png", "build/props/crate_ao.obj"]
    done = makefile(*targets)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("aoprecalc bake assets/props/crate.obj -o build/props/") == 1
    assert all((project / target).exists() for target in targets)
    assert "bake" not in makefile(*targets).stdout
    late = (project / targets[0]).stat().st_mtime + 10
    os.utime(project / "assets" / "props" / "crate.obj", (late, late))
    assert makefile(targets[0]).stdout.count("aoprecalc bake") == 1
    (project / targets[1]).unlink()
    assert makefile(targets[1]).stdout.count("aoprecalc bake") == 1


@pytest.mark.slow
def test_a_bake_that_fails_fails_again(project, makefile):
    break_mesh(project)
    for _ in range(2):
        done = makefile("build/props/broken_ao.png")
        assert done.returncode == 2
        assert "error: assets/props/broken.obj" in done.stderr
        assert not list(project.glob("build/**/broken*"))


@pytest.mark.slow
def test_make_assets_runs_the_batch_whose_folder_the_other_rule_leaves_alone(project, makefile):
    assert makefile("assets").returncode == 0
    assert made(project) == MADE
    assert makefile("build/props/crate_ao.png").returncode == 0
    assert "3 assets: 3 unchanged" in makefile("assets").stdout


@pytest.mark.slow
def test_the_container_runs_as_a_user_and_says_what_works(project):
    assert value("USER").split(":")[0] not in ("root", "0")
    done = run(project, *json.loads(value("ENTRYPOINT")), *json.loads(value("CMD")))
    assert done.returncode == 0, done.stderr
    assert "a small bake    passed" in done.stdout


@pytest.mark.slow
def test_the_container_bakes_as_the_dockerfile_says(project):
    text = (CI / "Dockerfile").read_text(encoding="utf-8")
    example = re.search(r"docker run .* aoprecalc (.*)", text)[1]
    done = run(project, *json.loads(value("ENTRYPOINT")), *shlex.split(example))
    assert done.returncode == 0, done.stderr
    assert made(project) == MADE
    assert value("ENV") == f"AOPRECALC_CACHE={value('VOLUME')}"
    assert f"install -d -m 1777 {value('VOLUME')}" in text
    assert f":{value('WORKDIR')}" in text
    assert f":{value('VOLUME')}" in text


def test_the_image_gets_all_that_the_package_is_built_from():
    copied = {source for name, rest in dockerfile() if name == "COPY" for source in rest.split()[:-1]}
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    readme = settings["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["fragments"]
    assert copied == {
        "pyproject.toml",
        "src",
        *(part["path"] for part in readme),
        *settings["project"]["license-files"],
    }
    assert all((ROOT / source).exists() for source in copied)


def test_the_folders_readme_names_every_file_in_it():
    text = (CI / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE))
    assert named == {file.name for file in CI.iterdir()} - {"README.md"}
    assert f"`{CACHE}/`" in text
