"""Batches on a Dask cluster: jobs on its workers, and one bake's visibility computed in parts by several of them."""

import itertools
import logging
import os
import pickle
import re
import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import islice
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, cast

import numpy as np

from aoprecalc import __version__
from aoprecalc.errors import AoprecalcError, ArgumentError
from aoprecalc.io import input_files
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.dask_worker import (
    BatchSettings,
    WorkerInfo,
    end_batch,
    evaluate_remotely,
    run_in_shared_folder,
    run_on_bytes,
    worker_info,
)
from aoprecalc.pipeline.jobs import Failure, Job, Outcome, VisibilitySums, VisibilityTask
from aoprecalc.pipeline.workers import JobEvent
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples
from aoprecalc.types import Float32Array
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide
from aoprecalc.visibility.source import TexelRequest

_CLUSTER_TIMEOUT = 30  # seconds for a scheduler to answer, and to have a worker
_POLL_SECONDS = 1  # between two checks that there are workers
_QUEUED_JOBS = 2  # jobs at the scheduler beyond one for each thread, so that no worker waits for the next
_RETRY_ADVICE = "check its scheduler and workers, and run the same command again"


@contextmanager
def open_client(address: str) -> Iterator[Any]:
    """Connect to a scheduler that has workers; raises UsageError, or AoprecalcError if there are none."""
    if not re.fullmatch(r"(\w+://)?[^/\s]+:\d{1,5}", address):
        raise ArgumentError("scheduler", f"is {address!r}; expected an address with a port, such as tcp://host:8786")
    try:
        import dask
        import distributed
    except ModuleNotFoundError as error:
        raise ArgumentError("scheduler", "needs Dask; install it: pip install 'aoprecalc[cluster]'") from error
    log = logging.getLogger("distributed")
    with ExitStack() as stack:
        stack.callback(log.setLevel, log.level)
        log.setLevel(logging.CRITICAL)  # errors are reported by our own messages
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}))
        try:
            client = distributed.Client(address, timeout=_CLUSTER_TIMEOUT, set_as_default=False)
            stack.callback(client.close)
            client.wait_for_workers(1, timeout=_CLUSTER_TIMEOUT)
        except (OSError, ValueError, TimeoutError) as error:
            reason = _one_line(str(error), 160)
            message = f"--scheduler {address}: no cluster with workers answers there ({reason})"
            raise AoprecalcError(f"{message}; check the address, and that `dask worker` runs") from error
        yield client


@contextmanager
def open_dask_pool(options: BatchOptions) -> Iterator["DaskPool"]:
    """Open a pool on the cluster of `options.scheduler`; raises what `open_client` raises."""
    assert options.scheduler is not None
    with open_client(options.scheduler) as client:
        pool = DaskPool(client, options)
        try:
            yield pool
        finally:
            pool.close()


