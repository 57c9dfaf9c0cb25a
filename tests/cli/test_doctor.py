"""`aoprecalc doctor`: a crash or a hang is a line, the choice is a bake's, and what is missing is named."""

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aoprecalc
from aoprecalc import system as limits
from aoprecalc import system as machine
from aoprecalc.api import checks
from aoprecalc.api import doctor as checkup
from aoprecalc.api import doctor as probing
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.cli.doctor import doctor as command
from aoprecalc.errors import AoprecalcError
from aoprecalc.gl.context import CANDIDATES
from aoprecalc.options import BakeOptions
from shapes import ball, scene

# Python runs it at the start of every process: no OpenGL context can be made.
NO_OPENGL = (
    "from aoprecalc.gl import context as osmesa\n"
    "osmesa.LIBRARIES = ()\n"
    "import moderngl\n"
    "def none(**given): raise Exception('eglInitialize failed (0x3001)')\n"
    "moderngl.create_context = none\n"
)
NO_RAYS = "import sys; sys.modules['embreex'] = None\n"
REPORT = {
    "schema", "version", "machine", "environment", "renderers", "auto", "self_test", "libraries", "extras", "install",
    "passed", "seconds",
}  # fmt: skip


def run(folder, *words, start="", **variables):
    """Run `aoprecalc` as a shell would, with a program at the start of it and of all its children."""
    (folder / "sitecustomize.py").write_text(start)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]),
        **variables,
    }
    words = [sys.executable, "-m", "aoprecalc", *words]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def works(name="a driver", *, software=True):
    facts = {"renderer": name, "vendor": "", "version": "4.5", "software": software, "max_texture_size": 16384}
    return probing.ProbeAnswer(facts)


def refuses(why="eglInitialize failed (0x3001)"):
    return probing.ProbeAnswer(fault=why)


def crashes():
    return probing.ProbeAnswer(fault="signal 11 (Segmentation fault) ended it at step: starting", crashed=True)


def found(*opengl, rays):
    return probing.ProbeResults(tuple(zip(CANDIDATES, opengl, strict=False)), rays)


def test_it_says_what_works_and_passes(tmp_path):
    done = run(tmp_path, "doctor")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"aoprecalc {aoprecalc.__version__}, Python {sys.version.split()[0]}, ")
    assert any(line.split()[:4] == ["EGL", "device", "0", "works"] for line in lines)
    assert any(line.split() == ["numpy", np.__version__] for line in lines)
    assert any("a small bake" in line and "passed: RMS error 0.00" in line for line in lines)


@pytest.mark.slow
def test_the_json_names_the_renderer_that_a_bake_names(tmp_path):
    done = run(tmp_path, "doctor", "--json", LP_NUM_THREADS="1")
    report = json.loads(done.stdout)
    assert set(report) == REPORT
    assert (report["schema"], report["version"]) == (1, aoprecalc.__version__)
    assert report["passed"] is report["self_test"]["passed"] is True
    assert 0 < report["self_test"]["error"] < report["self_test"]["allowed"]
    assert report["environment"]["LP_NUM_THREADS"] == "1"
    assert report["machine"]["cores"] > 0
    assert [entry["name"] for entry in report["renderers"]][-2:] == ["OSMesa", "Embree"]
    assert {name for name, version in report["libraries"].items() if version is None} == set()
    baked = bake_scene(scene(*ball(1)), BakeOptions(size=32))
    (taken,) = (entry for entry in report["renderers"] if entry["name"] == report["auto"]["name"])
    for said in (taken, report["self_test"]):
        assert (said["backend"], said["renderer"]) == (baked.backend, baked.renderer)


