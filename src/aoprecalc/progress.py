"""The one type through which long steps say how far they are."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Progress:
    """Receives what a job is doing; this base class listens in silence.

    A job opens one stage after another, and within a stage may count work done.
    """

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Enter the stage `name`, of `total` units of work (None: not known beforehand)."""
        yield

    def advance(self, count: int = 1) -> None:
        """Count `count` more units of the present stage as done."""

    def step(self, text: str) -> None:
        """Say what the present stage is at; takes the place of what was said before."""

    def note(self, text: str) -> None:
        """Say one line that a curious user wants to know (what was chosen, and why)."""

    def warn(self, text: str) -> None:
        """Say one line that a user should know about the result."""


# How long each stage of a job took.


class Stopwatch:
    """Opens the stages of a job on its progress, and keeps the seconds of each."""

    def __init__(self, progress: Progress) -> None:
        """Start the total."""
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

    def seconds(self) -> dict[str, float]:
        """Return the seconds of each stage and of all since the start, to a millisecond."""
        total = time.perf_counter() - self._started
        return {name: round(value, 3) for name, value in {**self._seconds, "total": total}.items()}
