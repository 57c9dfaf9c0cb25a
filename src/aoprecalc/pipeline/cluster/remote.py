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
from typing import Any

import aoprecalc
from aoprecalc.limits import whole_cores
from aoprecalc.pipeline.crew.child import Child
from aoprecalc.pipeline.crew.glance import Glance, Seen
from aoprecalc.pipeline.crew.work import Failure, Job, Outcome


@dataclass(frozen=True)
class Place:
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


@dataclass(eq=False)
class _Party:
    """The processes of one batch in this one, one for each thread."""

    stop: threading.Event = field(default_factory=threading.Event)
    children: dict[int, Child] = field(default_factory=dict)


_parties: dict[str, _Party] = {}


def look_around(folder: str, dask_worker: Any = None) -> Place:
    """Return what a worker, which the cluster hands over, is like; `folder` is to be seen from it."""
    resources = dask_worker.state.total_resources
    return Place(
        version=aoprecalc.__version__,
        host=socket.gethostname(),
        cores=whole_cores(),
        gpus=resources.get("GPU", 0),
        sees=os.path.isdir(folder),
    )


def work_in_folder(job: Job, batch: str, timeout: float | None, retries: int) -> Outcome:
    """Do a job of a batch on files that this machine sees under the same paths."""
    outcome: Outcome = _ask(job, batch, timeout, retries)
    return outcome


def work_on_bytes(
    job: Job, inputs: dict[str, bytes], batch: str, timeout: float | None, retries: int
) -> tuple[Outcome, dict[str, bytes]]:
    """Do a job of a batch on files that came with it; return what it made, name -> bytes, as well.

    inputs   path -> bytes; all paths are as on the machine of the batch, and lie here below a folder for the time
             being, so that the ways from one to the other are the same
    """
    with TemporaryDirectory(prefix="aoprecalc-") as root:
        there = _below(job, Path(root))
        for path, data in inputs.items():
            file = _moved(Path(path), Path(root))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        outcome = work_in_folder(there, batch, timeout, retries)
        if isinstance(outcome, Failure):
            return outcome, {}
        return outcome, {name: file.read_bytes() for name, file in outcome.files.items()}


def look_elsewhere(glance: Glance, subject: bytes, batch: str) -> Seen | Failure:
    """Look where a glance says, at a subject that is sent by itself, once for all glances."""
    seen: Seen | Failure = _ask(replace(glance, subject=subject), batch, None, 1)
    return seen


def end(batch: str) -> None:
    """End the processes of a batch."""
    party = _parties.pop(batch, None)
    if party is None:
        return
    party.stop.set()
    for child in list(party.children.values()):
        child.close_if_idle()


def _ask(request: Job | Glance, batch: str, timeout: float | None, retries: int) -> Any:
    """Have this thread's process of a batch do what is asked."""
    party = _parties.setdefault(batch, _Party())
    child = party.children.setdefault(threading.get_ident(), Child())
    try:
        return child.run(request, lambda stage: None, timeout=timeout, retries=retries, stop=party.stop)
    finally:
        if party.stop.is_set():
            child.close()


def _below(job: Job, root: Path) -> Job:
    """Return a job whose files lie below another root."""
    mesh, folder, staging = (_moved(path, root) for path in (job.mesh, job.folder, job.staging))
    return replace(job, mesh=mesh, folder=folder, staging=staging)


def _moved(path: Path, root: Path) -> Path:
    return root / path.relative_to(path.anchor)
