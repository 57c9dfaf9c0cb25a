"""Verify: the error of an ambient-occlusion texture against ray tracing, as a renderer would show it."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from aoprecalc.api.certified_bake import confirm
from aoprecalc.api.high_to_low import detailed_meshes, messages_on_missed_points, names_of
from aoprecalc.api.mesh import MeshLike, as_mesh, given_or_default
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.surroundings import files_beside
from aoprecalc.api.textured_surface import TexturedSurface, find_texture
from aoprecalc.api.verify_report import VerifyOutputs, VerifyReport, verify_report
from aoprecalc.errors import InputError, UsageError, counted, one_or_many
from aoprecalc.io import (
    IMAGE_EXTENSIONS,
    Outputs,
    choose_bit_depth,
    source_files,
    write_colors,
)
from aoprecalc.io.occlusion import mesh_beside
from aoprecalc.io.outputs import claim_output, output_path, write_json
from aoprecalc.mesh.roles import surrounding_part
from aoprecalc.mesh.surface import area_vectors, sample_surface
from aoprecalc.metrics.errors import TextureErrors, errors_per_mip_level, worst_points
from aoprecalc.metrics.reference import MeasuredSurface, reference_ao, stratified_ray_count
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.options.fields import option_files
from aoprecalc.progress import Note, Progress, StageTimer, tell
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout
from aoprecalc.render.comparison import error_heat_map, heat_map_size
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Atlas, Float32Array, Scene
from aoprecalc.uv.checks import MAX_OVERLAP
from aoprecalc.visibility.integrand import Integrand

_FEW_POINTS = 1000  # that leave the RMS error of a part uncertain by several per cent


def verify(
    mesh: MeshLike,
    texture: str | PathLike[str] | ArrayLike | None = None,
    options: VerifyOptions | None = None,
    *,
    high: Sequence[MeshLike] = (),
    heat_map: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> VerifyReport:
    """Measure an ambient-occlusion texture, of any origin, against ray tracing.

    The texture is looked up bilinearly at points uniform on the surface, at full resolution and in its mip levels.

    Parameters
    ----------
    mesh : Mesh, str, path-like or trimesh.Trimesh
        A mesh with UVs, or the path of a mesh file.
    texture : str, path-like or array_like, optional
        The path of a picture, or an array (H, W) with row 0 at v = 1: numbers in [0, 1], or unsigned integers over
        their whole range. By default the mesh's own (see `Mesh.ao`), the picture that its file refers to, or
        ``<stem>.png`` beside the file.
    options : VerifyOptions, optional
        Number of points and rays, the greatest error that passes, and so on. What is not given of the options that
        define the value is as in the bake, if the texture or the glTF file around it says so.
    high : sequence of Mesh, str, path-like or trimesh.Trimesh
        Detailed meshes of whose ambient occlusion the texture is, as from the files of `VerifyOptions.high`.
    heat_map : str or path-like, optional
        A picture file (or a folder) for the errors in texture space: blue is too dark, red too bright.
    report : str or path-like, optional
        A JSON file (or a folder) for the report.
    progress : Progress, optional
        Receives stages, notes and warnings.

    Returns
    -------
    VerifyReport
        An error beyond `VerifyOptions.tolerance` is an answer (`passed` is False); the files are written.

    Raises
    ------
    ArgumentError
        If `mesh` is not a mesh, or `texture` is not a texture.
    InputError
        If the mesh or the picture cannot be used.
    RendererError
        If rays cannot be cast.
    UsageError, OutputError
        If a file cannot be written; then none is.

    References
    ----------
    The value is that of *Précalcul*, equation 1.1.1.1; the rays are stratified and cosine-weighted.
    """
    options, progress = given_or_default(options, VerifyOptions), progress or Progress()
    timer = StageTimer(progress)
    wanted = {key: output for key, output in (("heat_map", heat_map), ("report", report)) if output is not None}
    paths = _output_paths(mesh, wanted)
    with Outputs() as outputs:
        with timer.stage("load"):
            _require_no_picture(mesh)
            mesh, details = as_mesh(mesh), detailed_meshes(high, options)
            options = replace(options, high=names_of(details)) if details else options
            surface = TexturedSurface.of(mesh._scene, find_texture(mesh, texture, options), options)
        outputs.protect(_files_read(surface))
        for key, path in paths.items():
            claim_output(outputs, wanted[key], path)
        value = surface.options  # of a mesh in memory, with paths
        if mesh.ao is None:
            value = files_beside(value, options, surface.scene, surface.picture)
        outputs.protect(map(Path, option_files(value)))
        prepared = PreparedScene.of(surface.scene, value, options.threads, details)
        surface = replace(surface, scene=prepared.scene)
        with timer.stage("rays", options.points, "points"):
            verified = measure_texture(prepared, surface.atlas, surface.picture.values, options, progress, value=value)
        certificate = None
        if (claimed := surface.certificate) is not None:
            with timer.stage("certificate"):
                certificate = confirm(claimed, prepared, surface.atlas, surface.picture.values, value, options)
        if "heat_map" in paths:
            with timer.stage("heat map"):
                _write_heat_map(outputs.path(paths["heat_map"]), surface, verified)
        messages = [*_messages(surface, options), *messages_on_missed_points(verified)]
        written = VerifyOutputs(**{key: str(path) for key, path in paths.items()})
        document = verify_report(surface, verified, certificate, options, written, timer.seconds(), messages)
        if "report" in paths:
            write_json(outputs.path(paths["report"]), document.to_dict())
    tell(progress, messages)
    return document


def measure_texture(
    prepared: PreparedScene,
    atlas: Atlas,
    texture: Float32Array,
    options: VerifyOptions,
    progress: Progress,
    *,
    value: ValueOptions,
) -> TextureErrors:
    """Measure a texture in memory, (h, w) float32 with row 0 at v = 1; points done are counted on `progress`.

    atlas   UVs of the texture; the faces that it maps are measured, some of them have area
    value   what the texture should hold
    Raises RendererError where rays cannot be cast, InputError where no point is on the detailed surface.
    """
    scene = prepared.scene
    drawn = sample_surface(scene, atlas.mapped, options.points, options.seed)
    integrand = Integrand.from_options(value, scene)
    surface = MeasuredSurface(scene, prepared.normals, options.threads)
    hit, on_surface = surface.points(drawn)
    if not hit.any():
        raise InputError(f"{scene.path}: none of its points are on the detailed surface; use a greater --cage")
    points = drawn.select(hit)
    expected = reference_ao(surface.scene, surface.normals, on_surface, options, progress, integrand)
    uvs, positions = points.interpolate(atlas.uvs), points.interpolate(scene.corners)
    values = bilinear(texture, uvs, repeats=atlas.repeats)
    diagonal = float(np.linalg.norm(np.ptp(scene.positions, axis=0)))
    return TextureErrors(
        levels=errors_per_mip_level(texture, uvs, expected, repeats=atlas.repeats),
        worst=worst_points(positions, uvs, values, expected, diagonal),
        rays=stratified_ray_count(options.rays),
        uvs=uvs,
        errors=values - expected,
        reference=expected,
        hit=hit,
    )


def _output_paths(mesh: MeshLike, wanted: Mapping[str, str | PathLike[str]]) -> dict[str, Path]:
    """Return where the heat map and the report go, those that are wanted; raises UsageError where they cannot."""
    stem = Path(mesh).stem if isinstance(mesh, str | PathLike) else getattr(mesh, "name", "mesh")
    defaults = {"heat_map": f"{stem}_heat_map.png", "report": f"{stem}_verify.json"}
    paths = {key: output_path(output, defaults[key], key) for key, output in wanted.items()}
    if "heat_map" in paths:
        choose_bit_depth(paths["heat_map"], "8")
    return paths


def _files_read(surface: TexturedSurface) -> list[Path]:
    """Return the files of the mesh and the picture."""
    picture = surface.picture.path
    return [*source_files(surface.scene), *([] if picture is None else [picture])]


def _require_no_picture(mesh: MeshLike) -> None:
    """Raise UsageError where the mesh is the path of a picture."""
    if not isinstance(mesh, str | PathLike) or (path := Path(mesh)).suffix.lower() not in IMAGE_EXTENSIONS:
        return
    found = mesh_beside(path)
    advice = f"aoprecalc verify {shlex.quote(str(found))}" if found else "pass that, and the picture with --texture"
    raise UsageError(f"{path}: is a picture, verify takes its mesh: {advice}")


def _messages(surface: TexturedSurface, options: VerifyOptions) -> list[str]:
    """Return notes and warnings about the mesh, the texture and the options."""
    taken = f"as baked, by {surface.picture.name}: {shlex.join(surface.taken)}"
    unknown = f"{surface.picture.name} does not say how it was baked: the defaults are assumed"
    assumed = surface.picture.options is None and surface.options == ValueOptions()
    return [
        *([Note(taken)] if surface.taken else []),
        *([Note(unknown)] if assumed else []),
        *surface.scene.notes,
        *surface.scene.warnings,
        *surface.warnings,
        *surface.note_on_strength,
        *surface.warning_on_mesh,
        *_warnings_on_few_points(surface, options),
        *_warnings_on_overlap(surface),
        *_notes_on_rays(options),
        *notes_on_shared_uvs(surface.scene),
    ]


def _write_heat_map(path: Path, surface: TexturedSurface, verified: TextureErrors) -> None:
    height, width = surface.picture.values.shape
    layout = build_layout(surface.scene, surface.atlas, *heat_map_size(width, height))
    texels = CPURasterizer(layout).coverage()
    write_colors(path, error_heat_map(texels, verified.uvs, verified.errors, repeats=surface.atlas.repeats))


def notes_on_shared_uvs(scene: Scene) -> tuple[Note, ...]:
    """Note that instances share UVs: the differences between them count as error, which no texture can avoid."""
    sharing = sum(part.receives and part.instance_of is not None for part in scene.parts)
    if not sharing:
        return ()
    share = f"{counted(sharing, 'part')} {one_or_many(sharing, 'shares its', 'share their')} UVs with others"
    return (Note(f"{share}: differences in AO between them count as error"),)


def _warnings_on_overlap(surface: TexturedSurface) -> list[str]:
    """Warn that places of the surface share texels, so that no texture can be right."""
    overlap = surface.overlap()
    if overlap < MAX_OVERLAP:
        return []
    share = f"{overlap:.1%} of the texels lie inside two triangles: no texture can be right for both"
    return [f"{share}; give the mesh other UVs, such as those of a bake"]


def _warnings_on_few_points(surface: TexturedSurface, options: VerifyOptions) -> list[str]:
    """Warn that a part that is far larger than the others has all the points but some."""
    scene = surface.scene
    areas = np.linalg.norm(area_vectors(scene.corners), axis=1) * surface.mapped
    large = surrounding_part(scene, areas)
    if large is None:
        return []
    rest = round(options.points * (1 - float(areas[large.faces].sum() / areas.sum())))
    if rest >= _FEW_POINTS:
        return []
    others = f"{counted(rest, 'point')} of {options.points} {one_or_many(rest, 'lies', 'lie')} on the other parts"
    alone = shlex.join(["--occluders-only", large.name])
    return [f"{large.name!r} is far larger than the rest: about {others}; measure them alone with {alone}"]


def _notes_on_rays(options: VerifyOptions) -> list[Note]:
    rays = stratified_ray_count(options.rays)
    if rays == options.rays:
        return []
    return [Note(f"{options.rays} rays per point are rounded up to {rays}, the next square")]
