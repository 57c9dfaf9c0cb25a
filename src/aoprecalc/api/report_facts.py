"""What a report page says in words and figures: of a bake, its errors, and how it differs from another run."""

import shlex
from dataclasses import asdict, fields
from typing import Any, cast

from aoprecalc.api.compare import CompareReport, compare
from aoprecalc.api.documents import LevelErrors, PointError, position_texts
from aoprecalc.api.report_assets import AssetFiles
from aoprecalc.api.reports import BakeReport
from aoprecalc.api.sphere_quality import MEASURES, SphereQuality
from aoprecalc.api.verify_report import VerifyReport
from aoprecalc.errors import AoprecalcError, ArgumentError, counted, option_name
from aoprecalc.options import BakeOptions, Sampling, ValueOptions
from aoprecalc.options.fields import as_words, option_fields
from aoprecalc.render.report_page import FAILED, AssetPage, Change, Choice, Comparison, Figure, Slider, Table

_PIXELS = (
    ("rms", "Root mean square of after - before"),
    ("bias", "Mean of after - before"),
    ("max", "Greatest difference"),
    ("share", "Share of texels that differ by more than 2/255"),
    ("flip", "Visible difference (FLIP), 0 to 1"),
)
_MESH = (
    ("position", "Greatest move of a corner, over the diagonal"),
    ("uv", "Greatest move of a UV"),
    ("normal", "Greatest difference of normals"),
)
_SPHERES = (("center", "Greatest move of a sphere, over the diagonal"), ("radius", "Greatest difference of radii"))
_TIMES = ("seconds",)  # figures that differ from run to run

_CAUSES = {
    "inside": "enclosed",
    "inwards": "facing inwards",
    "below_ground": "below the ground",
    "on_ground": "resting on the ground",
    "above_ground": "facing the ground",
    "narrow": "in narrow gaps",
}


def count_figure(key: str, label: str, count: int) -> Figure:
    """Return a figure that counts something."""
    return Figure(key, label, f"{count:,}", count)


def bake_figures(bake: BakeReport) -> list[Figure]:
    """Return the figures of a bake; its mean AO, triangles and texels are those of the files."""
    found = [count_figure("directions", "Directions", bake.directions)]
    if bake.estimated_error is not None:
        text = f"{bake.estimated_error:.4f}"
        found.append(Figure("estimate", "Estimated error", text, bake.estimated_error))
    return found


def verified_levels(bake: BakeReport | None, verify: VerifyReport | None) -> tuple[LevelErrors, ...]:
    """Return the errors against ray tracing for each mip level; none if nobody has measured them."""
    if verify is not None:
        return verify.levels
    return bake.verify.levels if bake is not None and bake.verify is not None else ()


def error_tables(bake: BakeReport | None, verify: VerifyReport | None) -> list[Table]:
    """Return the errors against ray tracing by mip level, and the worst points."""
    levels = verified_levels(bake, verify)
    worst: tuple[PointError, ...] = ()
    if verify is not None:
        worst = verify.worst
    elif bake is not None and bake.verify is not None:
        worst = bake.verify.worst
    if not levels:
        return []
    levels_head = ("Mip level", "RMS", "Bias", "Median", "95%", "99%", "Greatest")
    rows = tuple(
        (str(level.level), *(f"{getattr(level, name):.4f}" for name in ("rmse", "bias", "p50", "p95", "p99", "max")))
        for level in levels
    )
    tables = [Table("errors", "Errors against ray tracing, by mip level", levels_head, rows, numbers=True)]
    if worst:
        points = tuple(
            (", ".join(position), ", ".join(f"{x:.4f}" for x in point.uv))
            + tuple(f"{value:.4f}" for value in (point.value, point.reference, point.error))
            for point, position in zip(worst, position_texts(worst), strict=True)
        )
        head = ("Position", "UV", "Texture", "Reference", "Error")
        tables.append(Table("worst", "Points of greatest error", head, points, numbers=True))
    return tables


