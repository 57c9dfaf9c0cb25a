"""What macOS and Windows do not have is nowhere needed: commands run where it is taken away, and bake by rays."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import aoprecalc
from aoprecalc import system
from shapes import torus

PACKAGE = Path(aoprecalc.__file__).parent
# May name what one system has, or load a library whose name differs.
GUARDED = {"system.py", "subprocesses.py", "gl/context.py", "visibility/embree.py"}
ONE_SYSTEM = {
    "os.fork", "os.forkpty", "os.getpgid", "os.killpg", "os.kill", "os.sched_getaffinity", "os.setsid", "os.symlink",
    "os.sysconf", "os.uname", "os.geteuid", "os.getuid", "os.mkfifo", "os.chown",
    "signal.SIGKILL", "signal.SIGALRM", "signal.SIGHUP", "signal.SIGCHLD", "signal.setitimer",
    "ctypes", "fcntl", "grp", "msvcrt", "multiprocessing", "pty", "pwd", "resource", "select", "termios", "winreg",
}  # fmt: skip

# Python runs one of these at the start of every process.
COMMON = """
import builtins, io, os, sys
def opened(file, *arguments, real=io.open, **options):
    if str(file).startswith(("/proc", "/sys", "/dev/shm")):
        raise FileNotFoundError(2, "No such file or directory", str(file))
    return real(file, *arguments, **options)
io.open = builtins.open = opened
del os.sched_getaffinity
"""
MACOS = (
    COMMON
    + """
import platform, sysconfig
platform.platform(), sysconfig.get_config_vars()  # kept: they would look for files of macOS
sys.platform = "darwin"
"""
)
WINDOWS = (
    COMMON
    + """
import fcntl, shutil, signal, subprocess, tempfile, types

def kill(self, real=os.kill, number=int(signal.SIGKILL)):
    if self.poll() is None:
        real(self.pid, number)
subprocess.Popen.kill = subprocess.Popen.terminate = kill

def start(self, *arguments, real=subprocess.Popen.__init__, **options):
    assert not {"pass_fds", "preexec_fn", "start_new_session"} & set(options)
    real(self, *arguments, **options)
subprocess.Popen.__init__ = start

def while_closed(real):
    def change(*paths, **options):
        links = [f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd")]
        held = {os.readlink(link) for link in links if os.path.islink(link)}
        for path in map(os.path.realpath, paths):
            if path in held:
                raise PermissionError(13, "it is open", path)
        return real(*paths, **options)
    return change
for name in ("remove", "rename", "replace", "unlink"):
    setattr(os, name, while_closed(getattr(os, name)))
shutil._use_fd_functions = False
tempfile.TemporaryFile = tempfile.NamedTemporaryFile

msvcrt = types.ModuleType("msvcrt")
msvcrt.LK_NBLCK = 2
def locking(descriptor, mode, count, flock=fcntl.flock):
    assert (mode, count) == (2, 1)
    flock(descriptor, fcntl_flags)
fcntl_flags = fcntl.LOCK_EX | fcntl.LOCK_NB
msvcrt.locking = locking
for name in ("fcntl", "grp", "moderngl", "pwd", "resource", "termios"):
    sys.modules[name] = None
sys.modules["msvcrt"] = msvcrt
for name in ("fork", "forkpty", "geteuid", "getpgid", "getuid", "kill", "killpg", "setsid", "symlink", "sysconf"):
    delattr(os, name)
for name in ("SIGKILL", "SIGALRM", "SIGHUP", "SIGCHLD", "setitimer"):
    delattr(signal, name)

import aoprecalc.subprocesses, aoprecalc.system

class Windows(types.ModuleType):  # the module sys for these two; others would look for more of Windows
    platform = "win32"
    def __getattr__(self, name):
        return getattr(sys, name)
aoprecalc.subprocesses.sys = aoprecalc.system.sys = Windows("sys")
"""
)
QUICK = ["--size", "64", "-n", "64"]


def names_used(path):
    """Yield the modules that a file imports, and the attributes of modules that it names."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module).split(".")[0]
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Constant) and str(node.value).startswith(("/proc", "/sys", "/dev")):
            yield str(node.value)


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_what_one_system_has_is_named_in_few_places(path):
    if path.relative_to(PACKAGE).as_posix() not in GUARDED:
        found = set(names_used(path))
        assert not {name for name in found if name in ONE_SYSTEM or name.startswith("/")}


