"""Start, watch, time out and end child processes; both ends of the two ways to talk to one.

`ask`          one request on standard input, one answer on standard output; on standard error the child reports each
               step that it begins and, if it fails, why. For the unwrappers and for the probes of `doctor`: work that
               cannot be interrupted, or that a driver may crash or hang
`DuplexChild`  a long-lived child that answers requests, with `serve` at its end. For batch workers

Every child runs a module of this package, or a test's program, and is killed when its parent gives up, fails or dies.
"""

import ctypes
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from tempfile import TemporaryFile
from types import TracebackType
from typing import IO, Any

StepCallback = Callable[[str], None]

POLL_SECONDS = 0.05  # between two checks of a child, its deadline and a request to stop
FIRST_STEP = "starting"

_STEP_PREFIX = "step: "  # of lines on standard error that report a step
_LOG_TAIL = 2000  # bytes of a long-lived child's log that are read to explain its death
_KILLS = [getattr(signal, name, None) for name in ("SIGKILL", "SIGTERM", "SIGINT")]  # sent by others
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LENGTH_BYTES = 8  # of the length before each message of a DuplexChild

# What Rust prints when a thread panics (where, and on the next line why); other threads may wait for it forever.
_PANIC = re.compile(rb"^thread .* panicked at .*\n(.*)\n", re.MULTILINE)


class ChildKilledError(ChildProcessError):
    """The child was killed from outside, for instance by a system that is out of memory."""


class ChildTimeoutError(Exception):
    """The child did not answer in time.

    step   the last step that it reported
    """

    def __init__(self, seconds: float, step: str) -> None:
        """Name the limit and the step."""
        super().__init__(f"no answer within {seconds:g} s")
        self.step = step


class ChildStoppedError(Exception):
    """The `stop` event was set before the child answered."""


def command(module: str, *arguments: str) -> list[str]:
    """Return the command line of a child that runs a module of this package."""
    return [sys.executable, "-P", "-m", module, *arguments]  # -P: import nothing from the current folder