def bake_choices(bake: BakeReport) -> list[Choice]:
    """Return what a bake chose, and why as far as its report says."""
    unwrap = bake.unwrap
    faults = [f"set {check.uv_set}: {check.fault}" for check in unwrap.checks if check.fault]
    if unwrap.uv_set is not None:
        uvs = Choice(
            "UVs", f"The file's own, set {unwrap.uv_set}, {counted(unwrap.charts, 'chart')}.", "They can hold a bake."
        )
    else:
        why = f"The file's own cannot hold a bake: {'; '.join(faults)}." if faults else ""
        uvs = Choice("UVs", f"New ones by {unwrap.method}, {counted(unwrap.charts, 'chart')}.", why)
    found = [uvs]
    checked = [
        f"set {check.uv_set}: "
        + (
            check.fault
            or f"usable ({'overlap not measured' if check.overlap is None else f'overlap {check.overlap:.2%}'})"
        )
        for check in unwrap.checks
    ]
    if checked:
        found.append(Choice("Checks of UVs", "; ".join(checked) + "."))
    if unwrap.gutter is not None:
        last = (unwrap.first_unsafe_mip or 1) - 1
        why = f"No charts mix up to mip level {last}." if unwrap.first_unsafe_mip is not None else ""
        found.append(Choice("Gutters", f"{counted(unwrap.gutter, 'texel')} between charts.", why))
    found.append(
        Choice(
            "Texture",
            f"{bake.texels.width} x {bake.texels.height} texels, {bake.texels.valid:,} with a value.",
            f"{unwrap.used_share:.0%} of the picture is used.",
        )
    )
    maps = "" if bake.shadow_size is None else f" Depth maps of {bake.shadow_size} x {bake.shadow_size} texels."
    ways = {"gl": "Depth maps in OpenGL.", "ray": "Rays, without OpenGL."}
    found.append(Choice("Backend", f"{bake.backend}: {bake.renderer}.", ways.get(bake.backend, "") + maps))
    error = "" if bake.estimated_error is None else f"Estimated sampling error {bake.estimated_error:.4f}, RMS."
    found.append(Choice("Directions", f"{bake.sampled}, {bake.sampling}.", error))
    if bake.floor is not None:
        way = ", ".join(f"{x:g}" for x in bake.floor)
        found.append(Choice("Ground", f"A plane below the mesh; ({way}) points away from it."))
    if bake.ao.ground_alone is not None:
        found.append(
            Choice("Without the mesh", f"The ground alone would leave a mean AO of {bake.ao.ground_alone:.3f}.")
        )
    if bake.dark is not None:
        shares = [
            f"{getattr(bake.dark, key):.1%} {words}" for key, words in _CAUSES.items() if getattr(bake.dark, key) > 0
        ]
        found.append(Choice("Dark texels", f"{bake.ao.unseen_share:.1%}: {', '.join(shares)}."))
    for use in bake.outputs.references:
        materials = "" if use.materials is None else f" of {counted(use.materials, 'material')}"
        packed = ", with roughness and metalness" if use.packed else ""
        found.append(Choice("Used by", f"{use.slot}{materials}, {use.uvs}{packed}."))
    return found


def option_rows(options: ValueOptions) -> dict[str, str]:
    """Return the options that define the value, as the command line writes them: name and value."""
    found = {}
    for field in option_fields(ValueOptions):
        value = getattr(options, field.name)
        if isinstance(value, bool):
            text = "yes" if value else "no"
        elif isinstance(value, tuple):
            text = ", ".join(map(str, value)) or "none"
        else:
            text = field.option.default_text or "none" if value is None else str(value)
        found[option_name(field.name)] = text
    return found


def bake_tables(bake: BakeReport) -> list[Table]:
    """Return the roles of the parts, and the options."""
    rows = []
    for part in bake.parts:
        kinds = (("glass", "glass"), ("unlit", "unlit"), ("cut_out", "cut-outs"))
        special = [words for key, words in kinds if getattr(part, key)]
        if part.shares is not None:
            special.append(
                f"shares the UVs of {bake.parts[part.shares].name}" if 0 <= part.shares < len(bake.parts) else ""
            )
        yes = ["yes" if value else "no" for value in (part.receives, part.occludes)]
        rows.append((part.name, f"{part.triangles:,}", *yes, ", ".join(special) or "plain"))
    head = ("Part", "Triangles", "Baked", "Occludes", "Material")
    options = tuple(option_rows(bake.options).items())
    return [
        Table("parts", f"Parts ({len(rows)})", head, tuple(rows)),
        Table("options", "Options that define the value", ("Option", "Value"), options),
    ]


def sphere_table(quality: SphereQuality) -> Table:
    """Return the quality of a sphere set."""
    rows = tuple(
        (entry.name, f"{value:.6g}", MEASURES[entry.name])
        for entry in fields(quality)
        if (value := getattr(quality, entry.name)) is not None
    )
    return Table("spheres", "Quality of the spheres", ("Measure", "Value", "What it is"), rows)


def bake_commands(bake: BakeReport) -> tuple[str, ...]:
    """Return the command line that makes a bake again, as far as its report says; none where it has no such form."""
    try:
        options = BakeOptions(
            width=bake.texels.width,
            height=bake.texels.height,
            directions=bake.directions,
            sampling=cast(Sampling, bake.sampling),
            strength=next((use.strength for use in bake.outputs.references if use.strength is not None), 1),
            invert=bake.outputs.inverted,
            **asdict(bake.options),
        )
    except ArgumentError:
        return ()
    mesh = ["--", bake.input.path] if bake.input.path.startswith("-") else [bake.input.path]
    return (shlex.join(["aoprecalc", "bake", *as_words(options), *mesh]),)


# What has changed between two runs of an asset, measured as `compare` does.