@pytest.fixture
def run(tmp_path):
    """run(system, *words): `aoprecalc` without what that system does not have, nor its children."""
    (tmp_path / "work").mkdir()
    positions, faces = torus(around=24, across=12)
    lines = ["OFF", f"{len(positions)} {len(faces)} 0", *("{:.5f} {:.5f} {:.5f}".format(*point) for point in positions)]
    text = "\n".join([*lines, *("3 {} {} {}".format(*corners) for corners in faces)])
    for name in ("ring.off", "copy.off"):
        (tmp_path / "work" / name).write_text(text + "\n")

    def run_in(start, *words, code=0):
        (tmp_path / "sitecustomize.py").write_text(start)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
        command = [sys.executable, "-m", "aoprecalc", *words]
        done = subprocess.run(
            command, cwd=tmp_path / "work", env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        return done

    return run_in


linux = pytest.mark.skipif(sys.platform != "linux", reason="takes away what Linux has")
systems = pytest.mark.parametrize("start", [MACOS, WINDOWS], ids=["macos", "windows"])


@linux
@pytest.mark.slow
@systems
def test_a_bake_falls_to_rays_is_measured_and_compared(start, run):
    done = run(start, "bake", "ring.off", *QUICK, "--memory-limit", "4G", code=0 if start is MACOS else 2)
    if start is WINDOWS:
        assert "--memory-limit needs to know how much memory is used" in done.stderr
        done = run(start, "bake", "ring.off", *QUICK)
    (note,) = (line for line in done.stderr.splitlines() if "tracing rays" in line)
    assert f"{'macOS' if start is MACOS else 'Windows'} has none that works without a display" in note
    assert json.loads(run(start, "verify", "ring_ao.glb", "--json").stdout)["levels"][0]["rmse"] < 0.1
    assert run(start, "preview", "ring_ao.glb", "--size", "64").stdout.startswith("ring_ao_preview.png")
    run(start, "bake", "ring.off", *QUICK, "-o", "again/")
    run(start, "bake", "ring.off", *QUICK, "-o", "again/")  # over the files of the first
    run(start, "compare", "ring_ao.png", "again/ring_ao.png", "--tolerance", "0")
    run(start, "compare", "ring_ao.glb", "again/ring_ao.glb", "--tolerance", "0")


@linux
@pytest.mark.slow
@systems
def test_spheres_and_a_batch(start, run):
    run(start, "spheres", "ring.off", "-n", "12", "-s", "2000")
    words = [
        "batch",
        "ring.off",
        "copy.off",
        "-o",
        "out",
        "--bake",
        " ".join(QUICK),
        "--spheres",
        "-n 12 -s 2000",
        "--jobs",
        "2",
    ]
    words += ["--cache", "cache", "--json"]
    done = run(start, *words)
    assert json.loads(done.stdout)["counts"]["made"] == 2
    assert sum("tracing rays" in line for line in done.stderr.splitlines()) == 1
    assert json.loads(run(start, *words).stdout)["counts"]["unchanged"] == 2
    words[4] = "other"
    assert json.loads(run(start, *words).stdout)["counts"]["cached"] == 2


@linux
@pytest.mark.slow
@systems
def test_doctor_passes_and_names_nothing_that_cannot_be_had(start, run):
    report = json.loads(run(start, "doctor", "--json").stdout)
    assert report["auto"]["name"] == "Embree"
    assert report["passed"]
    assert not any("OpenGL" in hint["what"] for hint in report["install"])


@pytest.mark.parametrize("name", ["CON", "con.asset", "LPT1", "a:b", "a\\b", "what?", "dot.", "space "])
def test_windows_takes_no_such_name(name, monkeypatch):
    assert system.may_name_a_file(name)
    monkeypatch.setattr(sys, "platform", "win32")
    assert not system.may_name_a_file(name)


def test_other_names_are_names_everywhere(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    assert all(map(system.may_name_a_file, ["rock", "rock.v2", "Felsen (groß)", "console", "com10", "rocher_ao.png"]))


def test_a_path_on_another_drive_stays_absolute(monkeypatch):
    def relpath(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    assert system.path_from(Path("a/b/c.png"), Path("a/d")) == "../b/c.png"
    monkeypatch.setattr(os.path, "relpath", relpath)
    assert system.path_from(Path("/a/b/c.png"), Path("/a/d")) == "/a/b/c.png"
