"""A crew of workers on a Dask cluster."""

import logging
import os
import re
import secrets
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, cast

from aoprecalc import __version__
from aoprecalc.errors import AoprecalcError, UsageError
from aoprecalc.files import input_files
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.cluster.remote import Place, Terms, end, look_around, work_in_folder, work_on_bytes
from aoprecalc.pipeline.crew.crew import Event
from aoprecalc.pipeline.crew.work import Failure, Job, Outcome

_PATIENCE = 30  # seconds for a scheduler to answer, and to have a worker
_LOOK = 1  # seconds between two looks at the workers
_AHEAD = 2  # jobs that wait at the scheduler beyond those under way, so that no worker waits


@contextmanager
def open_client(address: str) -> Iterator[Any]:
    """Connect to a scheduler that has workers; raises UsageError, and AoprecalcError where none answers."""
    if not re.fullmatch(r"(\w+://)?[^/\s]+:\d{1,5}", address):
        raise UsageError(f"--scheduler is {address!r}; expected an address with a port, such as tcp://host:8786")
    try:
        import dask
        import distributed
    except ModuleNotFoundError as error:
        raise UsageError("--scheduler needs Dask; install it: pip install 'aoprecalc[cluster]'") from error
    log = logging.getLogger("distributed")
    with ExitStack() as stack:
        stack.callback(log.setLevel, log.level)
        log.setLevel(logging.CRITICAL)  # what matters of it is said in our own lines
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}))
        try:
            client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
            stack.callback(client.close)
            client.wait_for_workers(1, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split())[:160]
            found = f"--scheduler {address}: no cluster with workers answers there ({reason})"
            raise AoprecalcError(f"{found}; check the address, and that `dask worker` runs") from error
        yield client


@contextmanager
def open_cluster(options: BatchOptions) -> Iterator["ClusterCrew"]:
    """Open the crew of `options.scheduler`; raises what `open_client` does."""
    assert options.scheduler is not None
    with open_client(options.scheduler) as client:
        crew = ClusterCrew(client, options)
        try:
            yield crew
        finally:
            crew.leave()


class ClusterCrew:
    """Workers of a cluster, each of whose threads has a process for the jobs that it gets."""

    def __init__(self, client: Any, options: BatchOptions) -> None:
        """Have the workers that a client knows, and those that come."""
        self._client, self._options = client, options
        self._batch = secrets.token_hex(8)
        self.threads = threads_of_a_job(client)

    def run(self, jobs: Sequence[Job]) -> Generator[Event]:
        """See Crew; the stages of jobs are not told."""
        send = self._sender(jobs)
        left = iter(jobs)
        waiting = {job.name: job for job in jobs}  # that have no outcome yet
        under_way: dict[Any, Job] = {}
        done: SimpleQueue[Any] = SimpleQueue()
        try:
            while waiting:
                try:
                    for job in islice(left, max(0, self._slots() + _AHEAD - len(under_way))):
                        future = send(job)
                        under_way[future] = job
                        future.add_done_callback(done.put)
                    future = self._next(done)
                except Exception as error:  # whatever a client raises whose scheduler is gone
                    for job in waiting.values():
                        yield Event(job, outcome=_lost(job, str(error)))
                    return
                job = under_way.pop(future)
                del waiting[job.name]
                yield Event(job, outcome=_outcome(job, future))
        finally:
            with suppress(Exception):
                self._client.cancel(list(under_way))

    def _next(self, done: "SimpleQueue[Any]") -> Any:
        """Wait for the next future that is done; raises TimeoutError where there are no workers for long."""
        lonely = time.monotonic()
        while True:
            try:
                return done.get(timeout=_LOOK)
            except Empty:
                now = time.monotonic()
                lonely = now if self._slots() else lonely
                if now - lonely > _PATIENCE:
                    raise TimeoutError(f"it has had no workers for {_PATIENCE} s") from None

    def leave(self) -> None:
        """End what is under way, and the processes."""
        with suppress(Exception):  # workers or scheduler that are gone have no such processes
            self._client.run(end, self._batch)

    def _sender(self, jobs: Sequence[Job]) -> Callable[[Job], Any]:
        """Return what submits a job, in the way in which files reach the workers."""
        sample = jobs[0]
        places = _look(self._client, str(sample.staging.parent)).values()
        ship = self._options.ship
        if ship == "folder" and not all(place.sees for place in places):
            raise AoprecalcError(
                f"--ship folder: not all workers see {sample.folder}; share it with them, or use --ship bytes"
            )
        in_folder = ship == "folder" or (ship == "auto" and all(place.sees for place in places))
        on_gpus = any(place.gpus for place in places)
        terms = Terms(self._batch, __version__, self._options.timeout, self._options.retries)

        def send(job: Job) -> Any:
            resources = {"GPU": 1} if on_gpus and job.order.bake is not None else None
            how: dict[str, Any] = {"pure": False, "retries": self._options.retries, "resources": resources}
            if in_folder:
                return self._client.submit(work_in_folder, job, terms, **how)
            return self._client.submit(work_on_bytes, job, _inputs(job), terms, **how)

        return send

    def _slots(self) -> int:
        """Return how many jobs the workers of this moment do at a time."""
        return sum(self._client.nthreads().values())


