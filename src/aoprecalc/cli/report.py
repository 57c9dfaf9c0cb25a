"""`aoprecalc report`."""

from collections import Counter
from typing import Any

import click

from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import FILE, Console, open_file, open_option, option, output_options, say
from aoprecalc.errors import counted


@click.command(cls=Command, short_help="Write a page that shows results in a browser.")
@click.argument("results", type=FILE, nargs=-1, required=True, metavar="RESULT...")
@option(
    "-o",
    "--output",
    metavar="FILE",
    group="Output",
    shown="report.html",
    help="The page (`.html`), or a folder for it.",
)
@option("--title", metavar="TEXT", group="Output", shown="by what it shows", help="Heading of the page.")
@open_option
@option(
    "--before",
    metavar="PATH",
    group="Measurement",
    multiple=True,
    shown="nothing",
    help="The results of another run, to compare with. May be repeated.",
    more="Assets belong together by their names: those of a batch, or their paths below the folder of results.",
)
@output_options
def report(results: tuple[str, ...], **given: Any) -> None:
    """Write one HTML file that shows what other commands have made; it opens from disk, with no network.

    RESULT is a mesh that bake wrote, its texture, a sphere set, a report (.json) of bake, verify or batch, or a folder
    of them, such as the output of a batch.
    """
    from aoprecalc.api.report import write_report
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given["quiet"], verbose=given["verbose"])
    written = write_report(
        list(results),
        given["output"],
        before=list(given["before"]) or None,
        title=given["title"],
        progress=console,
    )
    if given["as_json"]:
        click.echo(json_text(written.to_dict()), nl=False)
    else:
        counts = Counter(asset.change or asset.status for asset in written.assets)
        words = [f"{count} {word}" for word, count in counts.items() if word != "read"]
        found = ": ".join(filter(None, [counted(len(written.assets), "asset"), ", ".join(words)]))
        say(f"{written.output}  {found}; {written.bytes / 1e6:.1f} MB")
        if not written.interactive:
            console.note("the page has still pictures in place of 3D views")
    if given["opens"]:
        open_file(written.path, console)