def test_without_opengl_rays_are_taken_as_a_bake_does_and_packages_are_named(tmp_path):
    done = run(tmp_path, "doctor", "--json", start=NO_OPENGL)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    *opengl, rays = report["renderers"]
    assert not any(entry["works"] for entry in opengl)
    assert rays["works"]
    assert "does not start (eglInitialize failed" in report["renderers"][0]["fault"]
    assert report["auto"]["name"] == report["self_test"]["renderer"] == "Embree"
    assert report["install"][0]["lines"]["Debian, Ubuntu"] == "apt-get install libegl1 libgl1 libgl1-mesa-dri"


def test_without_any_renderer_the_code_is_three_and_every_way_out_is_named(tmp_path):
    done = run(tmp_path, "doctor", start=NO_OPENGL + NO_RAYS)
    assert done.returncode == 3
    (error,) = done.stderr.splitlines()
    assert error.startswith("error: no way to render")
    for line in ("apt-get install libegl1", "dnf install mesa-libEGL", "conda install", "pip install embreex"):
        assert line in error
        assert line in done.stdout
    assert "takes nothing" in done.stdout


def test_a_missing_simplifier_is_named(monkeypatch):
    rays = found(works(), rays=works())
    assert probing._install_hints(rays, {}) == []
    monkeypatch.setattr(probing, "versions", dict.fromkeys)
    (hint,) = probing._install_hints(rays, {})
    assert (hint.what, hint.lines) == ("opengl_decimate", {"any": "pip install opengl_decimate"})


@pytest.mark.slow
def test_without_rays_only_they_are_missing(tmp_path):
    done = run(tmp_path, "doctor", "--json", start=NO_RAYS)
    assert done.returncode == 0
    report = json.loads(done.stdout)
    assert report["auto"]["backend"] == "gl"
    assert not any("OpenGL" in missing["what"] for missing in report["install"])
    assert any(missing["lines"] == {"any": "pip install embreex"} for missing in report["install"])


@pytest.mark.slow
def test_a_driver_that_kills_its_process_is_a_line_and_the_self_test_fails(tmp_path):
    start = "import moderngl, os\nmoderngl.create_context = lambda **given: os.kill(os.getpid(), 11)\n"
    done = run(tmp_path, "doctor", start=start)
    assert done.returncode == 1
    assert any("EGL device 0" in line and "Segmentation fault" in line for line in done.stdout.splitlines())
    (error,) = done.stderr.splitlines()
    assert error.startswith("error: the self-test failed with EGL device 0 (signal 11")
    assert "--backend ray" in error


def python(program):
    return [sys.executable, "-c", program]


@pytest.mark.parametrize(
    ("program", "answer"),
    [
        ('print(\'{"renderer": "r"}\')', probing.ProbeAnswer({"renderer": "r"})),
        ("print('a driver talks'); print('{\"renderer\": \"r\"}')", probing.ProbeAnswer({"renderer": "r"})),
        ('print(\'{"fault": "too old"}\')', probing.ProbeAnswer(fault="too old")),
        ("import os; os.kill(os.getpid(), 11)", crashes()),
        ("raise OSError('no disk')", probing.ProbeAnswer(fault="OSError: no disk", crashed=True)),
        ("", probing.ProbeAnswer(fault="it ended without an answer", crashed=True)),
    ],
)
def test_a_probe_that_answers_or_crashes(program, answer):
    assert probing.run_probes([python(program)]) == [answer]


@pytest.mark.slow
def test_a_probe_that_hangs_is_ended_and_the_others_are_heard(tmp_path):
    """It is deaf to politer signals."""
    note = tmp_path / "pid"
    hangs = (
        "import os, pathlib, signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        f"pathlib.Path({str(note)!r}).write_text(str(os.getpid())); time.sleep(600)"
    )
    answers = probing.run_probes([python(hangs), python("print('{}')")], timeout=3)
    assert answers == [probing.ProbeAnswer(fault="it hangs: no answer within 3 s", crashed=True), probing.ProbeAnswer()]
    with pytest.raises(ProcessLookupError):
        os.kill(int(note.read_text()), 0)


