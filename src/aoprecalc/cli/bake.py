"""`aoprecalc bake`."""

from typing import Any

import click

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import FILE, Command, option, options_of, output_options, take
from aoprecalc.options import BakeOptions


@click.command(cls=Command, short_help="Bake an ambient-occlusion texture.")
@click.argument("mesh", type=FILE)
@option(
    "-o",
    "--output",
    metavar="PATH",
    group="Output",
    shown="<stem>_ao.png",
    help="The texture (.png .exr .tif .jpg .tga .bmp), or a folder.",
    more="The folder exists, or the name ends in a slash; then it is made.",
)
@option(
    "--mesh-output",
    metavar="PATH",
    group="Output",
    shown="<stem>_ao.<ext> beside the texture",
    help="The mesh with the texture's UVs (.obj .ply .gltf .glb).",
)
@option(
    "--verify",
    is_flag=True,
    group="Output",
    help="Measure the texture against ray tracing, for the report.",
)
@option("--report", metavar="FILE", group="Output", help="Write what was read, chosen and measured as JSON.")
@options_of(BakeOptions)
@output_options
def bake(mesh: str, **given: Any) -> None:
    """Bake the ambient occlusion of MESH (.obj .ply .stl .off .gltf .glb .dae .zae .3mf) into a texture.

    Writes the texture and the mesh that it belongs to.
    """
    from aoprecalc.api.bake import bake_file
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    outputs = {name: given.pop(name) for name in ("output", "mesh_output", "report", "verify")}
    as_json = given.pop("as_json")
    options = take(BakeOptions, given)
    result = bake_file(mesh, **outputs, options=options, progress=console)
    files, report = result.files, result.report
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
        return
    texture_size = f"{report.texels.width} x {report.texels.height}"
    click.echo(f"{files.texture}  {texture_size}, mean {report.ao.mean:.3f}, {report.directions} directions")
    if options.target_error is not None and report.estimated_error is not None:
        click.echo(f"estimated sampling error {report.estimated_error:.4f}")
    if report.verify is not None:
        error = report.verify.levels[0]
        click.echo(f"as rendered, against ray tracing: RMS error {error.rmse:.4f}, 99% within {error.p99:.4f}")
    others = "".join(f" + {name}" for name in report.outputs.others)
    click.echo(f"{files.mesh}{others}  {report.input.triangles} triangles")