class DaskPool:
    """A WorkerPool on a cluster: each thread of a Dask worker has a process for the jobs of this batch."""

    def __init__(self, client: Any, options: BatchOptions) -> None:
        """Use all workers that a Dask client has, now and later."""
        self._client, self._options = client, options
        self._batch_id = secrets.token_hex(8)
        self.threads = threads_per_job(client)

    def run(self, jobs: Sequence[Job]) -> Generator[JobEvent]:
        """See WorkerPool; there are no events for the stages of jobs."""
        submit = self._submitter(jobs)
        unsubmitted = iter(jobs)
        without_outcome = {job.name: job for job in jobs}
        submitted: dict[Any, Job] = {}
        done: SimpleQueue[Any] = SimpleQueue()
        try:
            while without_outcome:
                try:
                    for job in islice(unsubmitted, max(0, self._worker_threads() + _QUEUED_JOBS - len(submitted))):
                        future = submit(job)
                        submitted[future] = job
                        future.add_done_callback(done.put)
                    future = self._next_done(done)
                except Exception as error:  # Dask raises errors of many kinds if the scheduler is gone
                    for job in without_outcome.values():
                        yield JobEvent(job, outcome=_lost(job, str(error)))
                    return
                job = submitted.pop(future)
                del without_outcome[job.name]
                yield JobEvent(job, outcome=_outcome(job, future))
        finally:
            with suppress(Exception):
                self._client.cancel(list(submitted))

    def _next_done(self, done: "SimpleQueue[Any]") -> Any:
        """Wait for the next future that is done; raises TimeoutError if there are no workers for long."""
        last_time_with_workers = time.monotonic()
        while True:
            try:
                return done.get(timeout=_POLL_SECONDS)
            except Empty:
                now = time.monotonic()
                last_time_with_workers = now if self._worker_threads() else last_time_with_workers
                if now - last_time_with_workers > _CLUSTER_TIMEOUT:
                    raise TimeoutError(f"it has had no workers for {_CLUSTER_TIMEOUT} s") from None

    def close(self) -> None:
        """End the jobs of this batch that still run, and its processes."""
        with suppress(Exception):  # workers that are gone have no processes
            self._client.run(end_batch, self._batch_id)

    def _submitter(self, jobs: Sequence[Job]) -> Callable[[Job], Any]:
        """Return a function that submits a job, with its files or for workers that share the folder."""
        workers = _describe_workers(self._client, str(jobs[0].staging.parent)).values()
        all_have_folder = all(worker.has_folder for worker in workers)
        if self._options.ship == "folder" and not all_have_folder:
            message = f"--ship folder: not all workers have access to {jobs[0].folder}"
            raise AoprecalcError(f"{message}; share it with them, or use --ship bytes")
        in_folder = self._options.ship != "bytes" and all_have_folder
        has_gpus = any(worker.gpus for worker in workers)
        settings = BatchSettings(self._batch_id, __version__, self._options.timeout, self._options.retries)

        def submit(job: Job) -> Any:
            resources = {"GPU": 1} if has_gpus and job.spec.bake is not None else None
            how: dict[str, Any] = {"pure": False, "retries": self._options.retries, "resources": resources}
            if in_folder:
                return self._client.submit(run_in_shared_folder, job, settings, **how)
            return self._client.submit(run_on_bytes, job, _read_inputs(job), settings, **how)

        return submit

    def _worker_threads(self) -> int:
        """Return how many jobs the present workers run at a time."""
        return sum(self._client.nthreads().values())


