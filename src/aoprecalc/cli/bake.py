"""`aoprecalc bake`."""

from typing import Any

import click

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import ShadowSize, Size, common, option
from aoprecalc.options import BakeOptions

O = BakeOptions


@click.command(short_help="Bake an ambient-occlusion texture.")
@click.argument("mesh")
@click.option(
    "-o", "--output", metavar="PATH", help="The texture (.png, .exr, .tif), or a folder. [default: <stem>_ao.png]"
)
@click.option(
    "--mesh-output", metavar="PATH", help="The mesh with the texture's UVs. [default: <stem>_ao.<ext> beside it]"
)
@click.option("--size", type=Size(), default="1024", show_default=True, help="Texels of the texture.")
@option("-n", "--directions", of=O, field="directions", help="Directions of light, uniform on the sphere.")
@option("--sampling", of=O, field="sampling", help="An even lattice of directions, or random ones.")
@option("--seed", of=O, field="seed", help="Of the random directions.")
@option("--estimator", of=O, field="estimator", help="ratio is exactly 1 on an open point; mean is the plain sum.")
@click.option(
    "--shadow-size", type=ShadowSize(), default="auto", show_default=True, help="Side of a near/far map, in texels."
)
@option("--backend", of=O, field="backend", help="What measures visibility.")
@option("--unwrap", of=O, field="unwrap", help="auto keeps the file's UVs if they can hold a bake.")
@option("--padding", of=O, field="padding", help="Texels by which charts are extended.")
@option("--fill", of=O, field="fill", help="What texels far from any chart hold.")
@option("--bit-depth", of=O, field="bit_depth", help="auto: 8 for PNG, half for EXR.")
@option("--normals", of=O, field="normals", help="auto: the file's, else smooth.")
@option(
    "--crease-angle",
    of=O,
    field="crease_angle",
    help="Degrees; sharper edges are hard where normals are made. [default: 180; STL 40]",
)
@option("--threads", of=O, field="threads", help="For software rendering; 0: all cores.")
@click.option("--report", metavar="FILE", help="Write what was read, chosen and measured as JSON.")
@common
def bake(mesh: str, size: tuple[int, int], **given: Any) -> None:
    """Bake the ambient occlusion of MESH (.obj .ply .stl .off .gltf .glb) into a texture.

    Writes the texture and the mesh that it belongs to.
    """
    from aoprecalc import recipes
    from aoprecalc.files.reports import report_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    places = {name: given.pop(name) for name in ("output", "mesh_output", "report")}
    as_json = given.pop("as_json")
    options = BakeOptions(width=size[0], height=size[1], **given)
    result = recipes.bake(mesh, **places, options=options, progress=console)
    if as_json:
        click.echo(report_text(result.report), nl=False)
        return
    report = result.report
    ao, texels = report["ao"], report["texels"]
    click.echo(
        f"{result.texture_path}  {texels['width']} x {texels['height']}, mean {ao['mean']:.3f}, {report['directions']} directions"
    )
    click.echo(f"{result.mesh_path}  {report['input']['triangles']} triangles, UVs: {report['unwrap']['method']}")
