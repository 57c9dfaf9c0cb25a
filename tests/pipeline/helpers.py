"""Small meshes, small orders, and the ways in which these tests run batches."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aoprecalc.errors import AoprecalcError
from aoprecalc.options import BakeOptions, SphereOptions
from shapes import torus, triangle_a_cell

BAKE, SPHERES = BakeOptions(size=64, directions=64), SphereOptions(8, samples=500)
SMALL_BAKE, SMALL_SPHERES = ["--bake", "--size 64 -n 64"], ["--spheres", "-n 8 -s 500"]
STATE_FOLDER = ".aoprecalc"  # what a batch remembers, in its output folder
PATIENCE = 60  # seconds until a test gives up on what takes a second


def write_ring(path, minor=0.4, **lines):
    """An OBJ of a ring, with UVs that hold a bake; `lines`: keyword -> what follows it, at the top."""
    positions, faces = torus(minor=minor, around=8, across=4)
    text = [f"{keyword} {rest}" for keyword, rest in lines.items()]
    text += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions]
    text += [f"vt {u:.9g} {v:.9g}" for u, v in triangle_a_cell(len(faces)).reshape(-1, 2)]
    text += [f"f {a}/{3 * face + 1} {b}/{3 * face + 2} {c}/{3 * face + 3}" for face, (a, b, c) in enumerate(faces + 1)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(text) + "\n")
    return path


def run(folder, *words, **environment):
    """Run `aoprecalc` in a folder as a shell would; `environment`: variables beside those that are."""
    return subprocess.run(
        [sys.executable, "-m", "aoprecalc", *map(str, words)],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def error_of(done):
    """The one line of error of a command that has failed."""
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    assert done.stderr.splitlines()[-1] == errors[0]
    assert "Traceback" not in done.stderr
    return errors[0]


def contents(folder):
    """What the files below a folder hold, by their way from there; without what a batch remembers."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in files
        if STATE_FOLDER not in path.relative_to(folder).parts
    }


def without_times(files):
    """The same without what differs between any two runs: the seconds of reports."""

    def plain(name, data):
        return {**json.loads(data), "seconds": None} if name.endswith("_report.json") else data

    return {name: plain(name, data) for name, data in files.items()}


def statuses(result):
    """What became of each asset, by its name."""
    return {entry.asset.name: entry.status for entry in result.results}


def said(call, *given, **options):
    """The message of the error that a call raises, and its exit code."""
    with pytest.raises(AoprecalcError) as failure:
        call(*given, **options)
    assert "\n" not in str(failure.value)
    return str(failure.value), failure.value.exit_code


def wait_until(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def running_in(folder):
    """The processes whose present folder is that, but for this one."""
    found = []
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and Path(os.readlink(process / "cwd")) == folder:
                found.append(int(process.name))
        except OSError:  # it ended at this moment, or has ended and nobody has asked
            continue
    return [process for process in found if process != os.getpid()]
