"""The wheel and the source archive, as others install them: whole, without tests, and working far from the checkout."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from email import message_from_bytes
from pathlib import Path

import numpy as np
import pytest

from aoprecalc import __version__
from aoprecalc.cli import main
from shapes import torus

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
QUICK = ["--size", "64", "-n", "64"]
HELP = [[], *([name] for name in main.commands), *(["cache", name] for name in main.commands["cache"].commands)]

# Python runs it at the start of every process of the new environment: it writes down what came from the checkout.
WATCH = f"""
import atexit, sys

def note():
    files = [getattr(module, "__file__", None) or "" for module in list(sys.modules.values())]
    from_checkout = [file for file in files if file.startswith(({str(SOURCE)!r}, {str(ROOT / "tests")!r}))]
    with open({{log!r}}, "a") as log:
        log.write(f"{{{{len(files)}}}} {{{{from_checkout}}}}\\n")

atexit.register(note)
"""


def build(target, folder):
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build("wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A function that runs the installed `aoprecalc`; only libraries are shared with this environment."""
    home = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    program = home / ("Scripts" if os.name == "nt" else "bin")
    pip = [sys.executable, "-m", "pip", "--python", home, "install", "--quiet", "--no-index", "--no-deps", wheel]
    subprocess.run(pip, check=True, capture_output=True)
    (packages,) = home.glob("[Ll]ib/**/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    log = home / "log.txt"
    (packages / "sitecustomize.py").write_text(WATCH.format(log=str(log)))

    def run(folder, *words, code=0):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        command = [program / "aoprecalc", *words]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        assert {line.split(" ", 1)[1] for line in log.read_text().splitlines()} == {"[]"}
        return done

    return run


def names_in(archive):
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as opened:
            return set(opened.namelist())
    with tarfile.open(archive) as opened:
        return {name.split("/", 1)[1] for name in opened.getnames() if "/" in name}


def tracked(*folders):
    found = {path.relative_to(ROOT) for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()}
    return {path.as_posix() for path in found if not {"__pycache__", "node_modules"} & set(path.parts)}


@pytest.mark.slow
def test_the_wheel_holds_the_package_whole_and_nothing_else(wheel):
    assert wheel.name == f"aoprecalc-{__version__}-py3-none-any.whl"
    names = {name for name in names_in(wheel) if not name.startswith(f"aoprecalc-{__version__}.dist-info/")}
    assert names == {name.removeprefix("src/") for name in tracked("src")}
    assert {Path(name).suffix for name in names} <= {".css", ".glsl", ".j2", ".js", ".json", ".py", ".txt", ".typed"}


@pytest.mark.slow
def test_the_description_on_pypi_refers_to_files_by_their_addresses(wheel):
    with zipfile.ZipFile(wheel) as opened:
        described = message_from_bytes(opened.read(f"aoprecalc-{__version__}.dist-info/METADATA"))
    targets = re.findall(r"\]\(([^)]*)\)", described.get_payload())
    assert targets
    for target in targets:
        address, _, path = target.partition("/main/")
        assert address.startswith(("https://raw.githubusercontent.com/aoprecalc/", "https://github.com/aoprecalc/"))
        assert (ROOT / path.partition("#")[0]).exists()


@pytest.mark.slow
def test_the_source_archive_has_what_its_tests_need(tmp_path):
    archive = build("sdist", tmp_path / "archive")
    names = names_in(archive)
    made = {name for name in tracked("src") if "/viewer/three." in name}  # each build makes it
    assert tracked("src", "tests", "examples", "scripts", "viewer") - made <= names
    assert not made & names
    assert {"Makefile", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "pyproject.toml"} <= names
    with tarfile.open(archive) as opened:
        opened.extractall(tmp_path, filter="data")
    folder = tmp_path / f"aoprecalc-{__version__}"
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    tests = ["tests/test_architecture.py", "tests/options", "tests/docs/test_reference.py"]
    command = [sys.executable, "-m", "pytest", "-q", "-m", "not slow", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(collect, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def folder(tmp_path):
    positions, faces = torus(around=24, across=12)
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*point) for point in positions]
    lines += ["f {} {} {}".format(*corners) for corners in faces + 1]
    (tmp_path / "ring.obj").write_text("\n".join(lines) + "\n")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("words", HELP, ids=" ".join)
def test_every_command_has_help(words, installed, folder):
    assert installed(folder, *words, "--help").stdout.startswith("Usage: aoprecalc ")


@pytest.mark.slow
def test_the_version(installed, folder):
    assert installed(folder, "--version").stdout.startswith(f"aoprecalc {__version__}")


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["ray", pytest.param("gl", marks=pytest.mark.gl)])
def test_a_bake_is_measured_and_compared(backend, installed, folder):
    report = json.loads(installed(folder, "bake", "ring.obj", *QUICK, "--backend", backend, "--json").stdout)
    assert (report["version"], report["backend"]) == (__version__, backend)
    assert 0.5 < report["ao"]["mean"] < 1
    measured = json.loads(installed(folder, "verify", "ring_ao.obj", "--json").stdout)
    assert measured["levels"][0]["rmse"] < 0.1
    installed(folder, "bake", "ring.obj", *QUICK, "--backend", backend, "-o", "again/")
    assert installed(folder, "compare", "ring_ao.png", "again/ring_ao.png", "--tolerance", "0").stdout


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["ray", pytest.param("gl", marks=pytest.mark.gl)])
def test_previews(backend, installed, folder):
    small = ["--size", "64x48", "--backend", backend]
    for words, made in (([], "ring_preview.png"), (["--turntable", "--frames", "2"], "ring_turntable.webp")):
        assert installed(folder, "preview", "ring.obj", *small, *words).stdout.startswith(made)
        assert (folder / made).stat().st_size > 100


@pytest.mark.slow
def test_doctor_finds_the_renderers_and_its_self_test_passes(installed, folder):
    report = json.loads(installed(folder, "doctor", "--json").stdout)
    assert report["passed"]
    assert report["renderers"][-1]["name"] == "Embree"
    assert report["renderers"][-1]["works"]


@pytest.mark.slow
def test_spheres(installed, folder):
    installed(folder, "spheres", "ring.obj", "-n", "12", "-s", "2000")
    spheres = json.loads((folder / "ring_spheres.json").read_text())["spheres"]
    assert len(spheres) == 12
    assert np.isfinite([[*sphere["center"], sphere["radius"]] for sphere in spheres]).all()


@pytest.mark.slow
def test_a_batch_finds_its_results_in_the_cache(installed, folder):
    words = ["batch", "ring.obj", "--bake", "--size 64 -n 64 --backend ray", "--cache", "cache", "--json"]
    made = [json.loads(installed(folder, *words, "-o", output).stdout)["counts"] for output in ("a", "b", "b")]
    assert [counts["cached"] for counts in made] == [0, 1, 0]
    assert made[2]["unchanged"] == 1
    assert json.loads(installed(folder, "cache", "info", "--cache", "cache", "--json").stdout)["holds"]["results"] == 1
    installed(folder, "cache", "prune", "--cache", "cache", "--all")
    assert json.loads(installed(folder, "cache", "info", "--cache", "cache", "--json").stdout)["holds"]["results"] == 0
