"""`aoprecalc bake`."""

from typing import TYPE_CHECKING, Any

import click

from aoprecalc.cli.commands import MeshCommand
from aoprecalc.cli.options import FILE, Console, option, options_of, output_options, say, take
from aoprecalc.errors import AnswerError, ArgumentError, counted
from aoprecalc.options import BakeOptions, FigureOptions

if TYPE_CHECKING:
    from aoprecalc.api.reports import BakeReport


_OUTPUTS = "output", "mesh_output", "report", "verify", "figures", "bent_normals", "sh"


@click.command(
    cls=MeshCommand, many="aoprecalc batch MESH... -o build/", short_help="Bake an ambient-occlusion texture."
)
@click.argument("mesh", type=FILE)
@option(
    "-o",
    "--output",
    metavar="PATH",
    group="Output",
    common=True,
    multiple=True,
    shown="<stem>_ao.png",
    help="The texture ({images}), with the mesh beside it; a mesh ({baked meshes}), with the texture inside a .glb, "
    "else beside it; or a folder. May be repeated: a texture and a mesh.",
    more="A texture beside a mesh is <stem>_ao.png. The mesh beside a texture has the texture's stem. A stem that ends "
    "in `_ao` gets no second one. A folder exists, or its name ends in a slash; then it is made.",
)
@option(
    "--mesh-output",
    metavar="PATH",
    group="Output",
    shown="beside the texture",
    help="The mesh with the texture's UVs ({baked meshes}), or a folder.",
)
@option(
    "--verify",
    is_flag=True,
    group="Output",
    common=True,
    help="Measure the texture against ray tracing, for the report.",
)
@option(
    "--report", metavar="FILE", group="Output", common=True, help="Write what was read, chosen and measured as JSON."
)
@option(
    "--bent-normals",
    metavar="PATH",
    group="Output",
    help="Write bent normals, the mean of the visible directions, as a picture ({images}), or into a folder.",
    more="A folder gets `<stem>_bent.png`. Floats, as in EXR, hold the components n themselves, integers 0.5 n + 0.5.",
)
@option(
    "--sh",
    metavar="PATH",
    group="Output",
    help="Write visibility in spherical harmonics of degree 1, in four channels (.exr .tif .png), or into a folder.",
    more="A folder gets `<stem>_sh.exr`. The first channel is the AO, the others are the vector C, in integers "
    "0.5 C + 0.5: under the light L0 + L1.w from each direction w a point gets AO L0 + C.L1.",
)
@option(
    "--figures",
    metavar="DIR",
    group="Output",
    help="Draw the figures of the report Précalcul for MESH into a folder, as PNG.",
    more="A depth map, its direction in texture space, the texture, the mesh rendered with it, and a sheet of them "
    "all. The folder is made where it is missing.",
)
@options_of(FigureOptions)
@options_of(BakeOptions)
@output_options
def bake(mesh: str, **given: Any) -> None:
    """Bake the ambient occlusion of MESH ({meshes}) into a texture.

    Writes the texture and the mesh that it belongs to.
    """
    from aoprecalc.api.bake import bake_file
    from aoprecalc.io.outputs import json_text

    console = Console(quiet=given.pop("quiet"), verbose=given.pop("verbose"))
    outputs = {name: given.pop(name) for name in _OUTPUTS}
    as_json = given.pop("as_json")
    options, figure_options = take(BakeOptions, given), take(FigureOptions, given)
    if outputs["figures"] is None and figure_options.figure_direction is not None:
        raise ArgumentError(
            "figure_direction",
            "is for {figures}, which was not given; add it, or omit {figure_direction}",
            "figures",
            "figure_direction",
        )
    result = bake_file(
        mesh, **outputs, figure_direction=figure_options.figure_direction, options=options, progress=console
    )
    files, report = result.files, result.report
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
        _require_certified(report)
        return
    held = "inverted (1 - AO), " if report.outputs.inverted else ""
    paths = files.textures or (f"texture inside {files.mesh}",) * len(report.textures)
    for path, texture in zip(paths, report.textures, strict=True):
        size = f"{texture.texels.width} x {texture.texels.height}"
        name = f"{path} ({texture.name})" if texture.name and not files.textures else path
        say(f"{name}  {size}, {held}mean AO {texture.ao.mean:.3f}, {report.sampled}")
    if options.target_error is not None and report.estimated_error is not None:
        say(f"estimated sampling error {report.estimated_error:.4f}")
    if (certificate := report.certificate) is not None:
        say(f"as rendered, {certificate}")
    if report.verify is not None:
        error = report.verify.levels[0]
        say(f"as rendered, against ray tracing: RMS error {error.rmse:.4f}, 99% within {error.p99:.4f}")
    if report.vertex_ao is not None:
        fit = report.vertex_ao
        say(f"AO at {counted(fit.vertices, 'vertex', 'vertices')}: RMS difference from the texture {fit.rmse:.4f}")
    others = "".join(f" + {name}" for name in report.outputs.others)
    say(f"{files.mesh}{others}  {counted(report.input.triangles, 'triangle')}")
    say(_where(report))
    for name, pictures in (("bent normals", report.outputs.bent_normals), ("spherical harmonics", report.outputs.sh)):
        if pictures:
            say(f"{' + '.join(pictures)}  {name}, {options.bent_space} space")
    if report.outputs.figures:
        say(f"{report.outputs.figures[-1]}  figures, and {len(report.outputs.figures) - 1} pictures beside it")
    _require_certified(report)


def _require_certified(report: "BakeReport") -> None:
    """Raise AnswerError where the error that was asked for is not certain."""
    certificate = report.certificate
    if certificate is not None and not certificate.certified:
        raise AnswerError(f"{certificate}; {certificate.max_error:g} was wanted: see the warning, the files stay")


def _where(report: "BakeReport") -> str:
    """Return the line that says where the mesh refers to the texture, and on which UVs."""
    unwrap, slots = report.unwrap, dict[tuple[str, int | None, bool], list[str]]()
    for use in report.outputs.references:
        slots.setdefault((use.uvs, use.materials, use.packed), []).append(use.slot)
    if not slots:
        return "no material refers to the texture"
    places = []
    for (uvs, materials, packed), names in slots.items():
        count = "" if materials is None else f" of {counted(materials, 'material')}"
        inside = ", with roughness and metalness" if packed else ""
        places.append(f"{' and '.join(names)}{count}{inside}, {uvs}")
    source = "the file's own UVs" if unwrap.uv_set is not None else f"new UVs by {unwrap.method}"
    return f"{'; '.join(places)} ({source})"
