"""Bake: from a mesh file to an ambient-occlusion texture and the mesh that it belongs to."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.atlas.choose import MOST_OVERLAP, choose_atlas
from aoprecalc.atlas.gutter import first_unsafe_mip
from aoprecalc.errors import InputError, RendererError, UsageError
from aoprecalc.files import (
    Outputs,
    check_mesh_suffix,
    choose_depth,
    load_scene,
    mesh_suffix,
    source_files,
    write_baked_mesh,
    write_image,
)
from aoprecalc.files.places import claim, output_place
from aoprecalc.files.reports import write_report
from aoprecalc.gl.context import Renderer, open_renderer
from aoprecalc.model import Atlas, Baked, Scene
from aoprecalc.occlusion.axes import axes
from aoprecalc.occlusion.estimate import estimate
from aoprecalc.occlusion.shadow_size import auto_shadow_size
from aoprecalc.occlusion.visibility import visibility_sums
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.recipes.report import bake_report
from aoprecalc.recipes.stopwatch import Stopwatch
from aoprecalc.surface.normals import face_directions, shading_normals
from aoprecalc.texspace.finish import finish
from aoprecalc.texspace.layout import lay_out
from aoprecalc.texspace.raster import Raster


@dataclass(frozen=True, eq=False)
class BakeResult:
    """Where a bake's files are, what it made, and its report (see the README for the report's keys)."""

    texture_path: Path
    mesh_path: Path
    baked: Baked
    report: dict[str, Any]


def bake(
    mesh: str | PathLike[str],
    output: str | PathLike[str] | None = None,
    *,
    mesh_output: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    options: BakeOptions | None = None,
    progress: Progress | None = None,
) -> BakeResult:
    """Bake the ambient occlusion of a mesh file into a texture file.

    output        the texture, or a folder (existing, or ending in /); by default <stem>_ao.png in the current folder
    mesh_output   the mesh with the texture's UVs; by default <stem>_ao.<ext> beside the texture
    report        a JSON file for the report
    Either all files appear, or none and InputError, UsageError, RendererError or OutputError is raised.
    """
    options, progress = options or BakeOptions(), progress or Progress()
    mesh = Path(mesh)
    watch = Stopwatch(progress)
    texture_path = output_place(output, f"{mesh.stem}_ao.png")
    choose_depth(texture_path, options.bit_depth)
    with Outputs() as outputs:
        outputs.protect([mesh])
        claim(outputs, output, texture_path)
        with watch.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        suffix, reason = mesh_suffix(scene)
        mesh_path = output_place(mesh_output, texture_path.parent / f"{mesh.stem}_ao{suffix}")
        check_mesh_suffix(mesh_path)
        claim(outputs, mesh_output, mesh_path)
        report_path = None if report is None else output_place(report, f"{mesh.stem}_report.json")
        if report_path is not None:
            claim(outputs, report, report_path)
        baked = bake_scene(scene, options, progress, watch)
        with watch.stage("write"):
            write_image(outputs.path(texture_path), baked.texture.values, options.bit_depth)
            notes = write_baked_mesh(outputs, mesh_path, scene, baked.atlas, baked.normals, texture_path)
        warnings = (*scene.warnings, *baked.warnings, *notes, *((reason,) if reason and mesh_output is None else ()))
        places = {"texture": texture_path, "mesh": mesh_path}
        document = bake_report(scene, baked, options, places, outputs.files, watch.seconds(), warnings)
        if report_path is not None:
            write_report(outputs.path(report_path), document)
    for line in warnings:
        progress.warn(line)
    return BakeResult(texture_path, mesh_path, baked, document)


def bake_scene(
    scene: Scene, options: BakeOptions, progress: Progress | None = None, watch: Stopwatch | None = None
) -> Baked:
    """Bake a scene in memory; nothing is written.

    Raises InputError where the scene cannot be unwrapped as asked, UsageError where the size is beyond the renderer,
    RendererError where there is none.
    """
    progress = progress or Progress()
    watch = watch or Stopwatch(progress)
    normals = shading_normals(scene, options.normals, options.crease_angle)
    with open_renderer(options.threads) as renderer:
        _check_sizes(renderer, options)
        with watch.stage("unwrap"):
            atlas = choose_atlas(renderer.context, scene, options, progress)
        progress.note(_describe(atlas, options.padding))
        raster = Raster(renderer.context, lay_out(scene, atlas, options.width, options.height))
        texels, bands = raster.coverage()
        if not len(texels):
            size = f"{options.width} x {options.height}"
            raise InputError(f"{scene.path}: its surface covers none of {size} texels; use a larger --size")
        overlap = raster.overlap()
        directions = axes(options.directions, options.sampling, options.seed)
        shadow_size = options.shadow_size or auto_shadow_size(scene, atlas, len(texels))
        with watch.stage("visibility", 2 * len(directions), "directions"):
            sums = visibility_sums(renderer, scene, normals, raster, texels, bands, directions, shadow_size, progress)
        if renderer.context.error != "GL_NO_ERROR":
            raise RendererError(
                f"{renderer.name} reported an error while rendering; use smaller sizes or another driver"
            )
    values, measured = estimate(sums, 2 * len(directions), options.estimator)
    if not measured.any():
        raise UsageError(
            f"{len(texels)} texels are covered but face none of {2 * len(directions)} directions; use more --directions"
        )
    texture = finish(texels, values, measured, options.padding, options.fill, wraps=atlas.wraps)
    warnings = []
    if 2 * len(directions) != options.directions:
        asked = f"{options.directions} were asked for"
        warnings.append(f"{2 * len(directions)} directions were used, as they come in pairs; {asked}")
    if overlap > MOST_OVERLAP:
        warnings.append(f"{overlap:.1%} of the texels lie inside two faces of the new UVs and serve one of them")
    left_out = np.count_nonzero(face_directions(scene.corners)[1] & ~atlas.covers)
    if left_out:
        warnings.append(
            f"{atlas.method} found no place for {left_out} of {len(scene.faces)} faces; they have no texels"
        )
    if (
        atlas.gutter is not None
        and atlas.gutter < options.padding
        and first_unsafe_mip(atlas.gutter, options.padding) == 1
    ):
        warnings.append(
            f"with {atlas.charts} charts there is room for gutters of {atlas.gutter} texels only; charts may mix from "
            "mip level 1 on; a larger --size has more room"
        )
    return Baked(texture, atlas, normals, 2 * len(directions), shadow_size, renderer.name, tuple(warnings))


def _check_sizes(renderer: Renderer, options: BakeOptions) -> None:
    limit = renderer.context.info["GL_MAX_TEXTURE_SIZE"]
    for name, size in (("--size", max(options.width, options.height)), ("--shadow-size", options.shadow_size or 0)):
        if size > limit:
            raise UsageError(f"{name} {size} is beyond this renderer ({renderer.name}); expected at most {limit}")


def _describe(atlas: Atlas, padding: int) -> str:
    charts = f"{atlas.charts} chart{'s' if atlas.charts > 1 else ''}"
    if atlas.method == "keep":
        return f"unwrap: the file's own UVs, {charts}"
    right = first_unsafe_mip(atlas.gutter or 0, padding) - 1
    gutters = f"gutters of {atlas.gutter} texels: no charts mix up to mip level {right}"
    return f"unwrap: new UVs by {atlas.method}, {charts}, {gutters}"
