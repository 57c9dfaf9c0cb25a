"""Bake: from a mesh file to an ambient-occlusion texture and the mesh that it belongs to."""

from contextlib import nullcontext
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.api.reports import bake_report
from aoprecalc.api.verify import about_sharing, verify_scene
from aoprecalc.api.warnings import bake_warnings
from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import (
    Outputs,
    check_mesh_extension,
    choose_bit_depth,
    load_scene,
    output_mesh_extension,
    read_image,
    source_files,
    write_baked_mesh,
    write_image,
)
from aoprecalc.io.outputs import claim_output, output_path, write_json
from aoprecalc.mesh.normals import shading_normals
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress, Stopwatch
from aoprecalc.raster.padding import lighter_of_sides, pad_and_fill, resolve_texels
from aoprecalc.types import Atlas, Baked, Float32Array, Scene
from aoprecalc.uv.gutter import first_unsafe_mip
from aoprecalc.uv.select import choose_atlas
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.gather import LocalVisibility, TexelOcclusion, VisibilityFactory, gather
from aoprecalc.visibility.projection import auto_shadow_size
from aoprecalc.visibility.rays import require_embreex
from aoprecalc.visibility.setup import BakeInputs, BakeSetup, SurfaceSide, chunks, texels_per_chunk

_DARK = 0.01  # a value below which a texel counts as seeing no direction: maps let through a little at silhouettes


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
    stem: str | None = None,
    verify: bool = False,
    outputs: Outputs | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
    options: BakeOptions | None = None,
    progress: Progress | None = None,
) -> BakeResult:
    """Bake the ambient occlusion of a mesh file into a texture file.

    output        the texture, or a folder (existing, or ending in /); by default <stem>_ao.png in the current folder
    mesh_output   the mesh with the texture's UVs; by default <stem>_ao.<ext> beside the texture
    report        a JSON file for the report
    stem          what default names begin with; None: the mesh's
    verify        measure the texture that was written against ray tracing, for the report
    outputs       receives the files, which the caller then moves to their places; None: they appear at the end
    open_sight    what makes that which sees; by default it looks by itself
    Either all files appear, or none and InputError, UsageError, RendererError or OutputError is raised.
    """
    options, progress = options or BakeOptions(), progress or Progress()
    mesh = Path(mesh)
    stem = stem or mesh.stem
    watch = Stopwatch(progress)
    texture_path = output_path(output, f"{stem}_ao.png")
    choose_bit_depth(texture_path, options.bit_depth)
    if verify:
        require_embreex()
    with Outputs() if outputs is None else nullcontext(outputs) as outputs:
        outputs.protect([mesh])
        claim_output(outputs, output, texture_path)
        with watch.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        folder = texture_path.parent
        mesh_path = output_path(mesh_output, folder / f"{stem}_ao{output_mesh_extension(scene)[0]}")
        check_mesh_extension(mesh_path, options.pack)
        claim_output(outputs, mesh_output, mesh_path)
        report_path = None if report is None else output_path(report, f"{stem}_report.json")
        if report_path is not None:
            claim_output(outputs, report, report_path)
        baked = bake_scene(scene, options, progress, watch, make_visibility)
        suffix, reason = output_mesh_extension(baked.scene, baked.atlas)
        mesh_path = output_path(mesh_output, folder / f"{stem}_ao{suffix}")
        check_mesh_extension(mesh_path, options.pack)
        with watch.stage("write"):
            written = outputs.path(texture_path)
            write_image(written, baked.texture.values, options.bit_depth)
            notes = write_baked_mesh(
                outputs, mesh_path, baked.scene, baked.atlas, baked.normals, texture_path, pack=options.pack
            )
        warnings = (*scene.warnings, *baked.warnings, *notes, *((reason,) if reason and mesh_output is None else ()))
        verified = _verified(baked, read_image(written), options, progress, watch) if verify else None
        if verify and any(part.uv_owner is not None for part in baked.scene.parts):
            warnings += about_sharing(baked.scene)
        places = {"texture": texture_path, "mesh": mesh_path}
        document = bake_report(baked, options, places, outputs.files, verified, watch.seconds(), warnings)
        if report_path is not None:
            write_json(outputs.path(report_path), document)
    for line in warnings:
        progress.warn(line)
    return BakeResult(texture_path, mesh_path, baked, document)


