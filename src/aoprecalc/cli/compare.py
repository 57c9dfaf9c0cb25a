"""`aoprecalc compare`."""

from typing import TYPE_CHECKING, Any

import click

from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import FILE, Console, option, options_of, output_options, say, take
from aoprecalc.errors import AnswerError, counted
from aoprecalc.options import CompareOptions

if TYPE_CHECKING:
    from aoprecalc.api.compare import CompareReport

_MEANINGS = {
    "texture": "root mean square of B - A",
    "mesh": "the greatest of position, UV, normal and texture",
    "spheres": "the farthest pair of spheres, over the diagonal",
    "report": "largest relative difference",
}


@click.command(cls=Command, short_help="Compare two textures, meshes, sphere sets or reports.")
@click.argument("a", type=FILE)
@click.argument("b", type=FILE)
@option(
    "--mesh",
    metavar="PATH",
    group="Measurement",
    shown="the mesh of the texture's stem beside each",
    help="The mesh of both textures, whose surface decides which texels count.",
    more="Without any mesh the whole picture counts, padding and fill included.",
)
@option(
    "--picture",
    metavar="FILE",
    group="Output",
    help="Draw A, B, B - A and the visible difference (FLIP) side by side.",
    more="For textures, and meshes that have them (`.png .tif .jpg .tga .bmp`). In B - A blue is darker, red brighter, "
    "full colour 0.1; FLIP goes from black to red, yellow and white. A folder gets `<stem of A>_compare.png`.",
)
@option("--report", metavar="FILE", group="Output", help="Write the result as JSON.")
@options_of(CompareOptions)
@output_options
def compare(a: str, b: str, **given: Any) -> None:
    """Compare a new result B with a reference A: equal, near (within the tolerance), or different.

    Both are textures, meshes with their textures, sphere sets (such as .json .urdf), or reports (.json). For
    textures, only texels covered by the surface of A or B count; the figures of the whole picture are printed too.
    """
    from aoprecalc.api.compare import compare
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    outputs = {name: given.pop(name) for name in ("mesh", "picture", "report")}
    as_json = given.pop("as_json")
    report = compare(a, b, take(CompareOptions, given), **outputs, progress=console)
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
    else:
        say(*_table(report))
    if not report.passed:
        raise AnswerError(f"{b}: differs from {a}; if the change is meant, replace {a} by {b}")


def _table(report: "CompareReport") -> list[str]:
    """Lay out the answer, the difference, and what else was measured, in a few lines."""
    details = report.details
    lines = [f"{report.answer}: {report.a} and {report.b}"]
    if report.difference is None:
        lines.append(report.reason)
    else:
        known = report.kind == "texture" and details["surface"]
        meaning = _MEANINGS[report.kind] + (" over the surface" if known else "")
        lines.append(f"difference {report.difference:.6f} ({meaning}), at most {report.tolerance:g} is allowed")
    if "triangles" in details:
        parts = [(name, details[name]) for name in ("position", "uv", "normal")]
        distances = ", ".join(f"{name} {value:.6f}" for name, value in parts if value is not None)
        lines.append(f"{counted(details['triangles'], 'triangle')}: {distances}")
    pixels = details if report.kind == "texture" else details.get("texture")
    if pixels:
        if surface := pixels["surface"]:
            lines.append(_statistics(f"surface, {counted(surface['texels'], 'texel')}", surface))
        lines.append(_statistics(f"whole picture, {pixels['width']} x {pixels['height']}", pixels["picture"]))
    if "center" in details:
        *coarser, finest = details["spheres"]
        count = ", ".join([*map(str, coarser), counted(finest, "sphere")])
        lines.append(f"{count}: centre {details['center']:.6f}, radius {details['radius']:.6f}")
    if "places" in details:
        lines.append(f"{counted(details['numbers'], 'number')}, {counted(details['differing'], 'difference')}")
        lines += [f"  {entry['at']}: {entry['a']!r} became {entry['b']!r}" for entry in details["places"]]
    return lines


def _statistics(where: str, found: dict[str, float]) -> str:
    """Return a line about the differences of two textures over some of their texels."""
    return (
        f"{where}: root mean square {found['rms']:.6f}, mean {found['bias']:+.6f}, greatest {found['max']:.4f}, "
        f"{found['share']:.2%} beyond 2/255, FLIP {found['flip']:.4f}"
    )
