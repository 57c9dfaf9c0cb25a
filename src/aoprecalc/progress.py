"""The one type through which long steps say how far they are."""

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