def ask(
    command: list[str],
    request: bytes = b"",
    on_step: StepCallback | None = None,
    *,
    timeout: float | None = None,
    stop: threading.Event | None = None,
) -> bytes:
    """Return the answer of a child to one request; the child has ended when this returns or raises.

    on_step   called every POLL_SECONDS with the child's current step; may raise to end the child
    timeout   seconds until the child is killed; None: no limit
    stop      kills the child when it is set
    Raises ChildProcessError with a one-line reason if the child fails, ChildKilledError if it was killed,
    ChildTimeoutError, ChildStoppedError.
    """
    limits = _Limits(timeout, stop)
    with TemporaryFile() as stdin:  # not a pipe: `communicate` does not resume writing to one after a time-out
        stdin.write(request)
        stdin.seek(0)
        child = _Child(command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    with child:
        while True:
            try:
                answer, log = child.communicate(timeout=POLL_SECONDS)
                break
            except subprocess.TimeoutExpired as pause:  # the next call returns all output, this part included
                log = pause.stderr or b""
            if panic := _PANIC.search(log):
                raise ChildProcessError(f"a fault inside it ({panic[1].decode(errors='replace').strip()})")
            step = _parse_log(log)[0]
            if on_step is not None:
                on_step(step)
            limits.check(step)
    if child.returncode == 0:
        return answer
    step, message = _parse_log(log)
    if child.returncode > 0:
        raise ChildProcessError(message or exit_reason(child.returncode))
    raise (ChildKilledError if -child.returncode in _KILLS else ChildProcessError)(
        f"{exit_reason(child.returncode)} ended it at step: {step}"
    )


class DuplexChild:
    """A long-lived child process, started at once, that answers one request after the other.

    Requests go to its standard input and answers come from its standard output, pickled; what it prints goes to a log.
    It leads a process group of its own: Ctrl-C does not reach it, and `close` ends what it has started, too.
    """

    def __init__(self, module: str) -> None:
        """Start a module that calls `serve`; raises OSError if no process can be started."""
        self._log = TemporaryFile()  # noqa: SIM115 - open as long as the process
        pipe = subprocess.PIPE
        try:
            start = command(module, str(os.getpid()))
            self._process = _Child(start, stdin=pipe, stdout=pipe, stderr=self._log, own_group=True)
        except OSError:
            self._log.close()
            raise
        self._received: SimpleQueue[bytes | None] = SimpleQueue()
        # A thread, as there is no portable way to wait for a pipe with a time-out.
        self._reader = threading.Thread(target=self._receive, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def is_alive(self) -> bool:
        """Tell whether the process runs."""
        return self._process.poll() is None

    def request(
        self, message: Any, on_step: StepCallback, *, timeout: float | None = None, stop: threading.Event | None = None
    ) -> Any:
        """Send a message and return the answer: the first object in return that is not a text.

        on_step   called with each text, the step that the child begins
        Raises ChildProcessError with a one-line reason if the child dies, ChildTimeoutError, ChildStoppedError; after
        any of them only `close` is of use.
        """
        limits, step = _Limits(timeout, stop), FIRST_STEP
        assert self._process.stdin is not None
        try:
            _send(self._process.stdin, message)
        except OSError as error:  # the pipe ends with the process
            raise self._death() from error
        while True:
            try:
                data = self._received.get(timeout=POLL_SECONDS)
            except Empty:
                limits.check(step)
                continue
            if data is None:
                raise self._death()
            if not isinstance(answer := pickle.loads(data), str):
                return answer
            on_step(step := answer)
            limits.check(step)

    def close(self) -> None:
        """End the process and all that it has started."""
        self._process.end()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # a part of a request that was not sent
                stream.close()
        self._log.close()

    def _receive(self) -> None:
        """Queue the messages of the child, and None after the last."""
        assert self._process.stdout is not None
        while (data := _receive(self._process.stdout)) is not None:
            self._received.put(data)
        self._received.put(None)

    def _death(self) -> ChildProcessError:
        status = self._process.wait()
        self._log.seek(max(0, self._log.seek(0, os.SEEK_END) - _LOG_TAIL))
        line = _parse_log(self._log.read())[1]
        reason = exit_reason(status) + (f"; its last output is {line[:160]!r}" if line else "")
        return (ChildKilledError if -status in _KILLS else ChildProcessError)(reason)


def exit_reason(status: int) -> str:
    """Return an exit status, or the signal that ended a process (a negative one), in words."""
    if status >= 0:
        return f"exit status {status}"
    hint = "; the system may be out of memory" if -status == _KILLS[0] else ""
    return f"signal {-status} ({signal.strsignal(-status)}{hint})"


class _Child(subprocess.Popen[bytes]):
    """A process that is killed at the end of a `with` block, if it still runs."""

    def __init__(self, command: list[str], *, own_group: bool = False, **options: Any) -> None:
        """Start it with the import path of this process; `own_group`: as the leader of a new process group."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        if own_group and hasattr(os, "killpg"):
            options["start_new_session"] = True
        elif own_group:
            options["creationflags"] = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)  # Windows
        super().__init__(command, env=environment, **options)
        self._own_group = own_group

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Kill it; without that, the base class would wait for it."""
        self.end()
        super().__exit__(kind, error, trace)

    def end(self) -> None:
        """Kill the process, with its group if it leads one, and wait until it has ended."""
        if self._own_group:
            _kill_group(self.pid)
        self.kill()
        self.wait()


def _kill_group(pid: int) -> None:
    """Kill a process and what it has started, as far as it runs."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
    else:
        with suppress(OSError):
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(pid)], capture_output=True, check=False)


class _Limits:
    """A deadline and a stop event."""

    def __init__(self, timeout: float | None, stop: threading.Event | None) -> None:
        """Start the clock."""
        self._timeout, self._stop = timeout, stop
        self._started = time.monotonic()

    def check(self, step: str) -> None:
        """Raise ChildStoppedError or ChildTimeoutError if a limit is reached; `step` is where the child is."""
        if self._stop is not None and self._stop.is_set():
            raise ChildStoppedError("was stopped")
        if self._timeout is not None and time.monotonic() - self._started > self._timeout:
            raise ChildTimeoutError(self._timeout, step)


class Watch:
    """For work in this process: shows its steps and keeps its deadline, as `ask` does for a child."""

    def __init__(self, on_step: StepCallback | None, timeout: float | None) -> None:
        """Start the clock; see `ask`."""
        self._on_step, self._limits = on_step, _Limits(timeout, None)
        self._next = 0.0

    def __call__(self, step: str) -> None:
        """Show the step that the work is at, every POLL_SECONDS; raises ChildTimeoutError after the deadline."""
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + POLL_SECONDS
        if self._on_step is not None:
            self._on_step(step)
        self._limits.check(step)


def _parse_log(log: bytes) -> tuple[str, str]:
    """Return the last step and the last other line of what a child has written to standard error."""
    step, other = FIRST_STEP, ""
    for line in log.decode(errors="replace").splitlines():
        if line.startswith(_STEP_PREFIX):
            step = line.removeprefix(_STEP_PREFIX)
        elif line.strip():
            other = line.strip()
    return step, other


# The child's end.


def report_step(step: str) -> None:
    """In a child of `ask`: report the step that begins."""
    print(f"{_STEP_PREFIX}{step}", file=sys.stderr, flush=True)


def end_with_parent() -> None:
    """In a child, before its first step: have Linux kill it when the parent dies, even of SIGKILL.

    A thread that watches the parent would not do: it does not run while the work holds the interpreter lock. If the
    parent is dead already, and on other systems, the child ends at its next step, as its pipe is closed.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def serve(answer: Callable[[Any, StepCallback], Any]) -> None:
    """In a DuplexChild: answer requests until the parent closes the pipe or dies.

    answer   called with each request and with a callback for steps; returns the answer, which is not a text
    """
    end_with_parent()
    if sys.platform == "linux" and os.getppid() != int(sys.argv[1]):  # the parent died before that
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C ends
    # Streams of our own: what libraries print goes to the log, and they find nothing to read.
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)

    def say(message: Any) -> None:
        try:
            _send(answers, message)
        except OSError:
            sys.exit()  # the parent is gone

    while (data := _receive(requests)) is not None:
        say(answer(pickle.loads(data), say))


# Messages in a pipe: the number of bytes, and a pickled object.


def _send(stream: IO[bytes], message: Any) -> None:
    """Write a message; raises OSError if the other end is closed."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    stream.write(len(data).to_bytes(_LENGTH_BYTES, "little"))
    stream.write(data)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes | None:
    """Read a pickled message; None if the other end is closed."""
    try:
        length = stream.read(_LENGTH_BYTES)
        data = stream.read(int.from_bytes(length, "little"))
    except OSError:
        return None
    return data if len(length) == _LENGTH_BYTES and len(data) == int.from_bytes(length, "little") else None
