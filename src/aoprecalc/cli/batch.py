"""`aoprecalc batch`."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from aoprecalc.cli.bake import bake as bake_command
from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import (
    DEFAULT_CACHE,
    FILE,
    Console,
    annotate,
    explained,
    option,
    options_of,
    output_options,
    say,
    take,
)
from aoprecalc.cli.spheres import spheres as spheres_command
from aoprecalc.errors import AnswerError, StoppedError, UsageError, counted, one_or_many
from aoprecalc.options import BatchOptions

if TYPE_CHECKING:
    from aoprecalc.pipeline import BatchResult

# Options of bake and spheres that batch sets itself.
_SET_BY_BATCH = {"mesh_output", "report", "figures", "figure_direction", "measure", "as_json", "quiet", "verbose"}


class _BatchCommand(Command):
    """A command whose error about an option of bake or spheres says where it belongs."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the command line; raises UsageError for an option of bake or spheres."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            for name, command in (("bake", bake_command), ("spheres", spheres_command)):
                if any(error.option_name in entry.opts for entry in command.params):
                    found = f"{error.option_name} is an option of {name}"
                    raise UsageError(
                        f"{found}; write --{name} '{error.option_name} ...', all of them in one text"
                    ) from error
            raise


@click.command(cls=_BatchCommand, short_help="Bake and fit many meshes, each only when it has changed.")
@click.argument("patterns", type=FILE, nargs=-1, required=True, metavar="PATTERN|MANIFEST...")
@option(
    "-o",
    "--output",
    metavar="DIR",
    group="Output",
    common=True,
    shown="the manifest's",
    help="The folder for the results.",
)
@option(
    "--bake",
    multiple=True,
    metavar="OPTIONS",
    group="Output",
    common=True,
    shown="a bake with default options, unless --spheres is given",
    help="Bake textures with these options of `aoprecalc bake`, such as '-n 500 --size 512'. May be repeated.",
)
@option(
    "--spheres",
    multiple=True,
    metavar="OPTIONS",
    group="Output",
    common=True,
    help="Fit spheres with these options of `aoprecalc spheres`, such as '-n 64'. May be repeated.",
)
@option(
    "--report",
    metavar="FILE",
    group="Output",
    common=True,
    help="Write the result of each mesh as JSON.",
    more="A folder gets `batch.json`.",
)
@option(
    "--junit",
    metavar="FILE",
    group="Output",
    help="Write a JUnit file with a test case for each mesh.",
    more="A folder gets `batch.xml`.",
)
@option(
    "--html",
    metavar="FILE",
    group="Output",
    common=True,
    help="Write a page that shows the results, as `aoprecalc report` does.",
    more="A folder gets `batch.html`.",
)
@option("--cache", metavar="DIR", group="Cache", shown=DEFAULT_CACHE, help="The folder of results that batches share.")
@option("--no-cache", is_flag=True, group="Cache", help="Neither use a cache nor add to one.")
@options_of(BatchOptions)
@output_options
def batch(
    patterns: tuple[str, ...],
    output: str | None,
    bake: tuple[str, ...],
    spheres: tuple[str, ...],
    cache: str | None,
    no_cache: bool,
    report: str | None,
    junit: str | None,
    html: str | None,
    quiet: bool,
    verbose: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Bake textures and fit spheres of many meshes into DIR, several at a time.

    PATTERN is a mesh, a folder, or a quoted name with *, ?, or ** for any folders. MANIFEST.toml names meshes and the
    options of each.

    A result is made again only if its mesh, the options or the version of aoprecalc have changed. If a mesh fails, the
    others are still made, and the exit code is 1.
    """
    from aoprecalc.api.report import write_page
    from aoprecalc.cli.batch_table import BatchTable, table
    from aoprecalc.io import Outputs
    from aoprecalc.io.outputs import claim_output, json_text, write_json
    from aoprecalc.pipeline import default_cache, make_job_spec, plan_batch, run_batch
    from aoprecalc.pipeline.report import junit as junit_text

    options = take(BatchOptions, given)
    if no_cache and cache is not None:
        raise UsageError("--cache and --no-cache were given; omit one of them")
    spec = None
    if bake or spheres:
        spec = make_job_spec(
            _parse_options(bake_command, "--bake", bake), _parse_options(spheres_command, "--spheres", spheres)
        )
    planned = plan_batch(patterns, output, spec)
    requested = {"report": (report, ".json"), "junit": (junit, ".xml"), "html": (html, ".html")}
    paths = {name: _report_path(name, text, suffix) for name, (text, suffix) in requested.items() if text is not None}
    with Outputs() as outputs:
        outputs.protect(planned.protected_files())
        outputs.folder(planned.output)
        for name, path in paths.items():
            claim_output(outputs, requested[name][0], path)
        with BatchTable(quiet=quiet, verbose=verbose) as progress:
            result = run_batch(planned, None if no_cache else cache or default_cache(), options, progress)
        if "report" in paths:
            write_json(outputs.path(paths["report"]), result.report.to_dict())
        if "junit" in paths:
            outputs.path(paths["junit"]).write_text(junit_text(result.results, result.report.seconds), encoding="utf-8")
        if "html" in paths:
            write_page(outputs, paths["html"], result.report, progress=Console(quiet=quiet, verbose=verbose))
    if as_json:
        click.echo(json_text(result.report.to_dict()), nl=False)
    else:
        say(*table(result))
    for entry in result.results:
        if entry.failure is not None and entry.status == "failed":
            annotate("error", entry.failure.message, file=entry.asset.mesh)
    counts = result.report.counts
    if result.interrupted:
        done = len(result.results) - counts.failed - counts.stopped
        found = f"{done} of {counted(len(result.results), 'asset')} {one_or_many(done, 'is', 'are')} there"
        raise StoppedError(f"interrupted; {found}, the same command goes on")
    if not result.passed:
        raise AnswerError(_failure_message(result, planned.output))


def _failure_message(result: "BatchResult", folder: Path) -> str:
    counts, total = result.report.counts, len(result.results)
    found = f"{counts.failed} of {total} assets failed" if total > 1 else "the asset failed"
    if counts.stopped:
        found += f", {counts.stopped} {one_or_many(counts.stopped, 'was', 'were')} not finished"
    if total > counts.failed + counts.stopped:
        found += f", the others are in {folder}"
    return f"{found}; correct what failed and run the same command again"


def _report_path(name: str, text: str, suffix: str) -> Path:
    """Return the path of a report; raises UsageError for another extension, since the file could be a mesh."""
    from aoprecalc.io.outputs import output_path

    path = output_path(text, f"batch{suffix}")
    if path.suffix.lower() != suffix:
        raise UsageError(f"--{name} is {text!r}; expected a file whose name ends in {suffix}, or a folder")
    return path


def _parse_options(command: click.Command, name: str, texts: tuple[str, ...]) -> dict[str, Any] | None:
    """Return the options of a command that texts give, by argument; None where there is no text."""
    if not texts:
        return None
    text = " ".join(texts)
    try:
        words = shlex.split(text)
        context = command.make_context(command.name, ["MESH", *words], help_option_names=[])
    except ValueError as error:
        raise UsageError(f"{name} is {text!r}; a quotation in it has no end ({error})") from error
    except (click.UsageError, click.exceptions.Exit) as error:
        reason = explained(error) if isinstance(error, click.UsageError) else "--help is not an option here"
        raise UsageError(f"{name} is {text!r}: {reason}; see `aoprecalc {command.name} --help`") from error
    if context.args:
        raise UsageError(
            f"{name} is {text!r}: {context.args[0]!r} is not an option; write meshes before --{command.name}"
        )
    given = {key for key in context.params if context.get_parameter_source(key) is ParameterSource.COMMANDLINE}
    for own in sorted(given & _SET_BY_BATCH):
        option = own.removeprefix("as_").replace("_", "-")
        raise UsageError(f"{name} has --{option}, which batch, or a manifest, chooses; omit it there")
    return {key: context.params[key] for key in given - {"mesh"}}
