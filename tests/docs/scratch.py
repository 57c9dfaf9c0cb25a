"""What the code of the documentation finds where it is run: meshes, the examples, and the commands as if installed."""

import os
import runpy
import shutil
import sys
from pathlib import Path

import aoprecalc
from docs.pages import ROOT

BIN = {
    "aoprecalc": 'exec "{python}" -m aoprecalc "$@"',
    "python": 'exec "{python}" "$@"',
    "make": 'PATH="$PATH_OUTSIDE" exec make -n -C "{root}" "$@" > /dev/null',  # is there such a target?
}


def furnish(folder: Path) -> None:
    """Put everything into a folder."""
    runpy.run_path(str(ROOT / "docs/sample_meshes.py"))["write"](folder)
    shutil.copytree(ROOT / "examples", folder / "examples")
    shutil.copytree(ROOT / "docs", folder / "docs", ignore=shutil.ignore_patterns("_build"))
    commands = folder / ".venv/bin"
    commands.mkdir(parents=True)
    for name, line in BIN.items():
        (commands / name).write_text(f"#!/bin/sh\n{line.format(python=sys.executable, root=ROOT)}\n")
        (commands / name).chmod(0o755)


def environment(folder: Path) -> dict[str, str]:
    """Return the variables for commands that run in such a folder."""
    source = str(Path(aoprecalc.__file__).parents[1])
    outside = os.environ["PATH"]
    path = os.pathsep.join([str(folder / ".venv/bin"), outside])
    cache = str(folder / ".cache")  # a cache of its own
    return os.environ | {"PATH": path, "PATH_OUTSIDE": outside, "PYTHONPATH": source, "AOPRECALC_CACHE": cache}
