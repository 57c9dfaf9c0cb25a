"""`aoprecalc spheres`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from aoprecalc.cli.commands import MeshCommand
from aoprecalc.cli.options import FILE, Console, option, options_of, output_options, say, take
from aoprecalc.errors import UsageError, counted, listed_counts, one_or_many, option_name
from aoprecalc.options import SphereOptions

if TYPE_CHECKING:
    from aoprecalc.api.sphere_quality import SphereQuality
    from aoprecalc.types import SphereSet


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
    common=True,
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
@option(
    "--figures",
    metavar="DIR",
    group="Output",
    help="Draw the samples, the spheres of the methods lloyd, algebraic and METHOD, and their shadows, as PNG.",
    more="As in figure 1.5 of the report Précalcul, with a sheet of them all. Each method fits as many spheres. The "
    "folder is made where it is missing.",
)
@output_options
def spheres(mesh: str, **given: Any) -> None:
    """Fit spheres to MESH ({meshes}), for soft shadows or collisions.

    Writes them in the mesh's own coordinates, in the format of the output's extension.
    """
    from aoprecalc.api.figures import FigureFiles
    from aoprecalc.api.spheres import fit_spheres_file, measure_sphere_file
    from aoprecalc.io.sphere_files import quality_document

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    output, as_json, measured = given.pop("output"), given.pop("as_json"), given.pop("measure")
    if measured is not None:
        _refuse_others(set(given) - {"samples", "seed"} | {"output"})
        options = SphereOptions(1, samples=given["samples"], seed=given["seed"])
        count, quality = measure_sphere_file(mesh, measured, options, console)
        numbers = quality.to_dict()
        if as_json:
            click.echo(quality_document(count, numbers), nl=False)
            return
        say(f"{measured}  {counted(count, 'sphere')}", _summary(quality), *_table(numbers))
        return
    figures, options = given.pop("figures"), take(SphereOptions, given)
    paths, result = fit_spheres_file(mesh, output, figures=figures, options=options, progress=console)
    if as_json:
        click.echo(result.to_json(), nl=False)
        return
    fitted, quality = result.spheres, result.quality
    state = "converged" if fitted.converged else "not converged"
    effort = f"{state} after {counted(fitted.iterations, 'iteration')}"
    if fitted.radius_rule == "own":
        effort = f"after {counted(fitted.iterations, 'step')}"
    say(f"{' + '.join(map(str, paths))}  {_sizes(fitted)}, {effort}")
    say(_summary(quality))
    if figures is not None:
        sheet = FigureFiles.plan(figures, Path(mesh).stem, ()).paths[-1]
        say(f"{sheet}  figures, and the pictures of each beside it")


def _refuse_others(names: set[str]) -> None:
    """Raise UsageError if an option was given that `--measure` does not use."""
    context = click.get_current_context()
    for name in sorted(names):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"--measure fits nothing, but {option_name(name)} was given as well; omit one of them")


def _sizes(spheres: "SphereSet") -> str:
    """Return how many spheres there are, of each level."""
    counts, level = [len(spheres)], spheres.coarser
    while level is not None:
        counts, level = [len(level), *counts], level.coarser
    return f"{listed_counts(counts)} {one_or_many(counts[-1], 'sphere', 'spheres')}"


def _summary(quality: "SphereQuality") -> str:
    parts = "" if quality.leak is None else f", leak {quality.leak:.3f}, spill {quality.spill:.3f}"
    error = f"surface error {quality.surface_error_mean:.4f} of the diagonal"
    return f"silhouette IoU {quality.silhouette_iou:.3f}{parts}; {error}"


def _table(quality: dict[str, float]) -> list[str]:
    """Return a line for each measure: its name in reports, its value, what it is."""
    from aoprecalc.api.sphere_quality import MEASURES

    return [f"{name:20} {value:<11.6g}  {MEASURES[name]}" for name, value in quality.items()]