def threads_per_job(client: Any) -> int:
    """Return how many threads each job may use so that the jobs of a machine have a core for each thread."""
    nthreads = client.nthreads()
    jobs: Counter[str] = Counter()
    cores: dict[str, int] = {}
    for address, worker in _describe_workers(client, "").items():
        jobs[worker.host] += nthreads.get(address, 1)
        cores[worker.host] = worker.cores
    return max(1, min((cores[host] // jobs[host] for host in cores), default=1))


def _describe_workers(client: Any, folder: str) -> dict[str, WorkerInfo]:
    """Return what each worker is, by its address; raises AoprecalcError if one cannot work for this batch."""
    try:
        workers: dict[str, WorkerInfo] = client.run(worker_info, folder)
    except Exception as error:  # Dask re-raises whatever the worker raised, usually ImportError
        reason = _one_line(str(error), 160)
        raise AoprecalcError(
            f"the workers of the cluster cannot load aoprecalc {__version__} ({reason}); install it there"
        ) from error
    for address, worker in workers.items():
        if worker.version != __version__:
            message = f"worker {address} has aoprecalc {worker.version}, {__version__} was expected"
            raise AoprecalcError(f"{message}; install the same everywhere")
    return workers


def _read_inputs(job: Job) -> dict[str, bytes]:
    """Read the files that a job needs, path -> contents; files that are missing here are missing there, too."""
    files: dict[str, bytes] = {}
    for named in (job.mesh, *job.spec.files):
        with suppress(OSError):
            files[str(named)] = named.read_bytes()
            for path in input_files(named, files[str(named)])[1:]:
                with suppress(OSError):
                    files[os.path.abspath(path)] = path.read_bytes()
    return files


def _lost(job: Job, reason: str) -> Failure:
    return Failure("crash", f"{job.label}: the cluster was lost ({_one_line(reason, 200)}); {_RETRY_ADVICE}")


def _outcome(job: Job, future: Any) -> Outcome:
    """Return the outcome that a future holds, with its files in the staging folder."""
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


def _one_line(text: str, length: int) -> str:
    return " ".join(text.split())[:length]


class DaskVisibility(AbstractContextManager["DaskVisibility"]):
    """A VisibilityFactory on a cluster, connected during a `with` block."""

    def __init__(self, scheduler: str, label: str) -> None:
        """Connect to a scheduler; `label`: of the job, for messages. Raises what `open_client` raises."""
        with ExitStack() as stack:
            self._client = stack.enter_context(open_client(scheduler))
            self._threads = threads_per_job(self._client)
            self._stack = stack.pop_all()
        self._label, self._settings = label, BatchSettings(secrets.token_hex(8), __version__)
        self._sources: list[DaskVisibilitySource] = []

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Cancel what is not needed, and end the processes that have worked for this bake."""
        with self._stack, suppress(Exception):  # workers that are gone have no processes
            self._client.cancel([future for source in self._sources for future in source.unused()])
            self._client.run(end_batch, self._settings.batch_id)

    def __call__(
        self, setup: BakeSetup, side: SurfaceSide, shadow_size: int, chunk_size: int, progress: Progress
    ) -> "DaskVisibilitySource":
        """Return a source of the sums of one side's texels."""
        options = replace(setup.inputs.options, threads=self._threads)
        if setup.backend.kind == "ray":  # which auto has taken: by workers with a GPU too
            options = replace(options, backend="ray")
        inputs = replace(setup.inputs, scene=replace(setup.inputs.scene, document=None), options=options)
        pickled = self._client.scatter(pickle.dumps(inputs), hash=False, broadcast=True)
        bake_id, side_index, counter = secrets.token_hex(8), setup.sides.index(side), itertools.count()

        def submit(request: TexelRequest) -> Any:
            task = VisibilityTask(self._label, bake_id, b"", side_index, request, chunk_size, shadow_size)
            order = {"pure": False, "priority": -next(counter)}
            return self._client.submit(evaluate_remotely, task, pickled, self._settings, **order)

        self._sources.append(DaskVisibilitySource(setup, submit, progress))
        return self._sources[-1]


class DaskVisibilitySource:
    """A VisibilitySource that waits for the tasks of one side."""

    def __init__(self, setup: BakeSetup, submit: Callable[[TexelRequest], Any], progress: Progress) -> None:
        """Keep what submits the task for a request, and returns its future."""
        self._setup, self._submit, self._progress = setup, submit, progress
        self._futures: deque[Any] = deque()

    def expect(self, requests: Iterable[TexelRequest]) -> None:
        """Submit the tasks; see VisibilitySource."""
        self._futures.extend(map(self._submit, requests))

    def visibility_sums(self, samples: Samples, request: TexelRequest) -> Float32Array:
        """Return the sums of texels; see VisibilitySource. Raises AoprecalcError if the task failed."""
        future = self._futures.popleft()
        try:
            outcome = future.result()
        except Exception as error:  # Dask raises errors of many kinds if workers are lost
            reason = _one_line(f"{type(error).__name__}: {error}", 300)
            message = f"the cluster could not evaluate the visibility of group {request.group} of the axes ({reason})"
            raise AoprecalcError(f"{message}; {_RETRY_ADVICE}") from error
        if not isinstance(outcome, VisibilitySums):
            raise AoprecalcError(outcome.message)
        self._progress.advance(self._setup.directions_of(request.group))
        return np.asarray(outcome.sums)

    def unused(self) -> list[Any]:
        """Return the futures that were not waited for, as when the target error was reached early."""
        return list(self._futures)
