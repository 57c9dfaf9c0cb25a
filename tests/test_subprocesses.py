"""A child process for an unwrapper: what it says is heard, and it never outlives the one who asked."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from aoprecalc.subprocesses import ChildKilledError, ChildStoppedError, ChildTimeoutError, ask
from shapes import torus

PATIENCE = 20  # seconds until a test gives up on what takes a tenth of a second
TALK = "import os, sys, time\ndef say(step): print('step:', step, file=sys.stderr, flush=True)\n"

linux = pytest.mark.skipif(
    sys.platform != "linux", reason="reads /proc; and a parent's death is a signal on Linux only"
)


def python(program):
    return [sys.executable, "-c", program]


def state(pid):
    """Return a process's state letter and its parent; Z for none at all."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return "Z", 0
    return words[0], int(words[1])


def children(pid):
    """Return the children of a process, dead ones that it has not waited for included."""
    everyone = (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit())
    return [one for one in everyone if state(one)[1] == pid]


def wait_until(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_payloads_beyond_any_pipe_pass_both_ways_while_the_child_talks():
    """It talks and answers before it has read, pauses half-way, and reads on."""
    program = TALK + (
        "for k in range(2000): say('x' * 200); sys.stdout.buffer.write(bytes(4096))\n"
        "half = sys.stdin.buffer.read(10_000_000); time.sleep(0.3)\n"
        "sys.stdout.buffer.write(half + sys.stdin.buffer.read())\n"
    )
    request = os.urandom(20_000_000)
    assert ask(python(program), request, lambda step: None) == bytes(2000 * 4096) + request


def test_steps_are_heard_while_the_child_works(tmp_path):
    """It waits at each step for the file that whoever hears of the step makes."""
    program = TALK + (
        "for step in ('sawing', 'glueing, try 1 of 2'):\n"
        "    say(step); print('a word of another kind', file=sys.stderr)\n"
        f"    while not os.path.exists(os.path.join({str(tmp_path)!r}, step)): time.sleep(0.01)\n"
        "print('a table', end='')\n"
    )
    heard = []

    def look(step):
        heard.append(step)
        (tmp_path / step).touch()

    assert ask(python(program), b"", look) == b"a table"
    assert [step for step in dict.fromkeys(heard) if step != "starting"] == ["sawing", "glueing, try 1 of 2"]


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        ("sys.exit('no wood; plant trees')", "no wood; plant trees"),
        ("raise MemoryError('std::bad_alloc')", "MemoryError: std::bad_alloc"),
        ("sys.exit(3)", "exit status 3"),
        ("os.kill(os.getpid(), 9)", "signal 9 (Killed; the system may be out of memory) ended it at step: sawing"),
        ("os.kill(os.getpid(), 11)", "signal 11 (Segmentation fault) ended it at step: sawing"),
    ],
)
def test_a_child_that_fails_says_why(end, reason):
    with pytest.raises(ChildProcessError) as failure:
        ask(python(TALK + "say('sawing'); " + end), bytes(1_000_000), lambda step: None)
    assert str(failure.value) == reason


def test_a_time_out_ends_the_child_and_names_its_step():
    with pytest.raises(ChildTimeoutError, match=r"no answer within 1 s") as failure:
        ask(python(TALK + "say('sawing'); time.sleep(600)"), timeout=1)
    assert failure.value.step == "sawing"


def test_an_event_stops_the_child():
    stop = threading.Event()
    with pytest.raises(ChildStoppedError):
        ask(python(TALK + "say('sawing'); time.sleep(600)"), on_step=lambda step: stop.set(), stop=stop)


def test_a_child_that_others_kill_is_told_apart():
    with pytest.raises(ChildKilledError):
        ask(python("import os; os.kill(os.getpid(), 15)"))


def interrupt_soon():
    """Do as Ctrl-C does, at a moment when the child is being listened to."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.02)


def give_up():
    raise TimeoutError


@linux
@pytest.mark.parametrize(("event", "raised"), [(interrupt_soon, KeyboardInterrupt), (give_up, TimeoutError)])
def test_whatever_ends_the_wait_ends_the_child(event, raised):
    """Not even an entry in the table of processes stays; the child is deaf to politer signals."""
    program = TALK + (
        "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "say(os.getpid()); time.sleep(600)\n"
    )
    pids = []

    def look(step):
        if step.isdigit() and not pids:
            pids.append(int(step))
            event()

    with pytest.raises(raised):
        ask(python(program), bytes(1_000_000), look)
    assert not Path(f"/proc/{pids[0]}").exists()


@pytest.fixture
def endless(tmp_path):
    """A surface so rough that xatlas takes minutes for its charts, and answers nothing meanwhile."""
    positions, faces = torus(around=200, across=100)
    rough = positions + np.random.default_rng(0).normal(scale=0.02, size=positions.shape)
    lines = [*(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in rough), *(f"f {a} {b} {c}\n" for a, b, c in faces + 1)]
    path = tmp_path / "rough.obj"
    path.write_text("".join(lines))
    return path


@linux
@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGTERM, signal.SIGKILL))]
)
def test_xatlas_does_not_outlive_a_bake(number, endless):
    command = [sys.executable, "-m", "aoprecalc", "bake", endless, "--unwrap", "xatlas", "--size", "64"]
    bake = subprocess.Popen(command, cwd=endless.parent, stderr=subprocess.PIPE, text=True)
    child = None
    try:
        wait_until(lambda: children(bake.pid))
        (child,) = children(bake.pid)
        wait_until(lambda: b"aoprecalc.uv.unwrap" in Path(f"/proc/{child}/cmdline").read_bytes())
        time.sleep(1.5)  # by now it has most likely begun; what follows is true of any moment
        assert state(child)[0] != "Z"
        bake.send_signal(number)
        said = bake.communicate(timeout=PATIENCE)[1]
        wait_until(lambda: state(child)[0] == "Z")
    finally:
        bake.kill()
        if child is not None and state(child)[0] != "Z":
            os.kill(child, signal.SIGKILL)
    assert [path.name for path in endless.parent.iterdir()] == ["rough.obj"]
    if number != signal.SIGKILL:
        assert bake.returncode == 130
        assert said.splitlines()[-1] == "error: interrupted; no output was written"