def bake_scene(
    scene: Scene,
    options: BakeOptions,
    progress: Progress | None = None,
    watch: Stopwatch | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
) -> Baked:
    """Bake a scene in memory; nothing is written.

    open_sight   what makes that which sees; by default it looks by itself
    Raises InputError where the scene cannot be unwrapped as asked or covers no texel, UsageError where the size is
    beyond the renderer or too small for the charts, where an unwrapper is asked for that is not installed and where no
    texel faces any direction, RendererError where there is no renderer.
    """
    progress = progress or Progress()
    watch = watch or Stopwatch(progress)
    scene = assign_roles(scene, options, share=options.instances == "share")
    normals = shading_normals(scene, options.normals, options.crease_angle)
    with open_backend(options, progress) as backend:
        backend.check_size(options)
        with watch.stage("unwrap"):
            atlas = choose_atlas(backend.rasterizer, scene, options, progress)
        progress.note(_describe(atlas, options.padding))
        site = BakeSetup(backend, BakeInputs(scene, atlas, normals, options))
        texels = site.texels
        size = f"{options.width} x {options.height}"
        if not len(texels):
            raise InputError(f"{scene.path}: its surface covers none of {size} texels; use a larger --size")
        overlap = site.overlap()
        shadow_size = options.shadow_size or auto_shadow_size(scene, atlas, len(texels), options.directions)
        most = texels_per_chunk(
            options.memory_limit,
            size,
            options.width * options.height,
            len(texels),
            maps=8 * shadow_size**2,
            triangles=len(site.sides[0].surface.occluders),
        )
        looks = sum(len(chunks(len(side.texels), most)) for side in site.sides)
        unit = "directions" if looks == len(site.sides) else f"directions, {looks} times to save memory"
        with watch.stage("visibility", looks * 2 * len(site.axes), unit):
            seen = [_gathered(site, side, make_visibility, shadow_size, most, progress) for side in site.sides]
        backend.check_errors()
    if not any(gathered.measured.any() for gathered in seen):
        raise UsageError(
            f"{len(texels)} texels are covered but face none of {2 * len(site.axes)} directions; use more --directions"
        )
    with watch.stage("finish"):
        paintings = [resolve_texels(side.texels, side.values, side.measured, side.reconstruction) for side in seen]
        texture = pad_and_fill(
            lighter_of_sides(paintings[0], paintings[-1]), options.padding, options.fill, repeats=atlas.repeats
        )
    baked = Baked(
        scene=scene,
        texture=texture,
        atlas=atlas,
        normals=normals,
        directions=max(side.directions for side in seen),
        sampling_error=max((side.error for side in seen if side.error is not None), default=None),
        occluded_share=_occluded_share(seen, options.width * options.height),
        backend=backend.kind,
        renderer=backend.name,
        shadow_size=shadow_size if backend.kind == "gl" else None,
    )
    return replace(baked, warnings=bake_warnings(baked, options, overlap))


def _gathered(
    site: BakeSetup,
    side: SurfaceSide,
    make_visibility: VisibilityFactory,
    shadow_size: int,
    most: int,
    progress: Progress,
) -> TexelOcclusion:
    sight = make_visibility(site, side, shadow_size, most, progress)  # is gone before the next side's is made
    return gather(site, side, sight, most)


def _occluded_share(sides: list[TexelOcclusion], size: int) -> float:
    """Return the share of the measured texels, of `size` in the picture, that no side sees light from."""
    measured, lit = np.zeros(size, bool), np.zeros(size, bool)
    for side in sides:
        measured[side.texels.index[side.measured]] = True
        lit[side.texels.index[side.measured & (side.values >= _DARK)]] = True
    return float(1 - lit[measured].mean())


def _verified(
    baked: Baked, picture: Float32Array, options: BakeOptions, progress: Progress, watch: Stopwatch
) -> TextureErrors:
    """Measure the picture that a bake has written."""
    asked = VerifyOptions(estimator=options.estimator, threads=options.threads)
    with watch.stage("verify", asked.points, "points"):
        return verify_scene(baked.scene, baked.atlas, baked.normals, picture, asked, progress)


def _describe(atlas: Atlas, padding: int) -> str:
    charts = f"{atlas.charts} chart{'s' if atlas.charts > 1 else ''}"
    if atlas.method == "keep":
        return f"unwrap: the file's own UVs, {charts}"
    right = first_unsafe_mip(atlas.gutter or 0, padding) - 1
    gutters = f"gutters of {atlas.gutter} texels: no charts mix up to mip level {right}"
    return f"unwrap: new UVs by {atlas.method}, {charts}, {gutters}"
