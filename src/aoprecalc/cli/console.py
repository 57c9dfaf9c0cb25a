"""What a person sees while a command works: stages on a terminal, a few plain lines in a log. All of it on stderr."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from aoprecalc.progress import Progress


class Console(Progress):
    """Prints warnings always but when quiet, notes when asked, and stages with bars where stderr is a terminal."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        """Nothing is printed until there is something to say."""
        self._quiet = quiet
        self._verbose = verbose
        self._bars: Any = None
        self._task: Any = None

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Show the stage while it lasts; -v prints its seconds."""
        started = time.perf_counter()
        if sys.stderr.isatty() and not self._quiet:
            bars = _bars()
            outer, outer_task = self._bars, self._task
            with bars:
                self._bars, self._task = bars, bars.add_task(name, total=total, unit=unit)
                yield
            self._bars, self._task = outer, outer_task
        else:
            yield
        if self._verbose:
            click.echo(f"{name}: {time.perf_counter() - started:.2f} s", err=True)

    def advance(self, count: int = 1) -> None:
        """Move the bar of the present stage."""
        if self._bars is not None:
            self._bars.advance(self._task, count)

    def note(self, text: str) -> None:
        """Print a line about a choice that was made."""
        if not self._quiet:
            click.echo(text, err=True)

    def warn(self, text: str) -> None:
        """Print a line that begins with `warning:`."""
        if not self._quiet:
            click.echo(f"warning: {text}", err=True)


def _bars() -> Any:
    from rich.console import Console as Terminal
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description:<11}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[unit]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Terminal(stderr=True),
        transient=True,
    )
