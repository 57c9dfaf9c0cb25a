"""The parent's end of a worker process: whatever happens to the process, it is the outcome of one job."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from queue import SimpleQueue
from tempfile import TemporaryFile
from typing import Any, Protocol

from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.jobs import Failure, Job, Outcome
from aoprecalc.pipeline.visibility_task import VisibilityTask
from aoprecalc.subprocesses import command, environment
from aoprecalc.system import usable_memory, whole_cores

Request = Job | VisibilityTask

POLL = 0.05  # seconds between two looks at the clock and at whether to stop
_MOST_JOBS = 100  # of one process: what libraries leak does not grow without bounds
_LAST_WORDS = 2000  # bytes of what a dying process said last


class WorkerProcess:
    """A worker process, started for the first job and again after it died."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._process: subprocess.Popen[bytes] | None = None
        self._done = 0
        self._busy = threading.Lock()
        self._alarm: threading.Timer | None = None

    def run(
        self,
        request: Request,
        tell: Callable[[str], None],
        *,
        timeout: float | None = None,
        retries: int = 0,
        stop: threading.Event | None = None,
    ) -> Any:
        """Return the outcome of a job (Made or Failure), or of a glance (Seen or Failure).

        tell      is called with each stage that a job comes to
        timeout   seconds, after which the process is killed
        retries   how often a job whose process died is tried again
        stop      kills the process when it is set
        """
        started = time.monotonic()
        if self._alarm is not None:
            self._alarm.cancel()
        with self._busy:
            for attempt in range(retries + 1):
                outcome = self._once(request, tell, timeout, stop or threading.Event())
                if not isinstance(outcome, Failure) or outcome.kind != "crash":
                    break
                if attempt < retries:
                    tell(f"again, as its process died ({attempt + 1})")
        return replace(outcome, seconds=time.monotonic() - started)

    def close(self) -> None:
        """End the process and all that it has started."""
        if self._process is None:
            return
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._connection.close()
        self._said.close()
        self._process = None

    def close_after(self, seconds: float) -> None:
        """End the process once it was idle for that long."""
        self._alarm = threading.Timer(seconds, self.close_if_idle)
        self._alarm.daemon = True
        self._alarm.start()

    def close_if_idle(self) -> None:
        """End the process unless another thread has it do a job."""
        if self._busy.acquire(blocking=False):
            try:
                self.close()
            finally:
                self._busy.release()

    def _once(self, request: Request, tell: Callable[[str], None], timeout: float | None, stop: threading.Event) -> Any:
        try:
            outcome = self._ask(request, tell, timeout, stop)
        except (EOFError, OSError) as error:  # the connection ends with the process
            outcome = Failure("crash", self._why_dead(request, error))
        self._done += 1
        if (isinstance(outcome, Failure) and outcome.kind != "error") or self._done >= _MOST_JOBS:
            self.close()
        return outcome

    def _ask(self, request: Request, tell: Callable[[str], None], timeout: float | None, stop: threading.Event) -> Any:
        if self._process is None or self._process.poll() is not None:
            self._start()
        self._connection.send(request)
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            if self._connection.poll(POLL):
                message = self._connection.recv()
                if not isinstance(message, str):
                    return message
                tell(message)
            elif stop.is_set():
                return Failure("stopped", f"{request.shown}: was stopped")
            elif end is not None and time.monotonic() > end:
                return Failure(
                    "timeout",
                    f"{request.shown}: took longer than {timeout:g} s; allow more (--timeout) or ask for less",
                )

    def _start(self) -> None:
        self.close()
        self._connection, far = Pipe()
        self._said = TemporaryFile()  # noqa: SIM115 - it lives as long as the process
        descriptor = far.fileno()
        # What a library prints is kept apart: standard output is for results, and a table may be on standard error.
        self._process = subprocess.Popen(
            command("aoprecalc.pipeline.worker", str(descriptor), str(os.getpid())),
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=self._said,
            pass_fds=[descriptor],
            start_new_session=True,  # Ctrl-C does not reach it, and its own children can be killed with it
            env=environment(),
        )
        far.close()
        self._done = 0

    def _why_dead(self, request: Request, error: Exception) -> str:
        if self._process is None:
            return f"{request.shown}: no process for it could be started ({error}); use fewer --jobs"
        status = self._process.wait()
        reason = f"exit status {status}"
        if status < 0:
            reason = signal.strsignal(-status) or f"signal {-status}"
            if status == -signal.SIGKILL:
                reason += ", as a system does that is out of memory: use fewer --jobs or a smaller size"
        self._said.seek(max(0, self._said.seek(0, os.SEEK_END) - _LAST_WORDS))
        lines = self._said.read().decode(errors="replace").strip().splitlines()
        said = f"; it said {lines[-1].strip()[:160]!r}" if lines else ""
        return f"{request.shown}: its process died ({reason}{said})"


