"""`aoprecalc spheres`."""

from typing import Any

import click
from click.core import ParameterSource

from aoprecalc.cli.console import Console
from aoprecalc.cli.options import FILE, MeshCommand, option, options_of, output_options, take
from aoprecalc.errors import UsageError, counted, option_name
from aoprecalc.options import SphereOptions


@click.command(
    cls=MeshCommand,
    many="aoprecalc batch MESH... --spheres '-n 100' -o build/",
    short_help="Fit spheres that stand in for a mesh.",
)
@click.argument("mesh", type=FILE)
@option(
    "-o",
    "--output",
    metavar="PATH",
    group="Output",
    multiple=True,
    shown="<stem>_spheres.json",
    help="The sphere set ({sphere sets}), or a folder. May be repeated: each file is written.",
)
@options_of(SphereOptions)
@option(
    "--measure",
    metavar="FILE",
    group="Spheres",
    help="Fit nothing: measure the spheres in FILE ({sphere sets}) against MESH.",
    more="They may come from any program. Of .obj and .glb the objects that are spheres count; of .urdf the sphere "
    "collisions, all joints at zero; of .yml (cuRobo) the spheres of its one link; of .usda the Sphere prims, where "
    "files of other programs need usd-core.",
)
@output_options
def spheres(mesh: str, **given: Any) -> None:
    """Fit spheres to MESH ({meshes}), for soft shadows or collisions.

    Writes them in the mesh's own coordinates, in the format of the output's extension.
    """
    from aoprecalc.api.spheres import fit_spheres_file, measure_sphere_file
    from aoprecalc.io.sphere_files import quality_document

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    output, as_json, measured = given.pop("output"), given.pop("as_json"), given.pop("measure")
    if measured is not None:
        _refuse_others(set(given) - {"samples", "seed"} | {"output"})
        options = SphereOptions(1, samples=given["samples"], seed=given["seed"])
        count, quality = measure_sphere_file(mesh, measured, options, console)
        figures = quality.to_dict()
        click.echo(quality_document(count, figures) if as_json else _table(figures), nl=False)
        return
    paths, result = fit_spheres_file(mesh, output, options=take(SphereOptions, given), progress=console)
    if as_json:
        click.echo(result.to_json(), nl=False)
        return
    fitted, quality = result.spheres, result.quality
    state = "converged" if fitted.converged else "not converged"
    effort = f"{state} after {counted(fitted.iterations, 'iteration')}"
    if fitted.radius_rule == "own":
        effort = f"after {counted(fitted.iterations, 'step')}"
    click.echo(f"{' + '.join(map(str, paths))}  {counted(len(fitted), 'sphere')}, {effort}")
    parts = "" if quality.leak is None else f", leak {quality.leak:.3f}, spill {quality.spill:.3f}"
    error = f"surface error {quality.surface_error_mean:.4f} of the diagonal"
    click.echo(f"silhouette IoU {quality.silhouette_iou:.3f}{parts}; {error}")


def _refuse_others(names: set[str]) -> None:
    """Raise UsageError if an option was given that `--measure` does not use."""
    context = click.get_current_context()
    for name in sorted(names):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"--measure fits nothing, but {option_name(name)} was given as well; omit one of them")


def _table(quality: dict[str, float]) -> str:
    """Return a line for each measure."""
    return "".join(f"{name:20} {value:.6g}\n" for name, value in quality.items())
