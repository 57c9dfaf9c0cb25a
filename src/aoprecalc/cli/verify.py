"""`aoprecalc verify`."""

from typing import TYPE_CHECKING, Any

import click

from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import FILE, Console, option, options_of, output_options, say, take
from aoprecalc.errors import AnswerError, counted
from aoprecalc.options import VerifyOptions

if TYPE_CHECKING:
    from aoprecalc.api.verify_report import VerifyReport


@click.command(cls=Command, short_help="Measure an ambient-occlusion texture against ray tracing.")
@click.argument("mesh", type=FILE)
@option(
    "--texture",
    metavar="PATH",
    group="Texture",
    common=True,
    shown="the one that MESH refers to, else <stem>.png beside it",
    help="The texture.",
)
@option(
    "--heat-map",
    metavar="FILE",
    group="Output",
    common=True,
    help="Draw the errors in texture space: blue is too dark, red too bright.",
    more="White is right, full colour an error of 0.1, grey no surface; one cell a point. A folder gets "
    "`<stem>_heat_map.png` (`.png .tif .jpg .tga .bmp`).",
)
@option("--report", metavar="FILE", group="Output", common=True, help="Write what was measured as JSON.")
@options_of(VerifyOptions)
@output_options
def verify(mesh: str, texture: str | None, **given: Any) -> None:
    """Measure the ambient-occlusion texture of MESH, baked by this or another program, against ray tracing.

    The texture is sampled as a renderer does, at full resolution and in its mip levels. It is held to the options of
    its bake, which this program keeps in the texture (not in .tga and .bmp) and in glTF;
    options given here win.
    """
    from aoprecalc.api.verify import verify
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    outputs = {name: given.pop(name) for name in ("heat_map", "report")}
    as_json = given.pop("as_json")
    options = take(VerifyOptions, given)
    report = verify(mesh, texture, options, **outputs, progress=console)
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
    else:
        say(*_table(report))
    if not report.passed:
        if report.certificate is not None and not report.certificate.certified:
            raise AnswerError(
                f"{report.texture.path}: its certificate, an RMS error of at most {report.certificate.max_error:g}, is "
                f"not confirmed: {report.certificate}; the mesh or the picture has changed, bake it again"
            )
        known = report.options_from is not None
        others = "" if known else ", or verify it with the --normals, --estimator, --two-sided and --ground of its bake"
        raise AnswerError(
            f"{report.texture.path}: its RMS error is {report.error:.5f}, at most {options.tolerance:g} was "
            f"allowed; bake it with a larger --size or more --directions{others}"
        )


def _table(report: "VerifyReport") -> list[str]:
    """Lay out what was measured: a line for each mip level, and one for each of the worst points."""
    from aoprecalc.api.documents import position_texts

    names = ("rmse", "bias", "p50", "p95", "p99", "max")
    texture, mesh = report.texture.path, report.input.path
    image = texture.removesuffix(f" of {mesh}")
    measured = f"{texture} on {mesh}" if image == texture else f"{mesh}, its own texture ({image})"
    lines = [
        f"{measured}: texture minus reference at {counted(report.points, 'point')} of {report.rays} rays",
        f"level{''.join(f'{name:>9}' for name in names)}",
    ]
    for level in report.levels:
        numbers = "".join(f"{getattr(level, name):{'+' if name == 'bias' else ''}9.4f}" for name in names)
        lines.append(f"{level.level:5}{numbers}")
    positions = position_texts(report.worst)
    width = max((len(text) for position in positions for text in position), default=0) + 1
    if positions:
        lines.append("worst at  " + f"{'position':<{3 * width}}{'UV':<18}{'texture':>8}{'reference':>11}")
    for point, position in zip(report.worst, positions, strict=True):
        place, (u, v) = "".join(text.rjust(width) for text in position), point.uv
        lines.append(f"{'':10}{place}  {u:7.4f} {v:7.4f}{point.value:8.3f}{point.reference:11.3f}")
    if report.certificate is not None and report.certificate.certified:
        lines.append(f"certificate confirmed at other points: {report.certificate}")
    return lines
