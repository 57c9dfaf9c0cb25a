"""A worker process: does what its parent asks for, one thing after the other.

Usage: python -m aoprecalc.pipeline.crew.worker <file descriptor of a connection> <process of the parent>
"""

import os
import signal
import sys
from multiprocessing.connection import Connection

from aoprecalc.children import end_with_parent
from aoprecalc.pipeline.crew.glance import Eyes, Glance
from aoprecalc.pipeline.crew.work import work


def main() -> None:
    """Work until the parent closes the connection or dies."""
    end_with_parent()
    if os.getppid() != int(sys.argv[2]):  # it died before that
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    connection, eyes = Connection(int(sys.argv[1])), Eyes()
    try:
        while True:
            request = connection.recv()
            connection.send(eyes.look(request) if isinstance(request, Glance) else work(request, connection.send))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


if __name__ == "__main__":
    main()
