"""Who does the jobs of a batch, and the crew that is on this machine."""

import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Protocol

from aoprecalc.limits import usable_memory, whole_cores
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.crew.child import Child
from aoprecalc.pipeline.crew.work import Failure, Job, Outcome

_OF_JOB = 1 << 30  # bytes of memory that a job may take


@dataclass(frozen=True)
class Event:
    """What happened to a job: it came to a stage, or it has an outcome."""

    job: Job
    stage: str = ""
    outcome: Outcome | None = None


class Crew(Protocol):
    """Does jobs.

    threads   that one job is to use, where its order says nothing; 0: all cores of where it runs
    """

    threads: int

    def run(self, jobs: Sequence[Job]) -> Generator[Event]:
        """Yield events until each job has had its outcome, once; closing the iterator ends the work."""
        ...


class LocalCrew:
    """Processes on this machine, each with a thread here that waits for it."""

    def __init__(self, count: int, options: BatchOptions) -> None:
        """Have as many processes as the options say and `count` jobs need, started when there is work."""
        jobs = 1 if options.split else options.jobs or _default_jobs()
        self._size = max(1, min(jobs, count))
        self._options = options
        # who has set this has decided
        self.threads = 0 if "LP_NUM_THREADS" in os.environ else max(1, whole_cores() // self._size)

    def run(self, jobs: Sequence[Job]) -> Generator[Event]:
        """See Crew."""
        events: SimpleQueue[Event] = SimpleQueue()
        stop = threading.Event()
        left = iter(jobs)  # the next of a list is taken in one step, which threads do not divide
        timeout, retries = self._options.timeout, self._options.retries

        def attend() -> None:
            child = Child()
            try:
                while not stop.is_set() and (job := next(left, None)) is not None:
                    tell = _teller(events, job)
                    tell("starting")
                    try:
                        outcome = child.run(job, tell, timeout=timeout, retries=retries, stop=stop)
                    except Exception as error:  # an outcome that never comes would be waited for
                        reason = f"{type(error).__name__}: {error}"
                        outcome = Failure("crash", f"{job.shown}: its process could not be used ({reason})")
                    events.put(Event(job, outcome=outcome))
            finally:
                child.close()

        with _threads(attend, self._size, stop):
            waiting = len(jobs)
            while waiting:
                event = events.get()
                waiting -= event.outcome is not None
                yield event


def _teller(events: "SimpleQueue[Event]", job: Job) -> Callable[[str], None]:
    return lambda stage: events.put(Event(job, stage))


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
