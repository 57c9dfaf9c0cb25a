"""`aoprecalc bake`."""

from typing import Any

import click

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import common, light, memory, option, shadow_size, size
from aoprecalc.options import RANGES, BakeOptions


@click.command(short_help="Bake an ambient-occlusion texture.")
@click.argument("mesh")
@click.option(
    "-o", "--output", metavar="PATH", help="The texture (.png, .exr, .tif), or a folder. [default: <stem>_ao.png]"
)
@click.option(
    "--mesh-output", metavar="PATH", help="The mesh with the texture's UVs. [default: <stem>_ao.<ext> beside it]"
)
@click.option("--size", type=size, metavar="N|WxH", default="1024", show_default=True, help="Texels of the texture.")
@option("-n", "--directions", of=BakeOptions, field="directions", help="Directions of light, uniform on the sphere.")
@option("--sampling", of=BakeOptions, field="sampling", help="An even lattice of directions, or random ones.")
@option("--seed", of=BakeOptions, field="seed", help="Of the random directions.")
@option(
    "--estimator", of=BakeOptions, field="estimator", help="ratio is exactly 1 on an open point; mean is the plain sum."
)
@click.option(
    "--shadow-size",
    type=shadow_size,
    metavar="N|auto",
    default="auto",
    show_default=True,
    help="Side of a near/far map, in texels.",
)
@option("--backend", of=BakeOptions, field="backend", help="What measures visibility.")
@option("--unwrap", of=BakeOptions, field="unwrap", help="auto keeps the file's UVs if they can hold a bake.")
@click.option(
    "--unwrap-timeout",
    type=click.FloatRange(*RANGES["unwrap_timeout"], min_open=True),
    metavar="SECONDS",
    help="Give up, with exit code 1, if xatlas or uvunwrap takes longer.",
)
@option("--padding", of=BakeOptions, field="padding", help="Texels by which charts are extended.")
@option("--fill", of=BakeOptions, field="fill", help="What texels far from any chart hold.")
@option("--bit-depth", of=BakeOptions, field="bit_depth", help="auto: 8 for PNG, half for EXR.")
@option("--normals", of=BakeOptions, field="normals", help="auto: the file's, else smooth.")
@option(
    "--crease-angle",
    of=BakeOptions,
    field="crease_angle",
    help="Degrees; sharper edges are hard where normals are made. [default: 180; STL 40]",
)
@light
@option("--instances", of=BakeOptions, field="instances", help="A place in the texture for each, or one for all.")
@option(
    "--target-error",
    of=BakeOptions,
    field="target_error",
    help="Stop before -n directions once the estimated sampling error is at most E.",
)
@option("--threads", of=BakeOptions, field="threads", help="For software rendering and rays; 0: all cores.")
@click.option(
    "--memory-limit",
    type=memory,
    metavar="SIZE",
    help="Stay within this much memory, such as 1.5G: the same texture, in more time.",
)
@option("--pack", of=BakeOptions, field="pack", help="orm: in one picture with glTF's roughness and metalness.")
@click.option(
    "--verify", is_flag=True, help="Measure the texture against ray tracing, for the report; needs the extra ray."
)
@click.option("--report", metavar="FILE", help="Write what was read, chosen and measured as JSON.")
@common
def bake(mesh: str, size: tuple[int, int], **given: Any) -> None:
    """Bake the ambient occlusion of MESH (.obj .ply .stl .off .gltf .glb .dae .3mf) into a texture.

    Writes the texture and the mesh that it belongs to.
    """
    from aoprecalc.api.bake import bake
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    places = {name: given.pop(name) for name in ("output", "mesh_output", "report", "verify")}
    as_json = given.pop("as_json")
    options = BakeOptions(width=size[0], height=size[1], **given)
    result = bake(mesh, **places, options=options, progress=console)
    if as_json:
        click.echo(json_text(result.report), nl=False)
        return
    report = result.report
    ao, texels = report["ao"], report["texels"]
    size_text = f"{texels['width']} x {texels['height']}"
    click.echo(f"{result.texture_path}  {size_text}, mean {ao['mean']:.3f}, {report['directions']} directions")
    if options.target_error is not None and report["estimated_error"] is not None:
        click.echo(f"estimated sampling error {report['estimated_error']:.4f}")
    if report["verify"]:
        error = report["verify"]["levels"][0]
        click.echo(f"as rendered, against ray tracing: RMS error {error['rmse']:.4f}, 99% within {error['p99']:.4f}")
    others = "".join(f" + {name}" for name in report["outputs"]["others"])
    click.echo(f"{result.mesh_path}{others}  {report['input']['triangles']} triangles")
