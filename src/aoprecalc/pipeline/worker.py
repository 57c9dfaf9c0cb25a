"""A worker process: does what its parent asks for, one thing after the other.

Usage: python -m aoprecalc.pipeline.worker <file descriptor of a connection> <process of the parent>
"""

import os
import signal
import sys
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection

from aoprecalc.pipeline.jobs import Job, local_visibility, work
from aoprecalc.pipeline.visibility_task import VisibilityTask, VisibilityWorker
from aoprecalc.subprocesses import end_with_parent
from aoprecalc.visibility.gather import VisibilityFactory


def main() -> None:
    """Work until the parent closes the connection or dies."""
    end_with_parent()
    if os.getppid() != int(sys.argv[2]):  # it died before that
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    connection, eyes = Connection(int(sys.argv[1])), VisibilityWorker()
    try:
        while True:
            request = connection.recv()
            if isinstance(request, VisibilityTask):
                connection.send(eyes.look(request))
            else:
                connection.send(work(request, connection.send, _sight_of))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _sight_of(job: Job) -> AbstractContextManager[VisibilityFactory]:
    """Have a job's process look by itself, or the workers of a cluster."""
    if job.spread is None:
        return local_visibility(job)
    from aoprecalc.pipeline.dask_client import DaskVisibility  # needs an extra

    return DaskVisibility(job.spread, job.shown)


if __name__ == "__main__":
    main()
