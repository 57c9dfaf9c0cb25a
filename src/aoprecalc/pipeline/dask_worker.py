"""What runs inside the workers of a Dask cluster: each job is handed to a worker process of its own.

So a crash does not take the Dask worker down, threads of one Dask worker do not wait for each other, and OpenGL is used
by one job at a time in each process.
"""

import os
import socket
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from aoprecalc import __version__
from aoprecalc.pipeline.jobs import Failure, Job, Outcome, VisibilitySums, VisibilityTask
from aoprecalc.pipeline.workers import WorkerProcess
from aoprecalc.system import whole_cores

_IDLE_SECONDS = 60  # after which an idle process ends: the client may have disconnected without calling end_batch


@dataclass(frozen=True)
class WorkerInfo:
    """What a batch needs to know of a Dask worker.

    version      of its aoprecalc
    host         its machine
    cores        that it may use
    gpus         that it offers as Dask resource GPU; 0: none
    has_folder   whether a folder of the batch exists there
    """

    version: str
    host: str
    cores: int
    gpus: float
    has_folder: bool


@dataclass(frozen=True)
class BatchSettings:
    """How the jobs of a batch are run.

    batch_id   unique
    version    of aoprecalc that the batch expects
    timeout    seconds for a job; None: no limit
    retries    tries of a job whose process died, beyond the first
    """

    batch_id: str
    version: str
    timeout: float | None = None
    retries: int = 1


@dataclass(eq=False)
class _BatchProcesses:
    """The processes of one batch on this Dask worker, by thread."""

    stop: threading.Event = field(default_factory=threading.Event)
    by_thread: dict[int, WorkerProcess] = field(default_factory=dict)


_batches: dict[str, _BatchProcesses] = {}


def worker_info(folder: str, dask_worker: Any = None) -> WorkerInfo:
    """Describe this worker; Dask passes itself as `dask_worker`. `folder`: whether it exists here."""
    resources = dask_worker.state.total_resources
    return WorkerInfo(
        version=__version__,
        host=socket.gethostname(),
        cores=whole_cores(),
        gpus=resources.get("GPU", 0),
        has_folder=os.path.isdir(folder),
    )


def run_in_shared_folder(job: Job, settings: BatchSettings) -> Outcome:
    """Run a job on files that this machine has under the same paths."""
    if not job.staging.parent.is_dir():
        return Failure("error", f"{job.label}: {socket.gethostname()} has no access to {job.folder}; use --ship bytes")
    return cast(Outcome, _run(job, settings))


def run_on_bytes(job: Job, inputs: dict[str, bytes], settings: BatchSettings) -> tuple[Outcome, dict[str, bytes]]:
    """Run a job on files that are sent with it; return its outcome and its files, name -> contents.

    inputs   absolute path on the machine of the batch -> contents. The files are written below a temporary folder
             under these paths, so that paths relative to each other are the same
    """
    with TemporaryDirectory(prefix="aoprecalc-") as root:
        local_job = _rebased_job(job, Path(root))
        for path, data in inputs.items():
            file = _rebased(Path(path), Path(root))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        local_job.staging.parent.mkdir(parents=True, exist_ok=True)
        outcome = run_in_shared_folder(local_job, settings)
        if isinstance(outcome, Failure):
            return outcome, {}
        return outcome, {name: file.read_bytes() for name, file in outcome.files.items()}


def evaluate_remotely(task: VisibilityTask, inputs: bytes, settings: BatchSettings) -> VisibilitySums | Failure:
    """Evaluate a visibility task; its inputs come separately, as they are sent once for all tasks of a bake."""
    return cast(VisibilitySums | Failure, _run(replace(task, inputs=inputs), settings))


def end_batch(batch_id: str) -> None:
    """End the processes of a batch, and start no more for it."""
    processes = _batches.setdefault(batch_id, _BatchProcesses())
    processes.stop.set()
    for process in list(processes.by_thread.values()):
        process.close_if_idle()


def _run(request: Job | VisibilityTask, settings: BatchSettings) -> Any:
    """Run a request in the process that belongs to its batch and to this thread."""
    processes = _batches.setdefault(settings.batch_id, _BatchProcesses())
    if settings.version != __version__:
        message = f"{socket.gethostname()} has aoprecalc {__version__}, {settings.version} was expected"
        return Failure("error", f"{request.label}: {message}; install the same everywhere")
    if processes.stop.is_set():
        return Failure("stopped", f"{request.label}: was stopped")
    process = processes.by_thread.setdefault(threading.get_ident(), WorkerProcess())
    try:
        return process.run(
            request, lambda stage: None, timeout=settings.timeout, retries=settings.retries, stop=processes.stop
        )
    finally:
        process.close_after(0 if processes.stop.is_set() else _IDLE_SECONDS)


def _rebased_job(job: Job, root: Path) -> Job:
    """Return the same job with all its paths below another root."""
    mesh, folder, staging = (_rebased(path, root) for path in (job.mesh, job.folder, job.staging))
    spec = job.spec.with_files(lambda path: str(_rebased(Path(path), root)))
    return replace(job, mesh=mesh, folder=folder, staging=staging, spec=spec)


def _rebased(path: Path, root: Path) -> Path:
    return root / path.relative_to(path.anchor)
