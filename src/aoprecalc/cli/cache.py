"""`aoprecalc cache`: the results that batches share."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import DEFAULT_CACHE, option, output_options, quantity_type, say
from aoprecalc.errors import UsageError, counted, format_bytes
from aoprecalc.options.quantities import AGE, BYTES

if TYPE_CHECKING:
    from aoprecalc.pipeline.store import CacheReport

_folder = option("--cache", metavar="DIR", group="Cache", shown=DEFAULT_CACHE, help="The folder of the cache.")


@click.group(no_args_is_help=True, short_help="Print or prune the cache of results that batches share.")
def cache() -> None:
    """Print or prune the cache: a folder of results that batches share."""


@cache.command(cls=Command, short_help="Print where the cache is and how large it is.")
@_folder
@output_options
def info(cache: str | None, as_json: bool, quiet: bool, verbose: bool) -> None:
    """Print where the cache is, how many results it holds, and how large it is."""
    from aoprecalc.pipeline.store import Cache, CacheReport, default_cache

    folder = Path(cache) if cache else default_cache()
    _print(CacheReport(str(folder), holds=Cache(folder).usage()), as_json)


@cache.command(cls=Command, short_help="Remove results that are old, or exceed a size.")
@_folder
@option(
    "--max-size",
    type=quantity_type(BYTES),
    metavar=BYTES.metavar,
    group="Cache",
    help="Keep the most recently used results up to this size, such as 5G.",
)
@option(
    "--max-age",
    type=quantity_type(AGE),
    metavar=AGE.metavar,
    group="Cache",
    help="Keep the results that were used within this time, such as 30d.",
    more="Or `12h`, or `8w`.",
)
@option("--all", "everything", is_flag=True, group="Cache", help="Remove everything.")
@output_options
def prune(
    cache: str | None,
    max_size: int | None,
    max_age: float | None,
    everything: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Remove results that were last used long ago, those beyond a total size, or all."""
    from aoprecalc.pipeline.store import Cache, CacheReport, default_cache

    if max_size is None and max_age is None and not everything:
        raise UsageError("nothing says what to remove; give --max-size, --max-age or --all")
    folder = Path(cache) if cache else default_cache()
    removed = Cache(folder).prune(0 if everything else max_size, None if max_age is None else max_age * 86400)
    _print(CacheReport(str(folder), removed=removed), as_json)


def _print(report: "CacheReport", as_json: bool) -> None:
    if as_json:
        from aoprecalc.io.outputs import json_text

        click.echo(json_text(report.to_dict()), nl=False)
        return
    for verb, usage in (("holds", report.holds), ("removed", report.removed)):
        if usage is not None:
            say(f"{report.folder}  {verb} {counted(usage.entries, 'result')}, {format_bytes(usage.bytes)}")