def changes(
    before: AssetFiles, before_page: AssetPage, after: AssetFiles, after_page: AssetPage
) -> tuple[Change, Comparison]:
    """Return whether an asset has changed, and how.

    before_page, after_page   what the page tells of either run
    """
    measured, lines = [], list[str]()
    for kind, a, b in _pairs(before, before_page, after, after_page):
        try:
            measured.append((kind, compare(a, b)))
        except AoprecalcError as error:
            lines.append(f"{kind}: cannot be compared ({error.worded(option_name)}).")
    figures = _figures(before_page, after_page)
    options = _options(before, after)
    lines += [f"{kind}: {_answer(report)}" for kind, report in measured]
    faults = [page.status if page.status in (*FAILED, "stopped") else "" for page in (before_page, after_page)]
    if faults[0] != faults[1]:
        lines.insert(0, f"It was {before_page.status} before, and is {after_page.status} now.")
    same = not options and all(report.answer == "equal" for _, report in measured)
    same = same and faults[0] == faults[1]
    same = same and all(row[1] == row[2] for key, row in figures.items() if key not in _TIMES)
    tables = []
    if rows := _differences([report for _, report in measured]):
        tables.append(Table("differences", "Differences", ("Measure", "Value"), tuple(rows), numbers=True))
    if figures:
        head = ("Figure", "Before", "After", "Change")
        tables.append(Table("before", "Figures", head, tuple(figures.values()), numbers=True))
    if options:
        tables.append(Table("changed-options", "Options that differ", ("Option", "Before", "After"), tuple(options)))
    answer = " ".join(lines) or "Nothing of it can be compared."
    return "same" if same else "changed", Comparison(answer, tuple(_sliders(before_page, after_page)), tuple(tables))


def _pairs(
    before: AssetFiles, before_page: AssetPage, after: AssetFiles, after_page: AssetPage
) -> list[tuple[str, Any, Any]]:
    """Return the files to compare: what they are, of the run before, of this one."""
    pairs = []
    if before_page.texture is not None and after_page.texture is not None:
        if before.mesh is not None and after.mesh is not None:
            pairs.append(("Mesh and texture", before.mesh, after.mesh))
        elif before.texture is not None and after.texture is not None:
            pairs.append(("Texture", before.texture, after.texture))
    if before.spheres is not None and after.spheres is not None:
        pairs.append(("Spheres", before.spheres, after.spheres))
    return pairs


def _answer(report: CompareReport) -> str:
    if report.reason:
        return f"different, {report.reason}."
    if report.difference is None or report.answer == "equal":
        return f"{report.answer}."
    return f"{report.answer}, difference {report.difference:.6f}."


def _differences(reports: list[CompareReport]) -> list[tuple[str, str]]:
    """Return the measured differences, in words and figures."""
    rows = []
    for report in reports:
        details = report.details
        pixels = details if report.kind == "texture" else details.get("texture")
        if pixels:
            found = pixels.get("surface") or pixels.get("picture") or {}
            rows += [(words, f"{found[key]:.6g}") for key, words in _PIXELS if key in found]
        others = _MESH if report.kind == "mesh" else _SPHERES if report.kind == "spheres" else ()
        rows += [(words, f"{details[key]:.6g}") for key, words in others if details.get(key) is not None]
    return rows


def _figures(before: AssetPage, after: AssetPage) -> dict[str, tuple[str, str, str, str]]:
    """Return each figure that both have, by its key: label, before, after, change."""
    rows = {}
    for figure in after.figures:
        old = before.figure(figure.key)
        if old is not None:
            change = figure.value - old.value
            text = f"{change:+.4g}" if change else "none"
            rows[figure.key] = (figure.label, old.text, figure.text, text)
    return rows


def _options(before: AssetFiles, after: AssetFiles) -> list[tuple[str, str, str]]:
    """Return what was chosen differently: name, before, after."""
    if before.bake is None or after.bake is None:
        return []
    one, other = option_rows(before.bake.options), option_rows(after.bake.options)
    rows = [(name, one.get(name, "none"), value) for name, value in other.items() if one.get(name) != value]
    for words, name in (("Backend", "backend"), ("Renderer", "renderer"), ("Sampling", "sampling")):
        a, b = getattr(before.bake, name), getattr(after.bake, name)
        rows += [(words, a, b)] if a != b else []
    a, b = before.bake.unwrap.method, after.bake.unwrap.method
    return rows + ([("UVs", a, b)] if a != b else [])


def _sliders(before: AssetPage, after: AssetPage) -> list[Slider]:
    """Return the pictures that both runs have."""
    found = []
    old, new = ({still.mode: still.picture for still in page.stills} for page in (before, after))
    if "ao" in old and "ao" in new:
        found.append(Slider("Mesh", old["ao"], new["ao"]))
    if before.texture is not None and after.texture is not None:
        found.append(Slider("Texture", before.texture, after.texture))
    if "spheres" in old and "spheres" in new:
        found.append(Slider("Spheres", old["spheres"], new["spheres"]))
    return found
