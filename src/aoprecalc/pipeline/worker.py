"""A worker process: runs jobs and visibility tasks for the process that started it.

Usage: python -m aoprecalc.pipeline.worker <process ID of the parent>; see `subprocesses.serve`
"""

import pickle
from contextlib import AbstractContextManager, ExitStack
from typing import Any

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.pipeline.jobs import Failure, Job, VisibilitySums, VisibilityTask, local_visibility, run_job
from aoprecalc.progress import Progress
from aoprecalc.subprocesses import StepCallback, serve
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import LocalVisibility, VisibilityFactory, VisibilitySource


class VisibilityWorker:
    """Evaluates visibility tasks, and keeps the setup of the present bake and side for the next task."""

    def __init__(self) -> None:
        """Set nothing up yet."""
        self._stack = ExitStack()
        self._bake_id, self._side = "", -1
        self._setup: BakeSetup | None = None
        self._source: VisibilitySource | None = None

    def evaluate(self, task: VisibilityTask) -> VisibilitySums | Failure:
        """Return the visibility sums of a task, or why there are none."""
        try:
            setup, source = self._prepare(task)
            samples = setup.samples(setup.sides[task.side], task.request.rows, task.request.group)
            sums = source.visibility_sums(samples, task.request)
            setup.backend.check_errors()
        except (AoprecalcError, MemoryError, OSError) as error:
            return Failure("error", f"{task.label}: {error}", getattr(error, "exit_code", 1))
        return VisibilitySums(np.asarray(sums))

    def _prepare(self, task: VisibilityTask) -> tuple[BakeSetup, VisibilitySource]:
        """Return the setup and the visibility source of a task, made anew where the bake or the side is another."""
        if task.bake_id != self._bake_id or self._setup is None:
            self._source = self._setup = None
            self._stack.close()
            inputs: BakeInputs = pickle.loads(task.inputs)
            backend = self._stack.enter_context(open_backend(inputs.options, Progress()))
            self._setup, self._bake_id, self._side = BakeSetup(backend, inputs), task.bake_id, -1
        if self._side != task.side or self._source is None:
            self._source = None  # before the next is made, as two would hold twice the memory
            side = self._setup.sides[task.side]
            self._source = LocalVisibility(self._setup, side, task.shadow_size, task.chunk_size, Progress())
            self._side = task.side
        return self._setup, self._source


def _visibility_of(job: Job) -> AbstractContextManager[VisibilityFactory]:
    """Evaluate the visibility of a job in this process, or on the cluster that the job names."""
    if job.scheduler is None:
        return local_visibility(job)
    from aoprecalc.pipeline.dask_client import DaskVisibility  # needs an extra

    return DaskVisibility(job.scheduler, job.label)


def main() -> None:
    """Answer requests until the parent closes the connection or dies."""
    visibility = VisibilityWorker()

    def answer(request: Job | VisibilityTask, on_stage: StepCallback) -> Any:
        if isinstance(request, VisibilityTask):
            return visibility.evaluate(request)
        return run_job(request, on_stage, _visibility_of)

    serve(answer)


if __name__ == "__main__":
    main()
