"""Work on a file in a process of its own, for libraries that damage in the file may hang or crash."""

import os
import pickle
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.subprocesses import ChildTimeoutError, ask, end_with_parent

_SECONDS, _BYTES_PER_SECOND = 60.0, 1e6  # for which a child may work
_MAX_REASON = 120  # characters of an error that are passed on


@dataclass(frozen=True)
class LibraryProcess:
    """What a library does to a file in another process, a new one for each request.

    library   its name, for messages
    package   whose function `answer` calls `answer_request`, in the child
    """

    library: str
    package: str

    @property
    def command(self) -> list[str]:
        """The command that starts the child."""
        return [sys.executable, "-P", "-c", f"from {self.package} import answer; answer()"]

    def work(self, path: Path, size: int, request: object) -> Any:
        """Return what the child makes of a request about a file of `size` bytes.

        Raises InputError where the library crashes or takes too long, else what `ask` raises.
        """
        try:
            return self.ask(size, request)
        except ChildTimeoutError as error:
            raise damaged_file(path, f"{self.library} gave {error}") from error
        except OSError as error:
            raise damaged_file(path, f"{self.library} could not read it ({error})") from error

    def ask(self, size: int, request: object) -> Any:
        """Return the child's answer; its time depends on `size`, or on the bytes that it reports as its step.

        Raises the AoprecalcError that it answers, ChildTimeoutError, and ChildProcessError where it fails.
        """
        started = time.monotonic()

        def limit(step: str) -> None:
            seconds = _SECONDS + (int(step) if step.isdigit() else size) / _BYTES_PER_SECOND
            if time.monotonic() - started > seconds:
                raise ChildTimeoutError(round(seconds), step)

        found = pickle.loads(ask(self.command, pickle.dumps(request), limit))
        if isinstance(found, AoprecalcError):
            raise found
        return found


def answer_request(work: Callable[[Any], object]) -> None:
    """In the child: send back what `work` makes of the request, or its AoprecalcError.

    The process ends at once then, without freeing memory, which a library may have left in disorder.
    """
    end_with_parent()
    found: object
    try:
        with np.errstate(all="ignore"):
            found = work(pickle.loads(sys.stdin.buffer.read()))
    except AoprecalcError as error:
        found = error
    except Exception as error:
        sys.exit(" ".join(str(error).split())[:_MAX_REASON] or type(error).__name__)
    sys.stdout.buffer.write(pickle.dumps(found))
    sys.stdout.buffer.flush()
    os._exit(0)
