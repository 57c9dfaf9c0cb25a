"""Verify: how far the ambient occlusion in a texture is from ray tracing, as a renderer would show it."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.api.reports import verify_report
from aoprecalc.errors import InputError
from aoprecalc.io import (
    OcclusionTexture,
    Outputs,
    choose_bit_depth,
    find_occlusion,
    load_scene,
    source_files,
    write_colors,
)
from aoprecalc.io.outputs import claim_output, output_path, write_json
from aoprecalc.mesh.normals import face_normals, shading_normals
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.sampling import sample_surface
from aoprecalc.metrics.errors import TextureErrors, errors_per_mip_level, worst_points
from aoprecalc.metrics.reference import reference_ao, stratified_ray_count
from aoprecalc.options import VerifyOptions
from aoprecalc.progress import Progress, Stopwatch
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import atlas_from_uvs, build_layout
from aoprecalc.render.comparison import error_heat_map, heat_map_size
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Atlas, Float32Array, Scene


@dataclass(frozen=True, eq=False)
class VerifyResult:
    """What was measured, whether it is within the tolerance, and the report (see the README for its keys)."""

    verified: TextureErrors
    passed: bool
    report: dict[str, Any]


def verify(
    mesh: str | PathLike[str],
    texture: str | PathLike[str] | None = None,
    *,
    heat_map: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    options: VerifyOptions | None = None,
    progress: Progress | None = None,
) -> VerifyResult:
    """Measure the ambient occlusion on a mesh file, of any origin, against ray tracing.

    texture    the picture; by default the one that the mesh file refers to, or <stem>.png beside it
    heat_map   a picture file for the errors in texture space: blue is too dark, red too bright
    report     a JSON file for the report
    A texture beyond the tolerance is an answer, not an error: the files appear. Raises InputError where the mesh or the
    picture cannot be used, RendererError where rays cannot be cast, UsageError or OutputError; then no file appears.
    """
    options, progress = options or VerifyOptions(), progress or Progress()
    mesh = Path(mesh)
    watch = Stopwatch(progress)
    wanted = {"heat_map": (heat_map, f"{mesh.stem}_heat_map.png"), "report": (report, f"{mesh.stem}_verify.json")}
    places = {name: output_path(path, default) for name, (path, default) in wanted.items() if path is not None}
    if "heat_map" in places:
        choose_bit_depth(places["heat_map"], "8")
    with Outputs() as outputs:
        with watch.stage("load"):
            scene = assign_roles(load_scene(mesh), options)
            found = find_occlusion(scene, None if texture is None else Path(texture))
        outputs.protect([*source_files(scene), *([] if found.path is None else [found.path])])
        for name, place in places.items():
            claim_output(outputs, wanted[name][0], place)
        atlas, left_out = _atlas(scene, found)
        normals = shading_normals(scene, options.normals, options.crease_angle)
        with watch.stage("rays", options.points, "points"):
            verified = verify_scene(scene, atlas, normals, found.values, options, progress)
        if "heat_map" in places:
            with watch.stage("heat map"):
                _write_heat_map(outputs.path(places["heat_map"]), scene, atlas, found, verified)
        warnings = (*scene.warnings, *found.warnings, *left_out, *_about_rays(options), *about_sharing(scene))
        document = verify_report(scene, atlas, found, verified, options, places, watch.seconds(), warnings)
        if "report" in places:
            write_json(outputs.path(places["report"]), document)
    for line in warnings:
        progress.warn(line)
    return VerifyResult(verified, document["passed"], document)


def verify_scene(
    scene: Scene, atlas: Atlas, normals: Float32Array, picture: Float32Array, options: VerifyOptions, progress: Progress
) -> TextureErrors:
    """Measure a picture in memory, (h, w) float32 with row 0 at v = 1; points done are counted on `progress`.

    scene     with the roles of its parts; see `assign_roles`
    atlas     how the picture lies on the scene; the faces that it covers are measured, some of them have area
    normals   (f, 3, 3) float32: the shading normals at the corners
    Raises RendererError where rays cannot be cast.
    """
    points = sample_surface(scene, atlas.mapped, options.points, options.seed)
    truth = reference_ao(scene, normals, points, options, progress)
    places, at = points.interpolate(atlas.uvs), points.interpolate(scene.corners)
    values = bilinear(picture, places, repeats=atlas.repeats)
    diagonal = float(np.linalg.norm(np.ptp(scene.positions, axis=0)))
    return TextureErrors(
        levels=errors_per_mip_level(picture, places, truth, repeats=atlas.repeats),
        worst=worst_points(at, places, values, truth, diagonal),
        rays=stratified_ray_count(options.rays),
        uvs=places,
        errors=values - truth,
    )


def _atlas(scene: Scene, found: OcclusionTexture) -> tuple[Atlas, list[str]]:
    """Return the UVs with the faces that they place in the picture, and what the user should know about the others.

    A face whose corners share one UV has no place: it stands for UVs that are missing.
    """
    has_area = face_normals(scene.corners)[1]
    placed = np.isfinite(found.uvs).all(axis=(1, 2)) & (found.uvs != found.uvs[:, :1]).any(axis=(1, 2))
    mapped = found.shown & scene.receives & has_area & placed
    if not mapped.any():
        raise InputError(
            f"{scene.path}: none of its {len(scene.faces)} faces has area and a place in {found.name}; "
            "bake it, or export it with UVs"
        )
    homeless = np.count_nonzero(found.shown & scene.receives & has_area & ~placed)
    said = [f"{homeless} of {len(scene.faces)} faces have no place in the texture and are left out"] if homeless else []
    return atlas_from_uvs(scene, found.uvs, mapped), said


def _write_heat_map(path: Path, scene: Scene, atlas: Atlas, found: OcclusionTexture, verified: TextureErrors) -> None:
    height, width = found.values.shape
    texels = CPURasterizer(build_layout(scene, atlas, *heat_map_size(width, height))).coverage()
    write_colors(path, error_heat_map(texels, verified.uvs, verified.errors, repeats=atlas.repeats))


def about_sharing(scene: Scene) -> tuple[str, ...]:
    """Say where the error holds more than a bake can do anything about: instances with one place in the texture."""
    sharing = sum(part.receives and part.instance_of is not None for part in scene.parts)
    if not sharing:
        return ()
    return (f"{sharing} parts share their places in the texture with others; that these see different things is error",)


def _about_rays(options: VerifyOptions) -> list[str]:
    rays = stratified_ray_count(options.rays)
    if rays == options.rays:
        return []
    return [f"{rays} rays a point were cast, as they stand in a square grid; {options.rays} were asked for"]
