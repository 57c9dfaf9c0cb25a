"""How long each stage of a job took."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from aoprecalc.progress import Progress


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
