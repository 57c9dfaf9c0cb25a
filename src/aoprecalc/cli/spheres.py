"""`aoprecalc spheres`."""

from typing import Any

import click
from click.core import ParameterSource

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import common, levels, option
from aoprecalc.errors import UsageError
from aoprecalc.options import SphereOptions


@click.command(short_help="Fit spheres that stand in for a mesh.")
@click.argument("mesh")
@click.option(
    "-o",
    "--output",
    metavar="PATH",
    help="The sphere set, its kind by the extension (.json .csv .npz .ply .obj .glb .yml .yaml .urdf .usda), or a "
    "folder. [default: <stem>_spheres.json]",
)
@option("-n", "--spheres", of=SphereOptions, field="spheres", help="How many.")
@option(
    "--method",
    of=SphereOptions,
    field="method",
    help="Means of clusters, least squares, the best silhouettes, or spheres that hold the whole surface.",
)
@option(
    "--tolerance",
    of=SphereOptions,
    field="tolerance",
    help="Instead of -n: few, with an error of at most E: 1 - silhouette IoU for shadow and collision, else the "
    "mean surface error.",
)
@click.option(
    "--levels", type=levels, metavar="N,N,...", help="Instead of -n: several sets, coarse to fine (JSON only)."
)
@click.option(
    "--measure", metavar="FILE", help="Fit nothing: measure the spheres in FILE (.json .csv .npz) against MESH."
)
@option("-s", "--samples", of=SphereOptions, field="samples", help="Points drawn on the surface.")
@option("--seed", of=SphereOptions, field="seed", help="Of the samples and every random choice.")
@option(
    "--radius",
    of=SphereOptions,
    field="radius",
    help="mean or greatest distance of a sphere's samples, or one mean for all.",
)
@option(
    "--init",
    of=SphereOptions,
    field="init",
    help="Start at the first samples, or at some that are spread (lloyd, algebraic).",
)
@option(
    "--max-iterations",
    of=SphereOptions,
    field="max_iterations",
    help="Stop here even if not converged (lloyd, algebraic).",
)
@common
def spheres(mesh: str, **given: Any) -> None:
    """Fit spheres to the surface of MESH (.obj .ply .stl .off .gltf .glb .dae .3mf), to cast shadows or collide.

    Writes them, in the mesh's own coordinates, as JSON or as what the output's extension says.
    """
    from aoprecalc.api.spheres import fit_spheres, measure_spheres

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    output, as_json, measured = given.pop("output"), given.pop("as_json"), given.pop("measure")
    if measured is not None:
        _refuse_beside("--measure", "fits nothing", *(set(given) - {"samples", "seed"}), "output")
        options = SphereOptions(1, samples=given["samples"], seed=given["seed"])
        found_quality = measure_spheres(mesh, measured, options=options, progress=console)
        click.echo(found_quality.document if as_json else _table(found_quality.quality), nl=False)
        return
    for instead in ("tolerance", "levels"):
        if given[instead] is not None:
            _refuse_beside(f"--{instead}", "says how many spheres", "spheres")
    options = SphereOptions(**given | {"levels": given["levels"] or ()})
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


def _refuse_beside(option: str, why: str, *names: str) -> None:
    """Raise UsageError if an option of one of these names was given, too."""
    context = click.get_current_context()
    for name in sorted(names):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"{option} {why}, but --{name.replace('_', '-')} was given as well; omit one of them")


def _table(quality: dict[str, float]) -> str:
    """A line for each figure."""
    return "".join(f"{name:20} {value:.6g}\n" for name, value in quality.items())