def threads_of_a_job(client: Any) -> int:
    """Return how many threads each job may use for all jobs of a machine to have a core."""
    nthreads = client.nthreads()
    jobs: Counter[str] = Counter()
    cores: dict[str, int] = {}
    for address, place in _look(client, "").items():
        jobs[place.host] += nthreads.get(address, 1)
        cores[place.host] = place.cores
    return max(1, min((cores[host] // jobs[host] for host in cores), default=1))


def _look(client: Any, folder: str) -> dict[str, Place]:
    """Look at each worker; raises AoprecalcError where one cannot work for this batch."""
    try:
        places: dict[str, Place] = client.run(look_around, folder)
    except Exception as error:  # whatever hinders a worker to load the package
        reason = " ".join(str(error).split())[:160]
        raise AoprecalcError(
            f"the workers of the cluster cannot load aoprecalc {__version__} ({reason}); install it there"
        ) from error
    for address, place in places.items():
        if place.version != __version__:
            found = f"worker {address} has aoprecalc {place.version}, {__version__} was expected"
            raise AoprecalcError(f"{found}; install the same everywhere")
    return places


def _inputs(job: Job) -> dict[str, bytes]:
    """Read the files that a job needs; those that are missing are missing for it as well."""
    files = {}
    with suppress(OSError):
        files[str(job.mesh)] = job.mesh.read_bytes()
        for path in input_files(job.mesh, files[str(job.mesh)])[1:]:
            with suppress(OSError):
                files[os.path.abspath(path)] = path.read_bytes()
    return files


def _lost(job: Job, reason: str) -> Failure:
    found = f"{job.shown}: the cluster was lost ({' '.join(reason.split())[:200]})"
    return Failure("crash", f"{found}; see to its scheduler and workers, and run the same command again")


def _outcome(job: Job, future: Any) -> Outcome:
    """Return what a future holds, with its files in the staging folder."""
    if future.status != "finished":
        error = future.exception() if future.status == "error" else None
        return _lost(job, f"{type(error).__name__}: {error}" if error else f"the job was {future.status}")
    result = future.result()
    if not isinstance(result, tuple):
        return cast(Outcome, result)
    outcome, contents = cast(tuple[Outcome, dict[str, bytes]], result)
    if isinstance(outcome, Failure):
        return outcome
    try:
        job.staging.mkdir(exist_ok=True)
        for name, data in contents.items():
            (job.staging / name).write_bytes(data)
    except OSError as error:
        return Failure("error", f"{job.shown}: its files cannot be written here ({error}); check the disk")
    return replace(outcome, files={name: job.staging / name for name in contents})
