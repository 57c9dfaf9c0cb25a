"""`aoprecalc spheres`."""

from typing import Any

import click

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import common, option
from aoprecalc.options import SphereOptions


@click.command(short_help="Fit spheres that stand in for a mesh.")
@click.argument("mesh")
@click.option(
    "-o", "--output", metavar="PATH", help="The sphere set (.json), or a folder. [default: <stem>_spheres.json]"
)
@option("-n", "--spheres", of=SphereOptions, field="spheres", help="How many.")
@option("-s", "--samples", of=SphereOptions, field="samples", help="Points drawn on the surface.")
@option("--seed", of=SphereOptions, field="seed", help="Of the samples and every random choice.")
@option(
    "--radius",
    of=SphereOptions,
    field="radius",
    help="mean or greatest distance of a sphere's samples, or one mean for all.",
)
@option("--init", of=SphereOptions, field="init", help="Where the spheres start.")
@option("--max-iterations", of=SphereOptions, field="max_iterations", help="Stop here even if not converged.")
@common
def spheres(mesh: str, **given: Any) -> None:
    """Fit spheres to the surface of MESH (.obj .ply .stl .off .gltf .glb), for casting soft shadows.

    Writes them as JSON, in the mesh's own coordinates.
    """
    from aoprecalc import recipes

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    output, as_json = given.pop("output"), given.pop("as_json")
    result = recipes.fit_spheres(mesh, output, options=SphereOptions(**given), progress=console)
    if as_json:
        click.echo(result.path.read_text(encoding="utf-8"), nl=False)
        return
    found = result.spheres
    state = "converged" if found.converged else "not converged"
    count = f"{len(found)} sphere{'s' if len(found) > 1 else ''}"
    click.echo(f"{result.path}  {count}, {state} after {found.iterations} iterations")
