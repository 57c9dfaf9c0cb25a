"""Both ends of a child process, for work that cannot be interrupted or that a fault of its own may stop for ever.

The child reads one request from standard input and writes one answer to standard output. On standard error it says each
step that it comes to, one a line, and where it fails, last of all why.
"""

import ctypes
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from tempfile import TemporaryFile

StepCallback = Callable[[str], None]  # is called with the step under way, again and again; what it raises ends the work

POLL = 0.05  # seconds between two looks at the work
FIRST_STEP = "starting"

# What a thread written in Rust says before it dies, and the others wait for it: where, and on the next line why.
_PANIC = re.compile(rb"^thread .* panicked at .*\n(.*)\n", re.MULTILINE)

_KILLS = ("SIGKILL", "SIGTERM", "SIGINT")  # come from outside, whatever the work is

_STEP = "step: "  # begins the lines that are steps
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def command(module: str, *words: str) -> list[str]:
    """Return the command line of a child that runs a module of this package."""
    return [sys.executable, "-P", "-m", module, *words]  # -P: no modules of the current folder


def environment() -> dict[str, str]:
    """Return the variables with which a child finds what this process found."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


class ChildKilledError(ChildProcessError):
    """The child was killed from outside, such as by a system that is out of memory."""


def ask(command: list[str], request: bytes, look: StepCallback) -> bytes:
    """Return the child's answer; the child is gone when this returns or raises, whatever it raises.

    Raises ChildProcessError with the reason, one line, where the child fails, ChildKilledError where it was killed.
    """
    with TemporaryFile() as file:  # no pipe: `communicate` does not go on writing to one after a pause
        file.write(request)
        file.seek(0)
        child = subprocess.Popen(command, stdin=file, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment())
    with child:
        try:
            answer, said = _listen(child, look)
        except BaseException:
            child.kill()
            child.wait()  # `with` alone does not, after a Ctrl-C
            raise
    if child.returncode != 0:
        killed = child.returncode < 0 and signal.Signals(-child.returncode).name in _KILLS
        kind = ChildKilledError if killed else ChildProcessError
        raise kind(_reason(child.returncode, said))
    return answer


def _listen(child: "subprocess.Popen[bytes]", look: StepCallback) -> tuple[bytes, bytes]:
    """Return all that the child writes to standard output and standard error, neither of which fills up meanwhile."""
    while True:
        try:
            return child.communicate(timeout=POLL)
        except subprocess.TimeoutExpired as pause:  # nothing is lost: the next call returns it all
            said = pause.stderr or b""
            if panic := _PANIC.search(said):
                reason = panic[1].decode(errors="replace").strip()
                raise ChildProcessError(f"a fault inside it ({reason})") from pause
            look(_heard(said)[0])


def _heard(said: bytes) -> tuple[str, str]:
    """Return the last step and the last other line of what a child has said so far."""
    step, other = FIRST_STEP, ""
    for line in said.decode(errors="replace").splitlines():
        if line.startswith(_STEP):
            step = line.removeprefix(_STEP)
        elif line.strip():
            other = line.strip()
    return step, other


def _reason(status: int, said: bytes) -> str:
    step, last = _heard(said)
    if status >= 0:
        return last or f"exit status {status}"
    hint = ", as a system does that is out of memory; free some" if status == -signal.SIGKILL else ""
    return f"signal {-status} ({signal.strsignal(-status)}) ended it at: {step}{hint}"


def say_step(step: str) -> None:
    """In the child: say what comes next."""
    print(f"{_STEP}{step}", file=sys.stderr, flush=True)


def end_with_parent() -> None:
    """In the child, before its first step: be killed when the parent dies, even of SIGKILL.

    A thread that watches the parent would not do: it gets no turn while the work holds the interpreter. Where the
    parent is dead already, and on systems other than Linux, the child ends at its next step: nobody hears it.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
