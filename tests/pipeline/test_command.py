"""`aoprecalc batch` as scripts use it: what it prints where, and its exit codes."""

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.helpers import (
    PATIENCE,
    SMALL_BAKE,
    SMALL_SPHERES,
    contents,
    error_of,
    run,
    running_in,
    wait_until,
    without_times,
    write_ring,
)
from shapes import torus

linux = pytest.mark.skipif(
    sys.platform != "linux", reason="reads /proc; and a parent's death is a signal on Linux only"
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The present folder, with two meshes in a folder `in`."""
    monkeypatch.chdir(tmp_path)
    write_ring(tmp_path / "in/a.obj", 0.4)
    write_ring(tmp_path / "in/props/b.obj", 0.3)
    return tmp_path


def test_it_says_what_it_made(here):
    first = run(here, "batch", "in", "-o", "out", *SMALL_BAKE, *SMALL_SPHERES, "-j", "1")
    assert first.returncode == 0, first.stderr
    lines = first.stdout.splitlines()
    assert [line.split()[:1] + line.split()[3:6] for line in lines[:-1]] == [
        ["made", "a", "64", "triangles,"],
        ["made", "props/b", "64", "triangles,"],
    ]
    assert lines[-1].startswith("2 assets: 2 made; ")
    assert [line.split()[:2] for line in first.stderr.splitlines()] == [["[1/2]", "made"], ["[2/2]", "made"]]
    assert list(contents(here / "out")) == [
        *("a_ao.mtl", "a_ao.obj", "a_ao.png", "a_report.json", "a_spheres.json"),
        *("props/b_ao.mtl", "props/b_ao.obj", "props/b_ao.png", "props/b_report.json", "props/b_spheres.json"),
    ]
    again = run(here, "batch", "in", "-o", "out", *SMALL_BAKE, *SMALL_SPHERES)
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout.startswith("2 assets: 2 unchanged; ")


def test_verbose_tells_the_seconds_of_each_stage(here):
    done = run(here, "batch", "in/a.obj", "-o", "out", *SMALL_BAKE, "-j", "1", "--no-cache", "-v")
    assert done.returncode == 0, done.stderr
    lines = [line.split(": ") for line in done.stderr.splitlines() if line.startswith("a: ")]
    assert {"load", "visibility", "write"} <= {words[1] for words in lines}
    assert all(words[-1].endswith(" s") for words in lines)


@pytest.mark.slow
def test_its_results_are_those_of_the_single_commands(here):
    """With one job and with three; the commands are those that its report tells."""
    positions, faces = torus(around=8, across=4)
    text = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (here / "in/a.obj").write_text("\n".join(text))  # without UVs
    made = {}
    for jobs in (1, 3):
        words = [*SMALL_BAKE, *SMALL_SPHERES, "-j", jobs, "--no-cache", "--json", "-q"]
        done = run(here, "batch", "in", "-o", f"out{jobs}", *words)
        assert done.returncode == 0
        made[jobs] = without_times(contents(here / f"out{jobs}"))
    assert made[1] == made[3]
    for asset in json.loads(done.stdout)["assets"]:
        stem = asset["name"].rpartition("/")[2]
        bake, spheres = (shlex.split(line)[1:] for line in asset["commands"])
        assert run(here, *bake, "--report", f"{stem}_report.json").returncode == 0
        assert run(here, *spheres).returncode == 0
    single = without_times({name: data for name, data in contents(here).items() if "/" not in name})
    batched = {name.rpartition("/")[2]: data for name, data in made[3].items()}
    assert single.keys() == batched.keys()
    for name, data in batched.items():
        if name.endswith("_report.json"):
            assert without_paths(data) == without_paths(single[name])
        else:
            assert data == single[name], name


def without_paths(report):
    """A report of a bake without its paths, which count from other folders in a batch."""
    return {**report, "outputs": None, "input": {**report["input"], "path": None}}


def test_json_is_all_that_is_on_standard_output(here):
    (here / "in/a.obj").write_text("")
    done = run(here, "batch", "in", "-o", "out", *SMALL_SPHERES, "--json", "--report", "report.json")
    assert done.returncode == 1
    report = json.loads(done.stdout)
    assert done.stdout == (here / "report.json").read_text()
    assert report["counts"] == {"made": 1, "unchanged": 0, "cached": 0, "failed": 1, "stopped": 0}
    failed, made = report["assets"]
    assert failed["error"]["message"].startswith("in/a.obj: is empty")
    assert failed["error"]["exit_code"] == 4
    assert made["outputs"] == ["out/props/b_spheres.json"]
    assert made["summary"]["spheres"] == 8
    assert error_of(done).startswith("error: 1 of 2 assets failed, the others are in out; ")


@pytest.mark.slow
def test_quiet_prints_results_and_errors_alone(here):
    assert run(here, "batch", "in", "-o", "out", *SMALL_SPHERES, "-q").stderr == ""
    (here / "in/a.obj").write_text("")
    done = run(here, "batch", "in", "-o", "out", *SMALL_SPHERES, "-q")
    assert done.stderr.splitlines() == [error_of(done)]


NASTY = {
    "empty.obj": b"",
    "garbage.ply": bytes(range(256)) * 4,
    "garbage.glb": b"glTF" + bytes(range(256)),
    "nan.obj": b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "points.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "beyond.obj": b"v 0 0 0\nf 1 2 3\n",
}


def test_nasty_input_costs_itself_alone(here, pool, command):
    for name, data in NASTY.items():
        (here / "in" / name).write_bytes(data)
    done = command("batch", "in", "-o", "out", *SMALL_BAKE, "--junit", "junit.xml", "--json")
    assert done.returncode == 1
    report = json.loads(done.stdout)
    found = {entry["path"].removeprefix("in/"): entry for entry in report["assets"]}
    assert {name for name, entry in found.items() if entry["status"] == "failed"} == set(NASTY)
    assert {name for name, entry in found.items() if entry["status"] == "made"} == {"a.obj", "props/b.obj"}
    for name in NASTY:
        error = found[name]["error"]
        assert (error["kind"], error["exit_code"]) == ("error", 4)
        assert error["message"].startswith(f"in/{name}: ")
        assert "\n" not in error["message"]
    assert {name.split("_")[0] for name in contents(here / "out")} == {"a", "props/b"}
    suite = ElementTree.parse(here / "junit.xml").getroot()[0]
    assert {case.get("name") for case in suite if case.find("failure") is not None} == {
        name.replace(".", "_") if "garbage" in name else name.split(".")[0] for name in NASTY
    }


USAGE = {
    "no pattern": ([], 2, "PATTERN"),
    "no output": (["in"], 2, "no output folder was given; name one with --output"),
    "a pattern that fits nothing": (["*.stl", "-o", "out"], 4, "*.stl: matches no mesh"),
    "an option of bake": (["in", "-o", "out", "--size", "64"], 2, "--size is an option of bake; write --bake"),
    "an option of spheres": (["in", "-o", "out", "--radius", "mean"], 2, "--radius is an option of spheres"),
    "an option of none": (["in", "-o", "out", "--sise", "64"], 2, "No such option"),
    "a wrong option inside": (["in", "-o", "out", "--bake", "--sise 64"], 2, "--bake is '--sise 64': No such option"),
    "a wrong value inside": (["in", "-o", "out", "--bake", "-n 0"], 2, "--bake is '-n 0': Invalid value"),
    "an output inside": (["in", "-o", "out", "--bake", "-o x.png"], 2, "--output is 'x.png'; for the results of"),
    "a mesh inside": (["in", "-o", "out", "--spheres", "a.obj"], 2, "'a.obj': 'a.obj' is not an option; write meshes"),
    "a quotation without an end": (["in", "-o", "out", "--bake", "--only 'a"], 2, "a quotation in it has no end"),
    "help inside": (["in", "-o", "out", "--bake", "--help"], 2, "--bake is '--help'"),
    "two numbers of spheres": (
        ["in", "-o", "out", "--spheres", "-n 8 --tolerance 0.1"], 2, "--spheres and --tolerance both say how many"
    ),
    "no time": (["in", "-o", "out", "--timeout", "0"], 2, "--timeout"),
    "a negative number of jobs": (["in", "-o", "out", "-j", "-1"], 2, "--jobs"),
    "workers of no scheduler": (["in", "-o", "out", "--split"], 2, "--split is for the workers of a --scheduler"),
    "a report that would be a mesh": (["in", "-o", "out", "--report", "in/a.obj"], 2, "whose name ends in .json"),
    "a report that would be a manifest": (["in", "-o", "out", "--junit", "batch.toml"], 2, "whose name ends in .xml"),
    "a report in an asset's place": (["in", "-o", "out", "--report", "out/a_report.json"], 2, "another name"),
    "a report nowhere": (["in", "-o", "out", "--report", "missing/r.json"], 1, "there is no folder missing"),
    "a file as output": (["in", "-o", "in/a.obj"], 1, "in/a.obj: cannot be written"),
}  # fmt: skip


@pytest.mark.parametrize("case", USAGE)
def test_what_cannot_be_done_is_one_line_before_any_work(case, here, pool, command):
    words, code, expected = USAGE[case]
    before = sorted(path for path in here.rglob("*"))
    done = command("batch", *words)
    assert done.returncode == code
    assert expected in error_of(done)
    assert done.stdout == ""
    assert pool.jobs == []
    assert sorted(path for path in here.rglob("*")) == before


def test_files_of_a_failed_batch_are_written(here, pool, command):
    """Its answer is no, and its report says why."""
    (here / "in/a.obj").unlink()
    words = ["in/a.obj", "in/props/b.obj", "-o", "out", *SMALL_SPHERES, "--report", "logs/", "--junit", "logs/"]
    done = command("batch", *words)
    assert done.returncode == 1
    report = json.loads((here / "logs/batch.json").read_text())
    assert [(entry["name"], entry["status"]) for entry in report["assets"]] == [("a", "failed"), ("props/b", "made")]
    assert "in/a.obj" in report["assets"][0]["error"]["message"]
    assert ElementTree.parse(here / "logs/batch.xml").getroot().get("failures") == "1"


def test_a_report_may_lie_in_the_output_folder(here, pool, command):
    done = command("batch", "in", "-o", "out", *SMALL_SPHERES, "--report", "out/batch.json")
    assert done.returncode == 0, done.stderr
    assert json.loads((here / "out/batch.json").read_text())["counts"]["made"] == 2


def test_fail_fast_stops(here, pool, command):
    for name in ("in/a.obj", "in/props/b.obj"):
        (here / name).write_text("")
    done = command("batch", "in", "-o", "out", *SMALL_SPHERES, "--fail-fast", "--json", "--junit", "junit.xml")
    assert done.returncode == 1
    report = json.loads(done.stdout)
    assert (report["counts"]["failed"], report["counts"]["stopped"]) == (1, 1)
    assert len(pool.jobs) == 1
    assert error_of(done).startswith("error: 1 of 2 assets failed, 1 was not finished; ")
    assert ElementTree.parse(here / "junit.xml").getroot().get("skipped") == "1"
    kept_going = command("batch", "in", "-o", "out", *SMALL_SPHERES, "--keep-going", "--json")
    assert json.loads(kept_going.stdout)["counts"]["failed"] == 2


def test_names_that_are_no_text_do_not_end_the_batch(here):
    os.rename(here / "in/a.obj", os.fsencode(here) + b"/in/\xff.obj")
    words = [*SMALL_SPHERES, "--report", "report.json", "--junit", "junit.xml"]
    done = run(here, "batch", "in", "-o", "out", *words, PYTHONIOENCODING="utf-8:strict")  # as most locales have it
    assert done.returncode == 0, done.stderr
    assert json.loads((here / "report.json").read_text())["counts"]["made"] == 2
    assert ElementTree.parse(here / "junit.xml").getroot().get("tests") == "2"


@pytest.mark.parametrize("at", ["true", "false", None])
def test_github_is_told_where_it_asks(at, here, pool, command, monkeypatch):
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    if at is not None:
        monkeypatch.setenv("GITHUB_ACTIONS", at)
    (here / "in/a.obj").rename(here / "in/100%, it: is.obj")
    (here / "in/100%, it: is.obj").write_text("")
    done = command("batch", "in", "-o", "out", *SMALL_SPHERES)
    told = [line for line in done.stderr.splitlines() if line.startswith("::")]
    assert "::" not in done.stdout
    if at != "true":
        assert told == []
        return
    assert told[0].startswith("::error file=in/100%25%2C it%3A is.obj::in/100%25, it: is.obj: is empty")
    assert told[1].startswith("::error::1 of 2 assets failed, ")
    assert len(told) == 2


def test_a_new_line_in_a_name_ends_no_annotation(here, pool, command, monkeypatch):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    (here / "in/a.obj").rename(here / "in/a\n::error::b.obj")
    (here / "in/a\n::error::b.obj").write_text("")
    done = command("batch", "in/a\n::error::b.obj", "-o", "out", *SMALL_SPHERES)
    told = [line for line in done.stderr.splitlines() if line.startswith("::")]
    assert len(told) == 2
    assert told[0].startswith("::error file=in/a%0A%3A%3Aerror%3A%3Ab.obj::")


def start(folder, *words):
    """Start `aoprecalc batch` on the folder `in`."""
    command = [sys.executable, "-m", "aoprecalc", "batch", "in", "-o", "out", "--no-cache", *words]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
@linux
@pytest.mark.usefixtures("strange")
def test_workers_that_die_cost_their_assets_alone(here):
    for name in ("killed", "crashed", "once", "z"):
        write_ring(here / f"in/{name}.obj")
    done = run(here, "batch", "in", "-o", "out", *SMALL_SPHERES, "-j", "2", "--no-cache", "--json")
    assert done.returncode == 1
    found = {entry["name"]: entry for entry in json.loads(done.stdout)["assets"]}
    assert {name for name, entry in found.items() if entry["status"] == "failed"} == {"killed", "crashed"}
    assert found["crashed"]["error"] == {
        "kind": "crash",
        "message": "in/crashed.obj: its process died: signal 11 (Segmentation fault)",
        "exit_code": 1,
    }
    assert found["killed"]["error"]["message"].startswith("in/killed.obj: its process died: signal 9 (Killed; ")
    assert {name.split("_")[0] for name in contents(here / "out")} == {"a", "once", "z", "props/b"}


@linux
@pytest.mark.usefixtures("strange")
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupted_batch_keeps_what_it_has(number, here):
    """It ends at once with all its processes, and its report says what is missing."""
    write_ring(here / "in/endless.obj")
    batch = start(here, *SMALL_SPHERES, "-j", "2", "--json", "--report", "report.json", "--junit", "junit.xml")
    try:
        wait_until((here / "in/endless.obj.pids").exists)
        wait_until(lambda: len(list((here / "out/.aoprecalc/assets").rglob("*.json"))) == 2)
        batch.send_signal(number)
        said, heard = batch.communicate(timeout=PATIENCE)
    finally:
        batch.kill()
    assert batch.returncode == 130
    assert json.loads(said) == json.loads((here / "report.json").read_text())
    statuses = {entry["name"]: entry["status"] for entry in json.loads(said)["assets"]}
    assert statuses == {"a": "made", "endless": "stopped", "props/b": "made"}
    expected = "error: interrupted; 2 of 3 assets are there, the same command goes on"
    assert heard.splitlines()[-1] == expected
    assert ElementTree.parse(here / "junit.xml").getroot().get("skipped") == "1"
    wait_until(lambda: running_in(here) == [])
    assert not (here / "out/.aoprecalc/staging").exists()


@pytest.mark.slow
@linux
@pytest.mark.usefixtures("strange")
def test_the_batch_after_a_killed_one_goes_on(here):
    write_ring(here / "in/endless.obj")
    killed = start(here, *SMALL_SPHERES, "-j", "2")
    try:
        wait_until((here / "in/endless.obj.pids").exists)
        wait_until(lambda: len(list((here / "out/.aoprecalc/assets").rglob("*.json"))) == 2)
    finally:
        killed.kill()
        killed.communicate()
    os.kill(int((here / "in/endless.obj.pids").read_text().split()[1]), signal.SIGKILL)  # no child of ours
    wait_until(lambda: running_in(here) == [])
    assert (here / "out/.aoprecalc/staging").exists()
    words = [*SMALL_SPHERES, "--no-cache", "--json"]
    done = run(here, "batch", "in", "-o", "out", *words, PYTHONPATH="")
    assert done.returncode == 0
    counts = {"made": 1, "unchanged": 2, "cached": 0, "failed": 0, "stopped": 0}
    assert json.loads(done.stdout)["counts"] == counts
    assert not (here / "out/.aoprecalc/staging").exists()
    assert run(here, "batch", "in", "-o", "whole", *words, PYTHONPATH="").returncode == 0
    assert contents(here / "out") == contents(here / "whole")


@pytest.mark.slow
@linux
def test_a_killed_batch_leaves_no_process(here):
    """Not even the child of a worker: xatlas takes minutes for so rough a surface."""
    positions, faces = torus(around=200, across=100)
    rough = positions + np.random.default_rng(0).normal(scale=0.02, size=positions.shape)
    lines = [*(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in rough), *(f"f {a} {b} {c}\n" for a, b, c in faces + 1)]
    (here / "in/a.obj").write_text("".join(lines))
    killed = start(here, "--bake", "--size 64 -n 64 --unwrap xatlas")
    try:
        wait_until(lambda: any(is_xatlas(pid) for pid in running_in(here)))
    finally:
        killed.kill()
        killed.communicate()
    wait_until(lambda: running_in(here) == [])


def is_xatlas(pid):
    try:
        return b"aoprecalc.uv.unwrap" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


@pytest.mark.slow
def test_modules_of_the_present_folder_are_not_run(here):
    (here / "random.py").write_text("raise SystemExit('a folder of meshes is no place for code')")
    command = [
        sys.executable,
        "-P",
        "-m",
        "aoprecalc",
        "batch",
        "in",
        "-o",
        "out",
        *SMALL_SPHERES,
    ]  # as the script runs
    assert subprocess.run(command, cwd=here, capture_output=True, check=False).returncode == 0


def test_texts_of_options_add_up(here, command):
    words = ["--bake", "--size 64", "--bake", "-n 64", "--report", "out/"]
    assert command("batch", "in/a.obj", "-o", "out", *words).returncode == 0
    (asset,) = json.loads((here / "out/batch.json").read_text())["assets"]
    assert (asset["summary"]["size"], asset["summary"]["directions"]) == ([64, 64], 64)


def test_what_is_pruned_is_told(here, command):
    assert command("batch", "in", "-o", "out", *SMALL_SPHERES).returncode == 0
    done = command("batch", "in/a.obj", "-o", "out", *SMALL_SPHERES, "--prune")
    assert done.returncode == 0
    assert "removed the outputs of props/b, which is not among the assets any more" in done.stderr
    assert list(contents(here / "out")) == ["a_spheres.json"]
    assert not (here / "out/props").exists()


def test_a_failure_is_no_fault_of_ours_even_with_v(here, command):
    (here / "in/a.obj").write_text("f 1 2 3\n")
    done = command("batch", "in/a.obj", "-o", "out", *SMALL_SPHERES, "-v")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


def test_a_cache_among_the_meshes_is_no_input(here, command):
    for _ in range(2):
        done = command("batch", "in", "-o", "out", *SMALL_BAKE, "--cache", "in/store")
        assert done.returncode == 0
        assert done.stdout.splitlines()[-1].startswith("2 assets: ")
