"""What a worker of a cluster does for a batch: it hands jobs on to processes of its own.

So a job that dies takes no worker with it, jobs of one worker do not wait for each other, and each has OpenGL in a
process where nothing else uses it.
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


@dataclass(frozen=True)
class WorkerInfo:
    """A worker as a batch needs to know it.

    version   of its aoprecalc
    host      its machine
    cores     that it may use
    gpus      that it offers, as resource GPU; 0: it says nothing
    sees      it has the folder that was asked for
    """

    version: str
    host: str
    cores: int
    gpus: float
    sees: bool


@dataclass(frozen=True)
class BatchSettings:
    """On which a batch has its work done.

    batch     its name, which no other has
    version   of aoprecalc that it expects
    timeout   seconds for a job; None: any
    retries   how often a job whose process died is tried again
    """

    batch: str
    version: str
    timeout: float | None = None
    retries: int = 1


@dataclass(eq=False)
class _BatchProcesses:
    """The processes of one batch in this one, one for each thread."""

    stop: threading.Event = field(default_factory=threading.Event)
    children: dict[int, WorkerProcess] = field(default_factory=dict)


_IDLE = 60  # seconds after which a process goes that nothing was asked of: its batch may have died without a word

_batches: dict[str, _BatchProcesses] = {}


def worker_info(folder: str, dask_worker: Any = None) -> WorkerInfo:
    """Return what a worker, which the cluster hands over, is like; `folder` is to be seen from it."""
    resources = dask_worker.state.total_resources
    return WorkerInfo(
        version=__version__,
        host=socket.gethostname(),
        cores=whole_cores(),
        gpus=resources.get("GPU", 0),
        sees=os.path.isdir(folder),
    )


def run_in_shared_folder(job: Job, terms: BatchSettings) -> Outcome:
    """Do a job on files that this machine sees under the same paths."""
    if not job.staging.parent.is_dir():
        return Failure("error", f"{job.label}: {socket.gethostname()} does not see {job.folder}; use --ship bytes")
    return cast(Outcome, _ask(job, terms))


def run_on_bytes(job: Job, inputs: dict[str, bytes], terms: BatchSettings) -> tuple[Outcome, dict[str, bytes]]:
    """Do a job on files that came with it; return what it made, name -> bytes, as well.

    inputs   path -> bytes; all paths are as on the machine of the batch, and lie here below a folder for the time
             being, so that the ways from one to the other are the same
    """
    with TemporaryDirectory(prefix="aoprecalc-") as root:
        there = _below(job, Path(root))
        for path, data in inputs.items():
            file = _moved(Path(path), Path(root))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        there.staging.parent.mkdir(parents=True, exist_ok=True)
        outcome = run_in_shared_folder(there, terms)
        if isinstance(outcome, Failure):
            return outcome, {}
        return outcome, {name: file.read_bytes() for name, file in outcome.files.items()}


def evaluate_remotely(glance: VisibilityTask, subject: bytes, terms: BatchSettings) -> VisibilitySums | Failure:
    """Look where a glance says, at a subject that is sent by itself, once for all glances."""
    return cast(VisibilitySums | Failure, _ask(replace(glance, inputs=subject), terms))


def end(batch: str) -> None:
    """End the processes of a batch, for good."""
    party = _batches.setdefault(batch, _BatchProcesses())
    party.stop.set()
    for child in list(party.children.values()):
        child.close_if_idle()


def _ask(request: Job | VisibilityTask, terms: BatchSettings) -> Any:
    """Have this thread's process of a batch do what is asked."""
    party = _batches.setdefault(terms.batch, _BatchProcesses())
    if terms.version != __version__:
        here = f"{socket.gethostname()} has aoprecalc {__version__}"
        return Failure("error", f"{request.label}: {here}, {terms.version} was expected; install the same everywhere")
    if party.stop.is_set():
        return Failure("stopped", f"{request.label}: was stopped")
    child = party.children.setdefault(threading.get_ident(), WorkerProcess())
    try:
        return child.run(request, lambda stage: None, timeout=terms.timeout, retries=terms.retries, stop=party.stop)
    finally:
        child.close_after(0 if party.stop.is_set() else _IDLE)


def _below(job: Job, root: Path) -> Job:
    """Return a job whose files lie below another root."""
    mesh, folder, staging = (_moved(path, root) for path in (job.mesh, job.folder, job.staging))
    return replace(job, mesh=mesh, folder=folder, staging=staging)


def _moved(path: Path, root: Path) -> Path:
    return root / path.relative_to(path.anchor)