# Who does the jobs of a batch, and the crew that is on this machine.

_OF_JOB = 1 << 30  # bytes of memory that a job may take


@dataclass(frozen=True)
class JobEvent:
    """What happened to a job: it came to a stage, or it has an outcome."""

    job: Job
    stage: str = ""
    outcome: Outcome | None = None


class WorkerPool(Protocol):
    """Does jobs.

    threads   that one job is to use, where its order says nothing; 0: all cores of where it runs
    """

    threads: int

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
        """Yield events until each job has had its outcome, once; closing the iterator ends the work."""
        ...


class ProcessPool:
    """Processes on this machine, each with a thread here that waits for it."""

    def __init__(self, count: int, options: BatchOptions) -> None:
        """Have as many processes as the options say and `count` jobs need, started when there is work."""
        jobs = 1 if options.split else options.jobs or _default_jobs()
        self._size = max(1, min(jobs, count))
        self._options = options
        # who has set this has decided
        self.threads = 0 if "LP_NUM_THREADS" in os.environ else max(1, whole_cores() // self._size)

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
        """See Crew."""
        events: SimpleQueue[JobEvent] = SimpleQueue()
        stop = threading.Event()
        left = iter(jobs)  # the next of a list is taken in one step, which threads do not divide
        timeout, retries = self._options.timeout, self._options.retries

        def attend() -> None:
            child = WorkerProcess()
            try:
                while not stop.is_set() and (job := next(left, None)) is not None:
                    tell = _teller(events, job)
                    tell("starting")
                    try:
                        outcome = child.run(job, tell, timeout=timeout, retries=retries, stop=stop)
                    except Exception as error:  # an outcome that never comes would be waited for
                        reason = f"{type(error).__name__}: {error}"
                        outcome = Failure("crash", f"{job.shown}: its process could not be used ({reason})")
                    events.put(JobEvent(job, outcome=outcome))
            finally:
                child.close()

        with _threads(attend, self._size, stop):
            waiting = len(jobs)
            while waiting:
                event = events.get()
                waiting -= event.outcome is not None
                yield event


def _teller(events: "SimpleQueue[JobEvent]", job: Job) -> Callable[[str], None]:
    return lambda stage: events.put(JobEvent(job, stage))


@contextmanager
def _threads(work: Callable[[], None], count: int, stop: threading.Event) -> Iterator[None]:
    """Do the work in several threads for the length of a `with` block, and set `stop` at its end."""
    threads = [threading.Thread(target=work, daemon=True) for _ in range(count)]
    try:
        for thread in threads:
            thread.start()
        yield
    finally:
        stop.set()
        for thread in threads:
            if thread.ident is not None:  # it was started
                thread.join()


def _default_jobs() -> int:
    """Return as many jobs as there are cores, if there is memory for each."""
    memory = usable_memory()
    return whole_cores() if memory is None else max(1, min(whole_cores(), memory // _OF_JOB))
