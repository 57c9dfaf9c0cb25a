"""What commands print: results on stdout; progress, notes, warnings, annotations for GitHub workflows on stderr."""

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from aoprecalc.progress import Progress


def annotate(level: str, message: str, *, file: Path | None = None) -> None:
    """Print an annotation, which GitHub shows beside the file; nothing where no GitHub workflow runs.

    level   error, warning or notice
    """
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    where = f" file={_escaped(str(file)).replace(':', '%3A').replace(',', '%2C')}" if file is not None else ""
    click.echo(f"::{level}{where}::{_escaped(message)}", err=True)


def without_controls(text: str) -> str:
    """Return a text with ? for control characters: names in files may hold any, and steer a terminal."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f]", "?", text)


def say(*lines: str) -> None:
    """Print lines of a result on stdout, which may hold names from files."""
    click.echo("\n".join(map(without_controls, lines)))


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


class Console(Progress):
    """Prints warnings, and notes unless quiet; shows progress bars if stderr is a terminal."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        """Print nothing yet."""
        self._quiet = quiet
        self._verbose = verbose and not quiet
        self._bar: Any = None  # of the current stage; None without a terminal
        self._task: Any = None

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Show a stage while it lasts; with `verbose`, print its seconds."""
        started = time.perf_counter()
        if sys.stderr.isatty() and not self._quiet:
            with _bar(total) as self._bar:
                self._task = self._bar.add_task(name, total=total, unit=unit, step="")
                try:
                    yield
                finally:
                    self._bar = None
        else:
            yield
        if self._verbose:
            self._say(f"{name}: {time.perf_counter() - started:.2f} s")

    def advance(self, count: int = 1) -> None:
        """Advance the bar of the current stage."""
        if self._bar is not None:
            self._bar.advance(self._task, count)

    def step(self, text: str) -> None:
        """Show the step of the current stage on a terminal."""
        if self._bar is not None:
            self._bar.update(self._task, step=text)

    def note(self, text: str) -> None:
        """Print a note, unless quiet."""
        if not self._quiet:
            self._say(text)

    def warn(self, text: str) -> None:
        """Print a warning."""
        self._say(f"warning: {text}")

    def _say(self, line: str) -> None:
        line = without_controls(line)
        if self._bar is not None:  # above the bar, not through it
            self._bar.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(line, err=True)


def open_file(path: Path, console: Console) -> None:
    """Open a file in the system's viewer; a note tells where there is none."""
    from aoprecalc.system import has_desktop

    if not has_desktop() or click.launch(str(path)) != 0:
        console.note(f"{path}: no viewer was found to open it")


def _bar(total: int | None) -> Any:
    """Return a rich progress bar for one stage; it disappears when the stage ends."""
    from rich import progress
    from rich.console import Console as Terminal

    columns = [progress.SpinnerColumn(), progress.TextColumn("{task.description:<10}"), progress.TimeElapsedColumn()]
    columns.append(progress.TextColumn("{task.fields[step]}", markup=False))
    if total is not None:
        count = progress.TextColumn("{task.completed}/{task.total} {task.fields[unit]}")
        columns[2:] = [progress.BarColumn(), count, progress.TimeRemainingColumn(), progress.TextColumn("left")]
    return progress.Progress(*columns, console=Terminal(stderr=True), transient=True)
