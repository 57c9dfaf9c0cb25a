"""A crew of workers on a Dask cluster."""

import logging
import os
import pickle
import re
import secrets
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import islice
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, cast

import numpy as np

from aoprecalc import __version__
from aoprecalc.errors import AoprecalcError, UsageError
from aoprecalc.io import input_files
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.dask_worker import (
    BatchSettings,
    WorkerInfo,
    end,
    evaluate_remotely,
    run_in_shared_folder,
    run_on_bytes,
    worker_info,
)
from aoprecalc.pipeline.jobs import Failure, Job, Outcome, VisibilitySums, VisibilityTask
from aoprecalc.pipeline.workers import JobEvent
from aoprecalc.progress import Progress
from aoprecalc.raster.samples import Samples
from aoprecalc.types import Float32Array
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide, chunks

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
def open_dask_pool(options: BatchOptions) -> Iterator["DaskPool"]:
    """Open the crew of `options.scheduler`; raises what `open_client` does."""
    assert options.scheduler is not None
    with open_client(options.scheduler) as client:
        crew = DaskPool(client, options)
        try:
            yield crew
        finally:
            crew.leave()


class DaskPool:
    """Workers of a cluster, each of whose threads has a process for the jobs that it gets."""

    def __init__(self, client: Any, options: BatchOptions) -> None:
        """Have the workers that a client knows, and those that come."""
        self._client, self._options = client, options
        self._batch = secrets.token_hex(8)
        self.threads = threads_per_job(client)

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
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
                        yield JobEvent(job, outcome=_lost(job, str(error)))
                    return
                job = under_way.pop(future)
                del waiting[job.name]
                yield JobEvent(job, outcome=_outcome(job, future))
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
        terms = BatchSettings(self._batch, __version__, self._options.timeout, self._options.retries)

        def send(job: Job) -> Any:
            resources = {"GPU": 1} if on_gpus and job.spec.bake is not None else None
            how: dict[str, Any] = {"pure": False, "retries": self._options.retries, "resources": resources}
            if in_folder:
                return self._client.submit(run_in_shared_folder, job, terms, **how)
            return self._client.submit(run_on_bytes, job, _inputs(job), terms, **how)

        return send

    def _slots(self) -> int:
        """Return how many jobs the workers of this moment do at a time."""
        return sum(self._client.nthreads().values())


def threads_per_job(client: Any) -> int:
    """Return how many threads each job may use for all jobs of a machine to have a core."""
    nthreads = client.nthreads()
    jobs: Counter[str] = Counter()
    cores: dict[str, int] = {}
    for address, place in _look(client, "").items():
        jobs[place.host] += nthreads.get(address, 1)
        cores[place.host] = place.cores
    return max(1, min((cores[host] // jobs[host] for host in cores), default=1))


def _look(client: Any, folder: str) -> dict[str, WorkerInfo]:
    """Look at each worker; raises AoprecalcError where one cannot work for this batch."""
    try:
        places: dict[str, WorkerInfo] = client.run(worker_info, folder)
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
    found = f"{job.label}: the cluster was lost ({' '.join(reason.split())[:200]})"
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
        return Failure("error", f"{job.label}: its files cannot be written here ({error}); check the disk")
    return replace(outcome, files={name: job.staging / name for name in contents})


# A sight that is spread over the workers of a cluster: each looks along some groups of axes.


class DaskVisibility(AbstractContextManager["DaskVisibility"]):
    """Opens sights that are spread over a cluster, for the length of a `with` block."""

    def __init__(self, scheduler: str, shown: str) -> None:
        """Connect to a scheduler; `shown` is what messages call the work. Raises what `open_client` does."""
        with ExitStack() as stack:
            self._client = stack.enter_context(open_client(scheduler))
            self._threads = threads_per_job(self._client)
            self._stack = stack.pop_all()
        self._shown, self._terms = shown, BatchSettings(secrets.token_hex(8), __version__)
        self._sights: list[DistributedVisibility] = []

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes that have looked."""
        with self._stack, suppress(Exception):  # workers or scheduler that are gone have no such processes
            self._client.cancel([future for sight in self._sights for future in sight.left()])
            self._client.run(end, self._terms.batch)

    def __call__(
        self, site: BakeSetup, side: SurfaceSide, shadow_size: int, most: int, progress: Progress
    ) -> "DistributedVisibility":
        """Have the workers begin to look; see OpenSight."""
        options = replace(site.inputs.options, threads=self._threads)
        subject = replace(site.inputs, scene=replace(site.inputs.scene, document=None), options=options)
        sent = self._client.scatter(pickle.dumps(subject), hash=False, broadcast=True)
        held = chunks(len(side.texels), most)
        name, number = secrets.token_hex(8), site.sides.index(side)
        futures: dict[tuple[int, int], Any] = {}
        for group in range(len(site.groups)):
            for run in held:
                glance = VisibilityTask(self._shown, name, b"", number, group, run.start, run.stop, most, shadow_size)
                futures[group, run.start] = self._client.submit(
                    evaluate_remotely, glance, sent, self._terms, pure=False, priority=-len(futures)
                )
        self._sights.append(DistributedVisibility(site, futures, progress))
        return self._sights[-1]


class DistributedVisibility:
    """Waits for what others see; a Sight."""

    def __init__(self, site: BakeSetup, futures: dict[tuple[int, int], Any], progress: Progress) -> None:
        """Have the futures of (group, first texel of a run)."""
        self._site, self._futures, self._progress = site, futures, progress

    def visibility_sums(self, samples: Samples, held: slice, group: int) -> Float32Array:
        """See Sight; raises AoprecalcError where a worker could not look."""
        future = self._futures.pop((group, held.start))
        try:
            outcome = future.result()
        except Exception as error:  # of whatever kind the cluster raises for workers that are lost
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
            found = f"the cluster could not look along group {group} of the axes ({reason})"
            raise AoprecalcError(
                f"{found}; see to its scheduler and workers, and run the same command again"
            ) from error
        if not isinstance(outcome, VisibilitySums):
            raise AoprecalcError(outcome.message)
        axes = self._site.groups[group]
        self._progress.advance(2 * (axes.stop - axes.start))
        return np.asarray(outcome.sums)

    def left(self) -> list[Any]:
        """Return the futures that nobody has waited for, as where the target error was reached."""
        return list(self._futures.values())
