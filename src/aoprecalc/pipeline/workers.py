"""Worker pools: processes on this machine, each of which does one job after the other.

Whatever happens to a worker process (crash, hang, kill) is the outcome of one job. See dask_client for a cluster.
"""

import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.jobs import Failure, Job, Outcome, VisibilityTask
from aoprecalc.subprocesses import (
    POLL_SECONDS,
    ChildKilledError,
    ChildStoppedError,
    ChildTimeoutError,
    DuplexChild,
    StepCallback,
)
from aoprecalc.system import usable_memory, whole_cores

_MAX_JOBS = 100  # of one process, so that what libraries leak does not grow without bounds
_BYTES_PER_JOB = 1 << 30  # memory that a job may need


class WorkerProcess:
    """A worker process, started for the first job and again after it has died; safe to use from several threads."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._child: DuplexChild | None = None
        self._jobs_done = 0
        self._busy = threading.Lock()
        self._idle_timer: threading.Timer | None = None

    def run(
        self,
        request: Job | VisibilityTask,
        on_stage: StepCallback,
        *,
        timeout: float | None = None,
        retries: int = 0,
        stop: threading.Event | None = None,
    ) -> Any:
        """Return the outcome of a job (Success or Failure) or of a visibility task (VisibilitySums or Failure).

        on_stage  called with each stage that the job begins
        timeout   seconds until the process is killed
        retries   tries of a job whose process died, beyond the first
        stop      kills the process when it is set
        """
        started = time.monotonic()
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        with self._busy:
            for attempt in range(retries + 1):
                outcome = self._run_once(request, on_stage, timeout, stop)
                if not isinstance(outcome, Failure) or outcome.kind != "crash":
                    break
                if attempt < retries:
                    on_stage(f"again, as its process died ({attempt + 1})")
        return replace(outcome, seconds=time.monotonic() - started)

    def close(self) -> None:
        """End the process and all that it has started."""
        if self._child is not None:
            self._child.close()
            self._child = None

    def close_after(self, seconds: float) -> None:
        """End the process once it has been idle for that long."""
        self._idle_timer = threading.Timer(seconds, self.close_if_idle)
        self._idle_timer.daemon = True
        self._idle_timer.start()

    def close_if_idle(self) -> None:
        """End the process unless it works for another thread."""
        if self._busy.acquire(blocking=False):
            try:
                self.close()
            finally:
                self._busy.release()

    def _run_once(
        self,
        request: Job | VisibilityTask,
        on_stage: StepCallback,
        timeout: float | None,
        stop: threading.Event | None,
    ) -> Any:
        if self._child is not None and not self._child.is_alive():
            self.close()
        if self._child is None:
            try:
                self._child, self._jobs_done = DuplexChild("aoprecalc.pipeline.worker"), 0
            except OSError as error:
                reason = f"no process for it could be started ({error})"
                return Failure("crash", f"{request.label}: {reason}; use fewer --jobs")
        try:
            outcome = self._child.request(request, on_stage, timeout=timeout, stop=stop)
        except ChildStoppedError:
            outcome = Failure("stopped", f"{request.label}: was stopped")
        except ChildTimeoutError:
            reason = f"took longer than {timeout:g} s; allow more (--timeout) or ask for less"
            outcome = Failure("timeout", f"{request.label}: {reason}")
        except ChildProcessError as error:
            advice = "; use fewer --jobs or a smaller size" if isinstance(error, ChildKilledError) else ""
            outcome = Failure("crash", f"{request.label}: its process died: {error}{advice}")
        self._jobs_done += 1
        if (isinstance(outcome, Failure) and outcome.kind != "error") or self._jobs_done >= _MAX_JOBS:
            self.close()
        return outcome


@dataclass(frozen=True)
class JobEvent:
    """News of a job: it has begun a stage, or it has an outcome."""

    job: Job
    stage: str = ""
    outcome: Outcome | None = None


class WorkerPool(Protocol):
    """Runs jobs.

    threads   for each job whose spec does not say; 0: all cores of the machine that it runs on
    """

    threads: int

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
        """Yield events until every job has had one outcome; closing the generator ends the work."""
        ...


class ProcessPool:
    """Worker processes on this machine, each served by a thread of this process."""

    def __init__(self, count: int, options: BatchOptions) -> None:
        """Choose the number of processes for `count` jobs; they are started when there is work."""
        workers = 1 if options.split else options.jobs or _default_workers()
        self._size = max(1, min(workers, count))
        self._options = options
        # LP_NUM_THREADS: the user has chosen llvmpipe's number of threads
        self.threads = 0 if "LP_NUM_THREADS" in os.environ else max(1, whole_cores() // self._size)

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
        """See WorkerPool."""
        events: SimpleQueue[JobEvent] = SimpleQueue()
        stop = threading.Event()
        remaining = iter(jobs)  # `next` of a list iterator is atomic, so that threads may share it
        timeout, retries = self._options.timeout, self._options.retries

        def run_jobs() -> None:
            worker = WorkerProcess()
            try:
                while not stop.is_set() and (job := next(remaining, None)) is not None:
                    on_stage = _stage_reporter(events, job)
                    on_stage("starting")
                    try:
                        outcome = worker.run(job, on_stage, timeout=timeout, retries=retries, stop=stop)
                    except Exception as error:  # the caller waits for an outcome whatever goes wrong
                        reason = f"{type(error).__name__}: {error}"
                        outcome = Failure("crash", f"{job.label}: its process could not be used ({reason})")
                    events.put(JobEvent(job, outcome=outcome))
            finally:
                worker.close()

        with _running_threads(run_jobs, self._size, stop):
            pending = len(jobs)
            while pending:
                try:  # a wait without end may miss a signal: one just before it, or in another thread, ends no wait
                    event = events.get(timeout=POLL_SECONDS)
                except Empty:
                    continue
                pending -= event.outcome is not None
                yield event


def _stage_reporter(events: "SimpleQueue[JobEvent]", job: Job) -> StepCallback:
    return lambda stage: events.put(JobEvent(job, stage))


@contextmanager
def _running_threads(target: Callable[[], None], count: int, stop: threading.Event) -> Iterator[None]:
    """Run threads during a `with` block; at its end set `stop` and wait for them."""
    threads = [threading.Thread(target=target, daemon=True) for _ in range(count)]
    try:
        for thread in threads:
            thread.start()
        yield
    finally:
        stop.set()
        for thread in threads:
            if thread.ident is not None:  # it was started
                thread.join()


def _default_workers() -> int:
    """Return one worker a core, but no more than there is memory for."""
    memory = usable_memory()
    return whole_cores() if memory is None else max(1, min(whole_cores(), memory // _BYTES_PER_JOB))
