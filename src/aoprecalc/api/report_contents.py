"""What the report page holds of one asset: read its files, draw its pictures, say what is known of it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.api.report_assets import EXPECTED, AssetFiles
from aoprecalc.api.report_facts import (
    bake_choices,
    bake_commands,
    bake_figures,
    bake_tables,
    count_figure,
    error_tables,
    sphere_table,
    verified_levels,
)
from aoprecalc.api.sphere_quality import SphereQuality, quality_in
from aoprecalc.api.textured_surface import MeshToDraw, mesh_to_draw
from aoprecalc.errors import AoprecalcError, InputError, RendererError, counted, option_name
from aoprecalc.io.baked_options import occlusion_values
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import read_pixels
from aoprecalc.io.occlusion import baked_copy
from aoprecalc.io.sphere_files import read_spheres
from aoprecalc.options import PreviewOptions, Shading
from aoprecalc.progress import Progress, notes_of, warnings_of
from aoprecalc.render.comparison import (
    ao_histogram,
    chart_layout,
    grey_picture,
    heat_map_picture,
)
from aoprecalc.render.preview import preview_pictures
from aoprecalc.render.report_page import (
    HISTOGRAM_BINS,
    AssetPage,
    Budget,
    Figure,
    Histogram,
    Still,
    Table,
    web_picture,
)
from aoprecalc.render.simplification import NotSimplifiedError
from aoprecalc.render.view_geometry import view_geometry
from aoprecalc.types import Float32Array, Float64Array, Picture, TexturedMesh

_NO_VIEWER = (
    "Still pictures: this installation was built without three.js, which the 3D view needs. In a checkout, "
    "scripts/setup-viewer adds it (with node and npm); released wheels have it."
)


@dataclass(frozen=True, eq=False)
class ReadAsset:
    """An asset with the contents of its files.

    ao       (h, w) float32 in [0, 1], row 0 at v = 1; None without a texture
    spheres  centers (n, 3) and radii (n,)
    quality  of the spheres, where their file tells it
    heat_map  (h, w, channels) float32 in [0, 1], as its file has it
    error    why a file could not be read
    """

    files: AssetFiles
    mesh: MeshToDraw | None = None
    ao: Float32Array | None = None
    spheres: tuple[Float64Array, Float64Array] | None = None
    quality: SphereQuality | None = None
    heat_map: Float32Array | None = None
    error: str = ""


def read_asset(asset: AssetFiles) -> ReadAsset | None:
    """Read the files of an asset; None for a mesh without ambient occlusion that nobody has named."""
    if asset.failed:
        return ReadAsset(asset)
    try:
        mesh = None if asset.mesh is None else mesh_to_draw(asset.mesh, colors=True)
        ao = None if mesh is None else mesh.mesh.ao
        if ao is None and asset.texture is not None:
            if asset.mesh is not None:
                mesh = mesh_to_draw(asset.mesh, asset.texture, colors=True)
                ao = mesh.mesh.ao
            else:
                ao = occlusion_values(ImageSource.of(asset.texture))
        spheres = None if asset.spheres is None else read_spheres(asset.spheres)
        quality = None if asset.spheres is None else quality_in(asset.spheres)
        heat_map = None if asset.heat_map is None else read_pixels(asset.heat_map)
    except AoprecalcError as error:
        if asset.given:
            raise
        return ReadAsset(asset, error=error.worded(option_name)) if asset.certain else None
    if ao is None and spheres is None and asset.batched is None and asset.bake is None and not asset.damage:
        if asset.given and asset.verify is None:
            advice = (asset.mesh and baked_copy(asset.mesh)) or EXPECTED
            raise InputError(f"{asset.mesh}: has no ambient occlusion; {advice}")
        return None
    return ReadAsset(asset, mesh, ao, spheres, quality, heat_map, error=asset.damage)


def asset_page(read: ReadAsset, budget: Budget, *, interactive: bool = False) -> AssetPage:
    """Return what the page tells of an asset; `interactive`: with a 3D view."""
    asset, bake, verify = read.files, read.files.bake, read.files.verify
    pictures = _pictures(read, budget)
    view, view_note = _view(read, budget) if interactive else (None, _NO_VIEWER)
    batched = asset.batched
    warnings = [*(bake.warnings if bake else ()), *(verify.warnings if verify else ())]
    warnings += batched.summary.warnings if batched is not None and batched.summary is not None else ()
    notes = [*(bake.notes if bake else ()), *(verify.notes if verify else ())]
    if bake is None and read.mesh is not None:
        warnings += warnings_of(read.mesh.messages)
        notes += notes_of(read.mesh.messages)
    error = read.error
    if batched is not None and batched.error is not None:
        error = batched.error.message
    commands = batched.commands if batched is not None else () if bake is None else bake_commands(bake)
    source = batched.path if batched is not None else bake.input.path if bake is not None else str(asset.mesh or "")
    return AssetPage(
        name=_printable(asset.name),
        status="unreadable" if read.error else batched.status if batched is not None else "read",
        path=_printable(source),
        error=_printable(error),
        figures=tuple(_figures(read, pictures.get("histogram"))),
        warnings=tuple(dict.fromkeys(map(_printable, warnings))),
        notes=tuple(dict.fromkeys(map(_printable, notes))),
        missing=tuple(map(_printable, _missing(read))),
        stages=_stages(read),
        choices=() if bake is None else tuple(bake_choices(bake)),
        tables=tuple(_tables(read)),
        commands=tuple(map(_printable, commands)),
        files=tuple((kind, _printable(str(path))) for kind, path in _files(asset)),
        view=view,
        view_note=view_note,
        **pictures,
    )


def _pictures(read: ReadAsset, budget: Budget) -> dict[str, Any]:
    """Return the pictures of an asset, by the argument of AssetPage."""
    found: dict[str, Any] = {}
    name, mesh, ao = _printable(read.files.name), read.mesh, read.ao
    if ao is not None:
        height, width = ao.shape
        share = budget.texture / max(width, height)
        size = (max(1, round(width * share)), max(1, round(height * share)))
        charts = None if mesh is None else chart_layout(mesh.mesh, size)
        counts, values = ao_histogram(ao, None if charts is None else charts.covered, HISTOGRAM_BINS)
        found["histogram"] = Histogram(tuple(counts.tolist()), float(values.mean()), float(np.median(values)))
        grey = grey_picture(ao)
        alt = f"Ambient-occlusion texture of {name}, {width} x {height} texels"
        found["texture"] = web_picture(grey, alt, budget.texture)
        found["thumbnail"] = web_picture(grey, "", budget.thumbnail)
        if charts is not None:
            alt = f"UV layout of {name}: {counted(charts.charts, 'chart')}, each in a colour of its own"
            found["layout"] = web_picture(charts.picture, alt, budget.texture, lossless=True)
    if read.heat_map is not None:
        colors = heat_map_picture(read.heat_map)
        alt = f"Error of the texture of {name} against ray tracing, in texture space"
        found["heat_map"] = web_picture(colors, alt, budget.texture)
    try:
        drawn = _stills(read, budget)
    except RendererError:  # the rest of the page needs none
        drawn = []
    if drawn:
        found["stills"] = tuple(Still(mode, web_picture(picture, alt, budget.preview)) for mode, picture, alt in drawn)
        found["thumbnail"] = web_picture(drawn[0][1], "", budget.thumbnail)
    return found


def _stills(read: ReadAsset, budget: Budget) -> list[tuple[str, Picture, str]]:
    """Draw the mesh with its ambient occlusion, its material, its spheres: mode, picture, what it shows."""
    if read.mesh is None:
        return []
    name, mesh = _printable(read.files.name), read.mesh.mesh
    size = budget.preview, budget.preview * 3 // 4
    modes: list[tuple[str, Shading, bool, str]] = []
    if read.ao is not None:
        modes.append(("ao", "ao", False, f"{name} with its ambient occlusion"))
    if _has_materials(mesh):
        modes.append(("material", "material", False, f"{name} with its materials and ambient occlusion"))
    if read.spheres is not None:
        modes.append(("spheres", "ao" if read.ao is not None else "clay", True, f"{name} and its spheres"))
    found = []
    for mode, shading, with_spheres, alt in modes:
        options = PreviewOptions(size=size, shading=shading, spheres_view="over", up=read.mesh.up)
        spheres = read.spheres if with_spheres else None
        found.append((mode, preview_pictures(mesh, spheres, options, Progress())[0], alt))
    return found


def _has_materials(mesh: TexturedMesh) -> bool:
    """Tell whether there is more to see of the materials than one plain colour."""
    colors = mesh.base_colors
    return any(color.texture is not None for color in colors) or len({color.factor for color in colors}) > 1


def _view(read: ReadAsset, budget: Budget) -> tuple[dict[str, Any] | None, str]:
    """Return what the 3D view takes, but for the pictures that the page shows anyway; or None, and why."""
    if read.mesh is None:
        return None, ""
    if not budget.triangles:
        return None, "Still pictures: a page of so many assets has no 3D views."
    mesh = read.mesh.mesh
    mesh = mesh if _has_materials(mesh) else replace(mesh, base_colors=())
    try:
        geometry = view_geometry(mesh, budget.triangles, budget.texture // 2)
    except NotSimplifiedError as error:
        return None, f"Still pictures: {error}."
    note = "Drag to turn, or use the arrow keys; + and - zoom, 0 resets."
    if len(geometry.triangles) < geometry.total_triangles:
        note += f" Simplified: {len(geometry.triangles):,} of {geometry.total_triangles:,} triangles."
    textures = [web_picture(texture, "", max(texture.shape)).source for texture in geometry.base_textures]
    view = {
        "geometry": geometry.as_json(),
        "textures": {"base": textures},
        "spheres": None if read.spheres is None else geometry.pack_spheres(*read.spheres),
        "up": read.mesh.up,
        "label": f"{_printable(read.files.name)}, 3D view",
        "note": note,
    }
    return view, ""


def _figures(read: ReadAsset, histogram: Histogram | None) -> list[Figure]:
    asset, bake = read.files, read.files.bake
    found = []
    if read.mesh is not None:
        found.append(count_figure("triangles", "Triangles", len(read.mesh.mesh.scene.faces)))
    elif bake is not None:
        found.append(count_figure("triangles", "Triangles", bake.input.triangles))
    if read.ao is not None:
        height, width = read.ao.shape
        found.append(Figure("texels", "Texture", f"{width} x {height}", width * height))
    mean = bake.ao.mean if bake is not None else histogram.mean if histogram is not None else None
    if mean is not None:
        found.append(Figure("mean", "Mean AO", f"{mean:.3f}", mean))
    found += bake_figures(bake) if bake is not None else []
    if levels := verified_levels(bake, asset.verify):
        found.append(Figure("error", "RMS error", f"{levels[0].rmse:.4f}", levels[0].rmse))
    if read.spheres is not None:
        found.append(count_figure("spheres", "Spheres", len(read.spheres[1])))
    if read.quality is not None:
        iou = read.quality.silhouette_iou
        found.append(Figure("iou", "Silhouette IoU", f"{iou:.3f}", iou))
    seconds = asset.batched.seconds if asset.batched is not None else bake.seconds.get("total") if bake else None
    if seconds is not None:
        found.append(Figure("seconds", "Seconds", f"{seconds:.1f}", seconds))
    return found


def _tables(read: ReadAsset) -> list[Table]:
    bake = read.files.bake
    tables = [] if bake is None else bake_tables(bake)
    tables += error_tables(bake, read.files.verify)
    return tables + ([] if read.quality is None else [sphere_table(read.quality)])


def _stages(read: ReadAsset) -> tuple[tuple[str, float], ...]:
    """Return the seconds of each stage of the bake, without their sum."""
    bake = read.files.bake
    return () if bake is None else tuple((name, value) for name, value in bake.seconds.items() if name != "total")


def _missing(read: ReadAsset) -> list[str]:
    """Say what is not there, and how to get it."""
    asset, lines = read.files, list[str]()
    if asset.failed or read.error:
        return lines
    if read.ao is None:
        lines.append("There is no texture: the mesh has no ambient occlusion, or its file is not among the results.")
    elif read.mesh is None:
        lines.append("There is no mesh beside the texture: its charts are not known, and padding and fill count too.")
    if read.ao is not None and asset.bake is None:
        lines.append(
            "There is no report of the bake, so neither what was chosen nor its warnings are known: bake with --report."
        )
    if read.ao is not None and read.mesh is not None and not verified_levels(asset.bake, asset.verify):
        lines.append("Nobody has measured the texture: aoprecalc verify MESH --report FILE --heat-map FILE.")
    if asset.others:
        names = ", ".join(path.name for path in asset.others)
        lines.append(f"Not shown, as other files of the same stem are: {names}.")
    return lines


def _files(asset: AssetFiles) -> list[tuple[str, Path]]:
    roles = (("Mesh", asset.mesh), ("Texture", asset.texture), ("Spheres", asset.spheres), ("Heat map", asset.heat_map))
    return [(kind, path) for kind, path in roles if path is not None]


def _printable(text: str) -> str:
    """Return a text with ? for what no text file can hold and for control characters: names of files may have both."""
    encoded = text.encode(errors="replace").decode()
    return "".join(character if character >= " " or character in "\n\t" else "?" for character in encoded)
