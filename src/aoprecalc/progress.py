"""Progress of long jobs: what receives it, and the seconds of each stage."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class Note(str):
    """A line for the user that needs no action; other strings among messages are warnings."""


def warnings_of(messages: Iterable[str]) -> tuple[str, ...]:
    """Return the messages that are warnings: lines about what may need an action."""
    return tuple(line for line in messages if not isinstance(line, Note))


def notes_of(messages: Iterable[str]) -> tuple[str, ...]:
    """Return the messages that need no action."""
    return tuple(line for line in messages if isinstance(line, Note))


class Progress:
    """Receives the progress of a job; this base class ignores it. Derive from it and override what is of interest.

    A job opens one stage after another, and may count units of work within a stage.
    """

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Enter a stage; it ends with the ``with`` block.

        Parameters
        ----------
        name : str
            What is done, such as ``"unwrap"`` or ``"visibility"``.
        total : int or None
            Units of work; None where the number is not known beforehand.
        unit : str
            What the units are, such as ``"directions"``.
        """
        yield

    def advance(self, count: int = 1) -> None:
        """Count `count` more units of the present stage as done."""

    def step(self, text: str) -> None:
        """Show what the present stage is doing; replaces the step before."""

    def note(self, text: str) -> None:
        """Show one line about the result, or a choice that was made; it needs no action."""

    def warn(self, text: str) -> None:
        """Show one line about what may need an action, such as faces that are lost."""


def tell(progress: Progress, messages: Iterable[str]) -> None:
    """Show messages: the notes, then the warnings."""
    lines = list(messages)
    for line in notes_of(lines):
        progress.note(line)
    for line in warnings_of(lines):
        progress.warn(line)


class StageTimer(Progress):
    """Keeps the seconds of each stage of a job, and passes all of its progress on."""

    def __init__(self, progress: Progress) -> None:
        """Start the total time."""
        self._progress = progress
        self._started = time.perf_counter()
        self._seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Time a stage of `total` units of work."""
        started = time.perf_counter()
        with self._progress.stage(name, total, unit):
            yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - started

    def advance(self, count: int = 1) -> None:
        """Pass it on."""
        self._progress.advance(count)

    def step(self, text: str) -> None:
        """Pass it on."""
        self._progress.step(text)

    def note(self, text: str) -> None:
        """Pass it on."""
        self._progress.note(text)

    def warn(self, text: str) -> None:
        """Pass it on."""
        self._progress.warn(text)

    def seconds(self) -> dict[str, float]:
        """Return the seconds of each stage and of all since the start, to a millisecond."""
        total = time.perf_counter() - self._started
        return {name: round(value, 3) for name, value in {**self._seconds, "total": total}.items()}
