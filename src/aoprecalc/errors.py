"""The ways a job can fail, each with the exit code that the command line gives it.

A message is one line: what was found, what was expected, what to do.
"""


class AoprecalcError(Exception):
    """The work failed; the base of every error this package raises on purpose."""

    exit_code = 1


class OutputError(AoprecalcError):
    """A result could not be written (exit code 1)."""


class AnswerError(AoprecalcError):
    """The work was done, and its answer is no; what was written stays (exit code 1)."""


class KilledError(AoprecalcError):
    """A process that did part of the work was killed, perhaps for want of memory (exit code 1)."""


class StoppedError(AoprecalcError):
    """The user has stopped the work; what was finished stays (exit code 130)."""

    exit_code = 130


class UsageError(AoprecalcError):
    """An option has a value that cannot be used (exit code 2)."""

    exit_code = 2


class RendererError(AoprecalcError):
    """No way to render was found on this machine (exit code 3)."""

    exit_code = 3


class InputError(AoprecalcError):
    """The input mesh is missing, unreadable or has nothing to work on (exit code 4)."""

    exit_code = 4
