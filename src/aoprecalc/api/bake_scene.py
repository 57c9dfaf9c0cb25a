"""The bake itself, in memory: from a Scene to its ambient-occlusion texture, with warnings and a report."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from aoprecalc.api.bake_messages import describe_uvs, ground_alone, messages_on
from aoprecalc.api.documents import RayTracedErrors
from aoprecalc.api.high_to_low import high_to_low, messages_on_misses, missed_texels, nothing_met, with_detail
from aoprecalc.api.mesh import with_poses
from aoprecalc.api.reports import (
    BakeOutputs,
    BakeReport,
    DarkPartShares,
    DarkTexelShares,
    InputMesh,
    OcclusionStatistics,
    PartRoles,
    SizeChoice,
    SizeError,
    TexelCounts,
    TextureReport,
    Unwrapping,
    UvSetCheck,
    VertexFit,
)
from aoprecalc.api.surroundings import with_surroundings
from aoprecalc.api.texture_size import choose_texture, resolution_target
from aoprecalc.api.vertex_ao import VertexErrors, fit_to_texture, vertex_errors
from aoprecalc.errors import InputError, UsageError, counted
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.roles import assign_roles, in_poses, up_axis
from aoprecalc.mesh.surface import default_crease_angle, shading_normals
from aoprecalc.mesh.topology import topology
from aoprecalc.metrics.difference import rounded
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.metrics.resolution import POINTS
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.progress import Progress, StageTimer, notes_of, warnings_of
from aoprecalc.raster.resolve import fill_missed, lighter_of_sides, pad_and_fill, resolve_texels
from aoprecalc.types import Baked, DarkTexels, Float32Array, Part, Scene, UvCheck
from aoprecalc.uv.checks import TexelDensity, needs_uvs, surface_share
from aoprecalc.uv.pack import first_unsafe_mip
from aoprecalc.visibility.backend import Backend, open_backend
from aoprecalc.visibility.dark_texels import dark_texels, first_look
from aoprecalc.visibility.directions import auto_shadow_size
from aoprecalc.visibility.gather import LocalVisibility, TexelOcclusion, VisibilityFactory, gather
from aoprecalc.visibility.map_error import map_error
from aoprecalc.visibility.setup import BakeInputs, BakeSetup, SurfaceSide, chunks, texels_per_chunk


@dataclass(frozen=True, eq=False)
class OpenedBake:
    """What the bakes of several textures of a scene share.

    backend   is open
    normals   (f, 3, 3) float32: the shading normals of the scene
    """

    backend: Backend
    normals: Float32Array


def prepare_scene(scene: Scene, options: BakeOptions, high: Sequence[Scene] = ()) -> tuple[Scene, Float32Array]:
    """Return a scene with its roles, what surrounds it, its poses and details; and its normals, (f, 3, 3) float32.

    high   detailed meshes in memory, in place of the files that `options` name
    """
    scene = with_surroundings(assign_roles(scene, options, share=options.instances == "share"), options)
    scene = with_detail(with_poses(scene, options), options, options.threads, high)
    return scene, shading_normals(scene, options.normals, options.crease_angle)


def bake_scene(
    scene: Scene,
    options: BakeOptions,
    progress: Progress | None = None,
    timer: StageTimer | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
    opened: OpenedBake | None = None,
) -> Baked:
    """Bake one texture of a scene in memory (Précalcul, section 1.1).

    timer             receives the seconds of each stage
    make_visibility   makes the source of the visibility sums of one side; by default this process computes them
    opened            what the bakes of several textures share; the scene is prepared then, see `prepare_scene`
    Raises InputError where the scene cannot be unwrapped as asked or covers no texel, UsageError where the size is
    beyond the renderer or too small for the charts, where the unwrapper is not installed and where no texel faces any
    direction, RendererError where there is no renderer.
    """
    progress = progress or Progress()
    timer = timer or StageTimer(progress)
    if opened is None:
        scene, normals = prepare_scene(scene, options)
    else:
        normals = opened.normals
    with nullcontext(opened.backend) if opened else open_backend(options, progress) as backend:
        backend.check_size(options)
        with timer.stage("unwrap"):
            look = partial(first_look, backend, scene, normals, options)
            chosen = choose_texture(backend, scene, normals, options, progress, look)
            options, atlas = chosen.options, chosen.atlas
        progress.note(describe_uvs(atlas, options.padding))
        setup = BakeSetup(backend, BakeInputs(scene, atlas, normals, options))
        texels, detail = setup.texels, detail_of(scene)
        size = f"{options.width} x {options.height}"
        if not len(texels):
            advice = "use a larger --size" if options.texel_density is None else "use a greater --texel-density"
            raise InputError(f"{scene.path}: its surface covers none of {size} texels; {advice}")
        overlap = setup.overlap()
        shadow_size = options.shadow_size or max(
            auto_shadow_size(posed, atlas, len(texels), options.directions, None if detail is None else side.scene)
            for side in setup.sides
            for posed, _ in in_poses(setup.textured(side), normals)
        )
        chunk_size = texels_per_chunk(
            options.memory_limit,
            size,
            options.width * options.height,
            len(texels),
            map_bytes=8 * shadow_size**2,
            triangles=len(setup.sides[0].surface.occluders) + (0 if detail is None else len(detail.scene.faces)),
            vectors=options.bent_normals,
        )
        passes = sum(len(chunks(len(side.texels), chunk_size)) for side in setup.sides)
        unit = "directions" if passes == len(setup.sides) else f"directions, {passes} times to save memory"
        passes *= max(1, len(scene.poses))
        with timer.stage("visibility", passes * 2 * len(setup.axes), unit):
            sides = [
                _gather_side(setup, side, make_visibility, shadow_size, chunk_size, progress) for side in setup.sides
            ]
        dark = dark_texels(setup, sides) if any(side.measured.any() for side in sides) else DarkTexels(0.0)
        maps = map_error(setup, sides, shadow_size) if backend.kind == "gl" else None
        missed = texels.select(slice(0, 0)) if detail is None else missed_texels(texels, sides)
        misses = messages_on_misses(setup, missed)
        backend.check_errors()
    if not any(side.measured.any() for side in sides):
        if detail is not None:
            raise InputError(nothing_met(scene, detail, len(texels)))
        raise UsageError(
            f"{counted(len(texels), 'texel')} covered, but facing none of {2 * len(setup.axes)} directions; "
            "use more --directions"
        )
    with timer.stage("finish"):
        resolved_sides = [
            resolve_texels(side.texels, side.values, side.measured, side.reconstruction, side.vectors) for side in sides
        ]
        lighter = fill_missed(reduce(lighter_of_sides, resolved_sides), missed)  # of levels of detail, too
        texture = pad_and_fill(lighter, options.padding, options.fill, repeats=atlas.repeats)
    baked = Baked(
        scene=scene,
        texture=texture,
        atlas=atlas,
        normals=normals,
        directions=max(side.directions for side in sides),
        sampling_error=max((side.error for side in sides if side.error is not None), default=None),
        dark=dark,
        backend=backend.kind,
        renderer=backend.name,
        shadow_size=shadow_size if backend.kind == "gl" else None,
        size_estimates=chosen.estimates,
        options=_value_options(scene, options),
        missed=len(missed),
    )
    if options.vertex_ao != "none":
        with timer.stage("vertices"):
            baked = replace(baked, vertex_ao=fit_to_texture(baked))
    coarse = [] if maps is None else [maps.warning(shadow_size)]
    messages = [*chosen.warnings, *filter(None, coarse), *misses, *messages_on(baked, options, overlap)]
    return replace(baked, warnings=warnings_of(messages), notes=notes_of(messages))


def _value_options(scene: Scene, options: BakeOptions) -> ValueOptions:
    """Return the options that define the value, also for copies of the mesh in other formats.

    So the axis that points up is named, and the crease angle of STL.
    """
    value = ValueOptions(**{field.name: getattr(options, field.name) for field in option_fields(ValueOptions)})
    if value.has_up:
        value = replace(value, up=up_axis(scene, options))
    if value.crease_angle is None and scene.format == "stl":
        value = replace(value, crease_angle=default_crease_angle(scene))
    return value


def _gather_side(
    setup: BakeSetup,
    side: SurfaceSide,
    make_visibility: VisibilityFactory,
    shadow_size: int,
    chunk_size: int,
    progress: Progress,
) -> TexelOcclusion:
    visibility = make_visibility(setup, side, shadow_size, chunk_size, progress)  # freed before the next side's is made
    return gather(setup, side, visibility, chunk_size)


# The report.

NamedBakes = Sequence[tuple[str, Baked]]  # textures of a bake: their names and bakes


def bake_report(
    baked: Baked,
    options: BakeOptions,
    outputs: BakeOutputs,
    verified: TextureErrors | None,
    seconds: dict[str, float],
    messages: tuple[str, ...],
    textures: NamedBakes = (),
) -> BakeReport:
    """Return the report of a bake; only `seconds` differs between equal runs.

    textures   of the bake, each by itself; none where there is one
    """
    scene, mesh = baked.scene, topology(baked.scene.faces)
    of_each = tuple(texture_report(name, one, options) for name, one in textures or (("", baked),))
    whole = of_each[0] if len(of_each) == 1 else _of_all(texture_report("", baked, options), textures, of_each)
    return BakeReport(
        input=InputMesh(
            str(scene.path),
            len(scene.faces),
            len(scene.positions),
            mesh.components,
            mesh.watertight,
            *(scene.welded or ()),
        ),
        parts=tuple(_part_roles(part) for part in scene.parts),
        outputs=outputs,
        renderer=baked.renderer,
        backend=baked.backend,
        directions=baked.directions,
        estimated_error=None if baked.sampling_error is None else round(baked.sampling_error, 6),
        sampling=options.sampling,
        options=baked.options,
        floor=scene.ground_normal,
        shadow_size=baked.shadow_size,
        unwrap=whole.unwrap,
        texels=whole.texels,
        size_choice=whole.size_choice,
        ao=whole.ao,
        dark=whole.dark,
        textures=of_each,
        verify=None if verified is None else RayTracedErrors.of(verified),
        vertex_ao=_vertex_fit(vertex_errors(baked, verified)),
        high_to_low=high_to_low(scene, baked.missed, whole.texels.valid + baked.missed),
        seconds=seconds,
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )


def texture_report(name: str, baked: Baked, options: BakeOptions) -> TextureReport:
    """Return what is reported of one texture."""
    scene, atlas, texture = baked.scene, baked.atlas, baked.texture
    height, width = texture.values.shape
    valid = int(np.count_nonzero(texture.valid))
    lost = needs_uvs(scene) & ~atlas.mapped
    density = TexelDensity.of(scene, atlas, width, height)
    return TextureReport(
        name=name,
        triangles=int(np.count_nonzero(scene.receives)),
        unwrap=Unwrapping(
            method=atlas.method,
            uv_set=atlas.uv_set,
            checks=tuple(_uv_set_check(check) for check in atlas.checks),
            charts=atlas.charts,
            lost_faces=int(np.count_nonzero(lost)),
            lost_share=round(surface_share(scene, lost), 6),
            used_share=round(valid / texture.valid.size, 4),
            gutter=atlas.gutter,
            first_unsafe_mip=None if atlas.gutter is None else first_unsafe_mip(atlas.gutter, options.padding),
            texel_density=rounded(density.mean),
            least_density=rounded(density.least),
        ),
        texels=TexelCounts(width, height, valid),
        size_choice=_size_choice(baked, options),
        ao=_statistics(texture.values[texture.valid], baked),
        dark=_dark_texel_shares(baked.dark),
    )


def _of_all(joined: TextureReport, textures: NamedBakes, of_each: Sequence[TextureReport]) -> TextureReport:
    """Return what is reported of several textures, from what is reported of their bakes as one."""
    counts, whole = [one.texels for one in of_each], [baked.texture for _, baked in textures]
    valid = sum(count.valid for count in counts)
    values = np.concatenate([texture.values[texture.valid] for texture in whole])
    mean = round(float(values.mean(dtype=np.float64)), 6)
    used = round(valid / sum(texture.valid.size for texture in whole), 4)
    return replace(
        joined,
        unwrap=replace(joined.unwrap, used_share=used),
        texels=TexelCounts(max(count.width for count in counts), max(count.height for count in counts), valid),
        ao=replace(joined.ao, mean=mean),
    )


def _statistics(values: Float32Array, baked: Baked) -> OcclusionStatistics:
    alone = ground_alone(baked)
    return OcclusionStatistics(
        mean=round(float(values.mean(dtype=np.float64)), 6),
        min=round(float(values.min()), 6),
        max=round(float(values.max()), 6),
        unseen_share=round(baked.dark.share, 6),
        ground_alone=None if alone is None else round(alone, 6),
    )


def _size_choice(baked: Baked, options: BakeOptions) -> SizeChoice | None:
    if not baked.size_estimates:
        return None
    tried = tuple(SizeError(size, rounded(error)) for size, error in baked.size_estimates)
    error = dict(baked.size_estimates)[len(baked.texture.values)]
    return SizeChoice(rounded(error), rounded(resolution_target(options)), POINTS, tried)


def _dark_texel_shares(dark: DarkTexels) -> DarkTexelShares | None:
    if not dark.samples:
        return None
    names = ("inside", "inwards", "on_ground", "above_ground", "narrow")
    shares = {name: round(getattr(dark, name), 6) for name in names}
    parts = tuple(DarkPartShares(part.name, round(part.inside, 6), round(part.inwards, 6)) for part in dark.parts)
    return DarkTexelShares(**shares, parts=parts, samples=dark.samples)


def _vertex_fit(errors: VertexErrors | None) -> VertexFit | None:
    if errors is None:
        return None
    traced = None if errors.traced is None else round(errors.traced, 6)
    return VertexFit(errors.vertices, round(errors.rmse, 6), traced)


def _part_roles(part: Part) -> PartRoles:
    return PartRoles(
        name=part.name,
        triangles=part.stop - part.start,
        receives=part.receives,
        occludes=part.occludes,
        shares=part.uv_owner,
        glass=part.material.transparent,
        unlit=part.material.unlit,
        cut_out=part.material.alpha_mask is not None,
        level=None if part.levels is None else part.levels.start,
        hull=part.hull,
    )


def _uv_set_check(check: UvCheck) -> UvSetCheck:
    overlap = None if check.overlap is None else round(check.overlap, 6)
    share = round(check.flat_share, 6)
    return UvSetCheck(check.uv_set, check.flat_faces, share, check.tiles, overlap, check.fault)
