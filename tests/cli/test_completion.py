"""Completion of command lines, in the shells themselves; and `--version`."""

import os
import re
import shutil
import subprocess
import sys
from importlib import metadata

import pytest

import aoprecalc
from aoprecalc.system import LIBRARIES

START = "import sys; sys.argv[0] = 'aoprecalc'; from aoprecalc.cli import main; main()"
HEAVY = {"numpy", "scipy", "moderngl", "trimesh", "rich", "OpenImageIO", "msgspec", "embreex"}
WORDS = ["aoprecalc", "bake", "--unwrap", ""]
OPTIONS = {"--size", "--backend", "--output", "--quiet"}


def aoprecalc_in(folder, *words, **variables):
    environment = os.environ | variables
    command = [sys.executable, "-c", START, *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """PATH with an `aoprecalc` in it, as an installation has."""
    folder = tmp_path_factory.mktemp("bin")
    (folder / "aoprecalc").write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{START}" "$@"\n')
    (folder / "aoprecalc").chmod(0o755)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def ask(shell, program, folder, path):
    """Run a program in a shell without its start-up files; the script of completions is in the file `script`."""
    (folder / "script").write_text(aoprecalc_in(folder, "completion", shell))
    plain = {"bash": ["--norc", "--noprofile"], "zsh": ["-f"], "fish": ["--no-config"]}[shell]
    prepared = "autoload -U compinit; compinit -u -D; " if shell == "zsh" else ""
    command = [shutil.which(shell), *plain, "-c", f"{prepared}. ./script\n{program}"]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


def in_bash(line, folder, path):
    """Return what Tab would offer at the end of a line, and what bash itself completes: files, folders, nothing."""
    words = line.split(" ")
    program = (
        f'compopt() {{ echo "options $1 $2"; }}; COMP_WORDS=({" ".join(word or chr(39) * 2 for word in words)})\n'
        f"COMP_CWORD={len(words) - 1}; _aoprecalc_completion aoprecalc; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    found = {word for word in ask("bash", program, folder, path) if word}
    left_to_bash = {word for word in found if word.startswith("options ")}
    return found - left_to_bash, left_to_bash


def bash_version():
    """The version of bash, (0, 0) where there is none."""
    if sys.platform == "win32" or shutil.which("bash") is None:
        return (0, 0)
    program = "echo ${BASH_VERSINFO[0]} ${BASH_VERSINFO[1]}"
    found = subprocess.run([shutil.which("bash"), "--norc", "-c", program], capture_output=True, text=True, check=True)
    return tuple(map(int, found.stdout.split()))


bash = pytest.mark.skipif(bash_version() < (4, 4), reason="bash 4.4 is not installed")


@bash
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("aoprecalc b", {"bake", "batch"}),
        ("aoprecalc cache ", {"info", "prune"}),
        ("aoprecalc bake mesh.obj --unwrap ", {"auto", "keep", "xatlas", "uvunwrap"}),
        ("aoprecalc spheres --method l", {"lloyd"}),
        ("aoprecalc bake --backe", {"--backend"}),
        ("aoprecalc completion ", {"bash", "zsh", "fish"}),
    ],
)
def test_bash_completes_commands_options_and_their_values(line, expected, tmp_path, path):
    assert in_bash(line, tmp_path, path) == (expected, set())


@bash
@pytest.mark.parametrize(
    "line",
    ["aoprecalc bake ", "aoprecalc compare a b", "aoprecalc batch a", "aoprecalc bake -o "],
)
def test_bash_completes_files_by_itself_where_one_is_expected(line, tmp_path, path):
    assert in_bash(line, tmp_path, path) == (set(), {"options -o default"})


@bash
def test_bash_completes_folders_where_one_is_expected(tmp_path, path):
    assert in_bash("aoprecalc cache info --cache ", tmp_path, path) == (set(), {"options -o dirnames"})


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish_completes(tmp_path, path):
    (tmp_path / "mesh.obj").touch()

    def offered(line):
        return {word.split("\t")[0] for word in ask("fish", f"complete -C {line!r}", tmp_path, path)}

    assert offered("aoprecalc b") == {"bake", "batch"}
    assert offered("aoprecalc bake --unwrap ") == {"auto", "keep", "xatlas", "uvunwrap"}
    assert "mesh.obj" in offered("aoprecalc bake me")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_takes_the_script_and_what_it_asks_for(tmp_path, path):
    """In a terminal of its own: zsh completes only where a line is edited."""
    program = (
        "zmodload zsh/zpty; zpty -b z 'zsh -f'\n"
        "zpty -w z 'autoload -U compinit; compinit -u -D; . ./script; print re\"\"ady'; zpty -r z said '*ready*'\n"
        "zpty -w -n z $'aoprecalc completion \\t\\t'; zpty -r z said '*bash*zsh*fish*'; print -r -- $said"
    )
    said = " ".join(ask("zsh", program, tmp_path, path))
    assert re.search(r"bash +zsh +fish", said)


def test_completion_is_quick_because_nothing_heavy_is_loaded():
    program = (
        "import os, sys; sys.argv = ['aoprecalc']\n"
        "os.environ.update(_AOPRECALC_COMPLETE='bash_complete', COMP_WORDS='aoprecalc bake --', COMP_CWORD='2')\n"
        "from aoprecalc.cli import main\n"
        "try: main()\n"
        f"finally: print(sorted({HEAVY} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "[]"
    assert {line.partition(",")[2] for line in done.stdout.splitlines()} >= OPTIONS


def version_of(name):
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # moderngl on macOS, say
        return "is not installed"


def test_the_version_names_what_counts_and_loads_none_of_it(command):
    lines = command("--version").stdout.splitlines()
    assert lines[0] == f"aoprecalc {aoprecalc.__version__}"
    assert lines[1].startswith(f"Python {sys.version.split()[0]}, ")
    assert lines[2:] == [f"{name} {version_of(name)}" for name in LIBRARIES]
    program = (
        "import sys; sys.argv = ['aoprecalc', '--version']\n"
        "from aoprecalc.cli import main\n"
        "try: main()\n"
        f"finally: print(sorted({HEAVY} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