@pytest.mark.parametrize(
    ("answers", "name", "why"),
    [
        (found(works(software=False), rays=works()), "EGL device 0", "the first that makes an OpenGL 4.3 context"),
        (found(refuses(), works(), rays=works()), "Embree", "for a number of directions: EGL device 1"),
        (found(refuses(), works(), rays=refuses()), "EGL device 1", "the first that makes an OpenGL 4.3 context"),
        (found(refuses(), rays=works()), "Embree", "there is no OpenGL 4.3, and rays can be traced"),
        (found(refuses(), crashes(), works(), rays=works()), "EGL device 1", "gets no further (signal 11"),
        (found(works(), crashes(), rays=refuses()), "EGL device 0", "the first"),
        (found(refuses(), rays=refuses()), None, None),
    ],
)
def test_the_choice_is_the_first_that_works_or_ends_a_bake(answers, name, why):
    choice, answer = checkup._choose(answers)
    if name is None:
        assert choice is None
        return
    assert choice.name == name
    assert why in choice.why
    assert answer.works == (answer.fault == "")


def test_a_self_test_with_too_great_an_error_is_said_and_the_code_is_one(monkeypatch):
    monkeypatch.setattr(checkup, "probe_all", lambda: found(works(), rays=refuses("not there")))
    measured = {
        "backend": "gl",
        "renderer": "a driver",
        "error": 0.25,
        "allowed": 0.01,
        "passed": False,
        "seconds": 1.0,
    }
    monkeypatch.setattr(checkup, "run_probes", lambda commands, patience: [probing.ProbeAnswer(measured)])
    done = CliRunner().invoke(command, [])
    assert isinstance(done.exception, AoprecalcError)
    assert done.exception.exit_code == 1
    assert "its RMS error is 0.2500, at most 0.01 was expected" in str(done.exception)
    assert "failed: RMS error 0.2500" in done.output


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_the_self_test_is_well_within_its_bound_and_finds_a_wrong_picture(backend, monkeypatch):
    """Too dark by a twentieth, as if some directions were lost."""
    baked = []

    def bake_once(*given):
        baked[:] = baked or [bake_scene(*given)]
        return baked[0]

    monkeypatch.setattr(checks, "bake_scene", bake_once)
    measured = checks.run_self_test(backend)
    assert measured["backend"] == backend
    assert measured["passed"]
    assert measured["error"] < checks.MAX_ERROR / 2
    baked[0].texture.values[:] *= 0.95
    measured = checks.run_self_test(backend)
    assert not measured["passed"]
    assert measured["error"] > checks.MAX_ERROR


def test_the_limits_of_a_container_count(monkeypatch, tmp_path):
    monkeypatch.setattr(limits, "_CGROUP", tmp_path)
    free = machine.machine()
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    (tmp_path / "memory.max").write_text("1048576\n")
    held = machine.machine()
    assert (held["cores"], held["memory"]) == (0.5, 1048576)
    assert free["cores"] >= 1
    assert free["memory"] > 1048576
    (tmp_path / "cpu.max").write_text("max 100000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert machine.machine() == free


def test_libraries_and_extras_are_those_of_the_package():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]

    def names(requirements):
        return {re.match(r"[\w-]+", requirement)[0] for requirement in requirements}

    assert names(project["dependencies"]) == set(machine.LIBRARIES) - {"glcontext"}  # moderngl's
    extras = project["optional-dependencies"]
    for extra in set(extras) - {"browser", "test", "lint", "docs", "dist"}:
        assert names(extras[extra]) == set(machine.EXTRAS[extra])


def test_a_package_that_is_missing_has_no_version(monkeypatch):
    def version(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(machine, "version", version)
    assert machine.versions(("numpy",)) == {"numpy": None}


@pytest.mark.slow
def test_the_python_api_gives_the_report():
    report = aoprecalc.doctor()
    assert report.passed
    assert set(report.to_dict()) == REPORT
