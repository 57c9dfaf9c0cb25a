"""`aoprecalc preview`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from aoprecalc.cli.commands import MeshCommand
from aoprecalc.cli.options import (
    FILE,
    Console,
    open_file,
    open_option,
    option,
    options_of,
    output_options,
    say,
    take,
)
from aoprecalc.errors import counted
from aoprecalc.options import PreviewOptions

if TYPE_CHECKING:
    from aoprecalc.api.preview import PreviewReport


@click.command(
    cls=MeshCommand,
    many="aoprecalc report MESH... -o report.html",
    short_help="Draw a mesh with its ambient occlusion.",
)
@click.argument("mesh", type=FILE)
@option(
    "-o",
    "--output",
    metavar="PATH",
    group="Output",
    common=True,
    shown="<stem>_preview.png",
    help="The picture ({pictures}), or a folder; of a turntable a .webp, or a folder of frames.",
    more="A folder exists, or its name ends in a slash; then it is made. A turntable is `<stem>_turntable.webp` unless "
    "something else is asked for; its frames are `0000.png` and so on.",
)
@open_option
@option(
    "--texture",
    metavar="FILE",
    group="Picture",
    common=True,
    shown="the one that MESH refers to, else <stem>.png beside it",
    help="The ambient-occlusion texture, for any mesh with UVs.",
)
@option(
    "--spheres",
    metavar="FILE",
    group="Picture",
    common=True,
    help="Show these spheres as well ({sphere sets}).",
    more="They may come from any program, as for `aoprecalc spheres --measure`; of several levels the finest is shown.",
)
@options_of(PreviewOptions)
@output_options
def preview(mesh: str, **given: Any) -> None:
    """Draw MESH ({meshes}) with its ambient occlusion.

    MESH is one that `bake` wrote, or the texture that it wrote beside one. Any mesh with UVs shows a --texture; without
    a texture it is drawn as clay.
    """
    from aoprecalc.api.preview import preview_file
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    files = {name: given.pop(name) for name in ("output", "texture", "spheres")}
    as_json, opens = given.pop("as_json"), given.pop("opens")
    report = preview_file(mesh, **files, options=take(PreviewOptions, given), progress=console)
    first = Path(report.outputs[0])
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
    else:
        last = f" to {Path(report.outputs[-1]).name}" if len(report.outputs) > 1 else ""
        say(f"{first}{last}  {report.width} x {report.height}, {_shown(report)}")
    if opens:
        open_file(first, console)


def _shown(report: "PreviewReport") -> str:
    """Return what was drawn, in words."""
    mesh = f"{report.input.path}, {counted(report.input.triangles, 'triangle')}"
    texture = f" with {report.texture}" if report.texture and report.shading != "clay" else ""
    spheres = "" if report.spheres is None else f", {counted(report.spheres, 'sphere')}"
    views = f", {report.pictures} pictures" if report.pictures > 1 else ""
    return f"{report.shading}: {mesh}{texture}{spheres}{views}"
