"""`aoprecalc spheres`."""

from typing import Any

import click
from click.core import ParameterSource

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import Command, option, option_name, options_of, output_options, take
from aoprecalc.errors import UsageError
from aoprecalc.options import SphereOptions


@click.command(cls=Command, short_help="Fit spheres that stand in for a mesh.")
@click.argument("mesh")
@option(
    "-o",
    "--output",
    metavar="PATH",
    group="Output",
    shown="<stem>_spheres.json",
    help="The sphere set (.json .csv .npz .ply .obj .glb .yml .yaml .urdf .usda), or a folder.",
)
@options_of(SphereOptions)
@option(
    "--measure",
    metavar="FILE",
    group="Spheres",
    help="Fit nothing: measure the spheres in FILE (.json .csv .npz) against MESH.",
)
@output_options
def spheres(mesh: str, **given: Any) -> None:
    """Fit spheres to the surface of MESH (.obj .ply .stl .off .gltf .glb .dae .3mf), for soft shadows or collisions.

    Writes them in the mesh's own coordinates, in the format of the output's extension.
    """
    from aoprecalc.api.spheres import fit_spheres, measure_spheres

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    output, as_json, measured = given.pop("output"), given.pop("as_json"), given.pop("measure")
    if measured is not None:
        _refuse_others(set(given) - {"samples", "seed"} | {"output"})
        options = SphereOptions(1, samples=given["samples"], seed=given["seed"])
        found_quality = measure_spheres(mesh, measured, options=options, progress=console)
        click.echo(found_quality.document if as_json else _table(found_quality.quality), nl=False)
        return
    options = take(SphereOptions, given)
    result = fit_spheres(mesh, output, options=options, progress=console)
    if as_json:
        click.echo(result.document, nl=False)
        return
    found = result.spheres
    state = "converged" if found.converged else "not converged"
    way = f"{state} after {found.iterations} iterations"
    if found.radius_rule == "own":
        way = f"after {found.iterations} steps"
    count = f"{len(found)} sphere{'s' if len(found) > 1 else ''}"
    click.echo(f"{result.path}  {count}, {way}")
    quality = result.quality
    parts = f", {quality['leak']:.3f} missing, {quality['spill']:.3f} beside" if "leak" in quality else ""
    error = quality["surface_error_mean"]
    click.echo(f"silhouettes {quality['silhouette_iou']:.3f} alike{parts}; surface error {error:.4f} of the diagonal")


def _refuse_others(names: set[str]) -> None:
    """Raise UsageError if an option was given that `--measure` does not use."""
    context = click.get_current_context()
    for name in sorted(names):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"--measure fits nothing, but {option_name(name)} was given as well; omit one of them")


def _table(quality: dict[str, float]) -> str:
    """A line for each figure."""
    return "".join(f"{name:20} {value:.6g}\n" for name, value in quality.items())
