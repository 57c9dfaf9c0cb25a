"""Progress of a batch: a live table on a terminal, one line per asset in a log; and the summary at the end."""

import sys
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any

import click

from aoprecalc.errors import counted
from aoprecalc.pipeline import AssetResult, BatchProgress, BatchResult
from aoprecalc.pipeline.jobs import Asset

_MAX_NAME_WIDTH = 48  # columns


class BatchTable(BatchProgress, AbstractContextManager["BatchTable"]):
    """Shows the running assets on a terminal; prints a line for each finished asset in a log. All on stderr."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        """Start the clock."""
        self._quiet, self._verbose = quiet, verbose and not quiet
        self._total, self._counts = 0, dict[str, int]()
        self._running: dict[str, tuple[str, float, float]] = {}  # name -> stage, when the asset and the stage began
        self._live: Any = None
        self._started = time.monotonic()

    def __enter__(self) -> "BatchTable":
        """Start the live table if stderr is a terminal."""
        if sys.stderr.isatty() and not self._quiet:
            from rich.console import Console
            from rich.live import Live

            self._live = Live(get_renderable=self._draw, console=Console(stderr=True), transient=True)
            self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove the live table."""
        if self._live is not None:
            self._live.__exit__(kind, error, trace)

    def begin(self, total: int) -> None:
        """Set the number of assets."""
        self._total = total

    def stage(self, asset: Asset, name: str) -> None:
        """Show the stage of an asset; with `verbose`, print the seconds of the one before."""
        now = time.monotonic()
        self._say_seconds(asset.name)
        self._running[asset.name] = (name, self._running[asset.name][1] if asset.name in self._running else now, now)

    def end(self, result: AssetResult) -> None:
        """Count a result and print its line; beside a live table only that of a failure."""
        self._say_seconds(result.asset.name)
        self._running.pop(result.asset.name, None)
        self._counts[result.status] = self._counts.get(result.status, 0) + 1
        if result.status == "failed" or (self._live is None and result.status in ("made", "cached")):
            done = sum(self._counts.values())
            head = f"[{done:>{len(str(self._total))}}/{self._total}] {result.status:<7} {result.seconds:6.1f} s"
            self.note(f"{head}  {result.asset.name}")
            if self._verbose and result.failure is not None and result.failure.details:
                self._say(result.failure.details.rstrip())
        if result.status in ("made", "cached"):
            for line in (result.summary or {}).get("warnings", ()):
                self.warn(f"{result.asset.name}: {line}")

    def _say_seconds(self, name: str) -> None:
        if self._verbose and name in self._running:
            stage, _, began = self._running[name]
            self._say(_printable(f"{name}: {stage}: {time.monotonic() - began:.2f} s"))

    def note(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self._quiet:
            self._say(_printable(text))

    def warn(self, text: str) -> None:
        """Print a warning."""
        self._say(_printable(f"warning: {text}"))

    def _say(self, text: str) -> None:
        if self._live is not None:
            self._live.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(text, err=True)

    def _draw(self) -> Any:
        """Return the live table as it is now."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        now, done = time.monotonic(), sum(self._counts.values())
        table = Table.grid(padding=(0, 2))
        for name, (stage, started, _) in self._running.copy().items():
            table.add_row(Text(f"  {name}", overflow="ellipsis", no_wrap=True), Text(stage), f"{now - started:6.1f} s")
        head = Table.grid(padding=(0, 2))
        failed = self._counts.get("failed", 0)
        words = f"{done}/{self._total}" + (f", {failed} failed" if failed else "")
        head.add_row(ProgressBar(self._total or 1, done, width=40), words, f"{now - self._started:.0f} s")
        return Group(head, table)


def table(result: BatchResult) -> list[str]:
    """Return the lines at the end: one for each asset that was made or failed, and the counts."""
    rows = [entry for entry in result.results if entry.status in ("made", "cached", "failed")]
    width = min(_MAX_NAME_WIDTH, max((len(entry.asset.name) for entry in rows), default=0))
    lines = [
        f"{entry.status:<6} {entry.seconds:7.1f} s  {entry.asset.name:<{width}}  {_summary(entry)}" for entry in rows
    ]
    counts, total = result.report.counts.to_dict(), len(result.results)
    words = ", ".join(f"{count} {status}" for status, count in counts.items() if count)
    return [
        *map(_printable, lines),
        f"{counted(total, 'asset')}: {words}; {result.report.seconds:.1f} s",
    ]


def _printable(line: str) -> str:
    """Replace characters that a terminal or a log reader could interpret, such as escapes, by `?`."""
    return "".join(char if char.isprintable() else "?" for char in line)


def _summary(result: AssetResult) -> str:
    """Return the summary of an asset, or why it failed."""
    if result.failure is not None:
        return result.failure.message
    summary, parts = result.summary or {}, []
    if "ao_mean" in summary:
        width, height = summary["size"]
        triangles = counted(summary["triangles"], "triangle")
        parts.append(f"{triangles}, {width} x {height}, mean AO {summary['ao_mean']:.3f}")
    if summary.get("rmse") is not None:
        parts.append(f"RMS error {summary['rmse']:.4f}")
    if "spheres" in summary:
        parts.append(f"{counted(summary['spheres'], 'sphere')}, silhouette IoU {summary['silhouette_iou']:.3f}")
    if warnings := len(summary.get("warnings", ())):
        parts.append(counted(warnings, "warning"))
    return ", ".join(parts)
