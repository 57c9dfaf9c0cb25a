"""The bake itself, in memory: from a Scene to its ambient-occlusion texture, with warnings and a report."""

from dataclasses import replace
from functools import partial, reduce

import numpy as np

from aoprecalc.api.reports import (
    BakeOutputs,
    BakeReport,
    DarkPartShares,
    DarkTexelShares,
    InputMesh,
    OcclusionStatistics,
    PartRoles,
    RayTracedErrors,
    TexelCounts,
    Unwrapping,
    UvSetCheck,
)
from aoprecalc.errors import InputError, UsageError, counted, one_or_many
from aoprecalc.mesh.roles import assign_roles, up_axis
from aoprecalc.mesh.surface import area_vectors, default_crease_angle, geometric_normals, shading_normals
from aoprecalc.mesh.topology import topology
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.progress import Note, Progress, StageTimer, notes_of, warnings_of
from aoprecalc.raster.resolve import lighter_of_sides, pad_and_fill, resolve_texels
from aoprecalc.types import Atlas, Baked, DarkTexels, Part, Scene, UvCheck
from aoprecalc.uv.pack import first_unsafe_mip
from aoprecalc.uv.unwrap import choose_atlas, needs_uvs, surface_share, warnings_on_uvs
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.dark_texels import dark_texels, first_look
from aoprecalc.visibility.directions import auto_shadow_size
from aoprecalc.visibility.gather import LocalVisibility, TexelOcclusion, VisibilityFactory, gather
from aoprecalc.visibility.map_error import map_error
from aoprecalc.visibility.setup import BakeInputs, BakeSetup, SurfaceSide, chunks, texels_per_chunk

_MIN_DARK = 0.01  # of the texels: a note tells the causes where as many are dark
_MIN_INWARDS = 0.02  # of the texels: a warning where as many are dark and face inwards
_MIN_CAUSE = 0.0005  # of the texels: rarer causes are not told; 0.1% when rounded
_MANY = 0.5  # of the texels: a warning where as many are enclosed, or face the ground
_MAX_NAMES = 5  # of parts in one message


def bake_scene(
    scene: Scene,
    options: BakeOptions,
    progress: Progress | None = None,
    timer: StageTimer | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
) -> Baked:
    """Bake a scene in memory (Précalcul, section 1.1).

    timer             receives the seconds of each stage
    make_visibility   makes the source of the visibility sums of one side; by default this process computes them
    Raises InputError where the scene cannot be unwrapped as asked or covers no texel, UsageError where the size is
    beyond the renderer or too small for the charts, where the unwrapper is not installed and where no texel faces any
    direction, RendererError where there is no renderer.
    """
    progress = progress or Progress()
    timer = timer or StageTimer(progress)
    scene = assign_roles(scene, options, share=options.instances == "share")
    normals = shading_normals(scene, options.normals, options.crease_angle)
    with open_backend(options, progress) as backend:
        backend.check_size(options)
        with timer.stage("unwrap"):
            look = partial(first_look, backend, scene, normals, options)
            atlas = choose_atlas(backend.rasterizer, scene, options, progress, look)
        progress.note(_describe_uvs(atlas, options.padding))
        setup = BakeSetup(backend, BakeInputs(scene, atlas, normals, options))
        texels = setup.texels
        size = f"{options.width} x {options.height}"
        if not len(texels):
            raise InputError(f"{scene.path}: its surface covers none of {size} texels; use a larger --size")
        overlap = setup.overlap()
        shadow_size = options.shadow_size or max(
            auto_shadow_size(side.scene, atlas, len(texels), options.directions) for side in setup.sides
        )
        chunk_size = texels_per_chunk(
            options.memory_limit,
            size,
            options.width * options.height,
            len(texels),
            map_bytes=8 * shadow_size**2,
            triangles=len(setup.sides[0].surface.occluders),
        )
        passes = sum(len(chunks(len(side.texels), chunk_size)) for side in setup.sides)
        unit = "directions" if passes == len(setup.sides) else f"directions, {passes} times to save memory"
        with timer.stage("visibility", passes * 2 * len(setup.axes), unit):
            sides = [
                _gather_side(setup, side, make_visibility, shadow_size, chunk_size, progress) for side in setup.sides
            ]
        dark = dark_texels(setup, sides) if any(side.measured.any() for side in sides) else DarkTexels(0.0)
        maps = map_error(setup, sides, shadow_size) if backend.kind == "gl" else None
        backend.check_errors()
    if not any(side.measured.any() for side in sides):
        raise UsageError(
            f"{counted(len(texels), 'texel')} covered, but facing none of {2 * len(setup.axes)} directions; "
            "use more --directions"
        )
    with timer.stage("finish"):
        resolved_sides = [
            resolve_texels(side.texels, side.values, side.measured, side.reconstruction) for side in sides
        ]
        lighter = reduce(lighter_of_sides, resolved_sides)  # the levels of detail have different texels
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
        options=_value_options(scene, options),
    )
    coarse = [] if maps is None else [maps.warning(shadow_size)]
    messages = [*filter(None, coarse), *_messages(baked, options, overlap)]
    return replace(baked, warnings=warnings_of(messages), notes=notes_of(messages))


def _value_options(scene: Scene, options: BakeOptions) -> ValueOptions:
    """Return the options that define the value, also for copies of the mesh in other formats.

    So the axis that points up from the ground is named, and the crease angle of STL.
    """
    value = ValueOptions(**{field.name: getattr(options, field.name) for field in option_fields(ValueOptions)})
    if value.ground:
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


def _describe_uvs(atlas: Atlas, padding: int) -> str:
    charts = counted(atlas.charts, "chart")
    if atlas.method == "keep":
        return f"unwrap: the file's own UVs, {charts}"
    last_safe = first_unsafe_mip(atlas.gutter or 0, padding) - 1
    if _has_narrow_gutters(atlas, padding):  # a warning says so
        return f"unwrap: new UVs by {atlas.method}, {charts}"
    gutters = f"gutters of {counted(atlas.gutter or 0, 'texel')}: no charts mix up to mip level {last_safe}"
    return f"unwrap: new UVs by {atlas.method}, {charts}, {gutters}"


def _has_narrow_gutters(atlas: Atlas, padding: int) -> bool:
    """Tell whether charts mix from mip level 1 on because their gutters are narrower than was wanted."""
    return atlas.gutter is not None and atlas.gutter < padding and first_unsafe_mip(atlas.gutter, padding) == 1


# Messages: warnings of what may need an action, notes of the rest.


def _messages(baked: Baked, options: BakeOptions, overlap: float) -> list[str]:
    """Return warnings and notes; `overlap` is the share of texels whose centre lies inside two faces."""
    scene, atlas = baked.scene, baked.atlas
    lines: list[str] = [*_notes_on_materials(scene), *_notes_on_names(scene)]
    if baked.directions - 1 == options.directions:
        lines.append(Note(f"{baked.directions} directions instead of {options.directions}: they come in pairs"))
    lines += _warn_of_error(baked, options)
    lines += warnings_on_uvs(scene, atlas, overlap)
    if _has_narrow_gutters(atlas, options.padding):
        gutters = counted(atlas.gutter or 0, "texel")
        lines.append(
            f"{counted(atlas.charts, 'chart')}, and room for gutters of {gutters} only: charts may mix "
            "from mip level 1 on. Use a larger --size for wider gutters."
        )
    return [*lines, *_notes_on_ground(baked), *_messages_on_dark_texels(baked, options)]


def _notes_on_materials(scene: Scene) -> list[Note]:
    transparent = [part.name for part in scene.parts if part.material.transparent and not part.occludes]
    unlit = [part.name for part in scene.parts if part.material.unlit]
    lines = []
    if transparent:
        lines.append(Note(f"{_list(transparent)} transparent: baked, but light passes through; see --glass-occludes"))
    if unlit:
        lines.append(Note(f"{_list(unlit)} unlit: not baked"))
    return lines


def _notes_on_names(scene: Scene) -> list[Note]:
    """Return notes on the parts whose names give them another role."""
    hulls = [part.name for part in scene.parts if part.hull and not part.occludes and not part.receives]
    lines = []
    if scene.levels > 1:
        coarse = [part.name for part in scene.parts if part.levels and part.levels.start and part.receives]
        told = f"{scene.levels} levels of detail, each baked as if the others were not there"
        lines.append(Note(f"{told}; {_list(coarse)} coarser; see --all-parts"))
    if hulls:
        what = one_or_many(len(hulls), "a collision hull", "collision hulls")
        lines.append(Note(f"{_list(hulls)} {what}: neither baked nor in the way of light; see --all-parts"))
    return lines


def _list(parts: list[str]) -> str:
    names = _shorten([repr(name) for name in parts])
    return f"{counted(len(parts), 'part')} ({names}) {one_or_many(len(parts), 'is', 'are')}"


def _shorten(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return ", ".join(names[:_MAX_NAMES]) + more


def _warn_of_error(baked: Baked, options: BakeOptions) -> list[str]:
    error, target = baked.sampling_error, options.target_error
    if target is None or (error is not None and error <= target):
        return []
    if error is None:
        return ["the sampling error cannot be estimated from 128 directions or fewer; use more --directions"]
    return [
        f"the estimated sampling error is {error:.4f} after {baked.directions} directions, more than the target of "
        f"{target:g}; use more --directions"
    ]


def _notes_on_ground(baked: Baked) -> list[Note]:
    alone = _ground_alone(baked)
    if alone is None:
        return []
    return [
        Note(
            f"the ground alone lowers the mean AO to {alone:.2f}: no light comes from below, so upright walls get at "
            "most 0.5, and faces that point down 0"
        )
    ]


def _ground_alone(baked: Baked) -> float | None:
    """Return the mean AO of the texels if nothing but the ground took light from them; None without a ground.

    It is the mean of (1 + n.u) / 2 with the normals n of the faces and the upward vector u, weighted by their areas in
    the texture; of (1 + |n.u|) / 2 where a face is two-sided.
    """
    scene, atlas = baked.scene, baked.atlas
    if scene.ground_normal is None:
        return None
    upward = geometric_normals(scene, baked.normals) @ np.asarray(scene.ground_normal)
    upward = np.where(scene.two_sided, np.abs(upward), upward)
    sides = atlas.uvs[:, 1:] - atlas.uvs[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) * atlas.mapped
    return float((areas * (1 + upward) / 2).sum() / max(areas.sum(), 1e-30))


def _messages_on_dark_texels(baked: Baked, options: BakeOptions) -> list[str]:
    dark, parts = baked.dark, baked.dark.parts
    if not options.two_sided and topology(baked.scene.faces).watertight and _signed_volume(baked) < 0:
        return [
            "the mesh is closed and its faces point inwards: its inside was baked; flip the faces, or use --two-sided"
        ]
    if dark.share < _MIN_DARK:
        return []
    inwards = _shorten([f"{part.name!r}: {part.inwards:.0%}" for part in parts if part.inwards >= part.inside])
    enclosed = _shorten([f"{part.name!r}: {part.inside:.0%}" for part in parts if part.inside > part.inwards])
    causes = [
        (dark.inside, "enclosed, as inside another part or touching one" + (f" ({enclosed})" if enclosed else "")),
        (dark.inwards, "facing inwards" + (f" ({inwards})" if inwards else "")),
        (dark.on_ground, "resting on the ground"),
        (dark.above_ground, "facing the ground"),
        (dark.narrow, "in narrow gaps"),
    ]
    found = [(share, cause) for share, cause in causes if share >= _MIN_CAUSE]
    told = ", ".join(f"{share:.1%} {cause}" if len(found) > 1 else cause for share, cause in found)
    lines: list[str] = [Note(f"{dark.share:.1%} of texels are dark (AO below 0.01){f': {told}' if told else ''}")]
    if dark.inwards >= _MIN_INWARDS and not options.two_sided:
        lines.append(
            f"{dark.inwards:.1%} of texels face inwards: the front of their faces is enclosed, only the back sees out"
            f"{f' ({inwards})' if inwards else ''}; flip these faces, or use --two-sided"
        )
    if dark.inside >= _MANY:
        lines.append(
            f"{dark.inside:.1%} of texels are enclosed: if a part surrounds the others, such as a sky or a room, leave "
            "it out with --exclude"
        )
    if dark.on_ground + dark.above_ground >= _MANY and options.up == "auto" and baked.scene.up is None:
        lines.append(
            f"{dark.on_ground + dark.above_ground:.1%} of texels face the ground: if another axis points up, name it "
            "with --up"
        )
    return lines


def _signed_volume(baked: Baked) -> float:
    """Return three times the volume that a closed surface encloses, negative where its faces point inwards."""
    scene = baked.scene
    corners = scene.corners - scene.positions.mean(axis=0)
    areas = np.linalg.norm(area_vectors(corners), axis=1) / 2
    return float(np.einsum("fx,fx,f->", corners[:, 0], geometric_normals(scene, baked.normals), areas))


# The report.


def bake_report(
    baked: Baked,
    options: BakeOptions,
    outputs: BakeOutputs,
    verified: TextureErrors | None,
    seconds: dict[str, float],
    messages: tuple[str, ...],
) -> BakeReport:
    """Return the report of a bake; only `seconds` differs between equal runs."""
    scene, atlas, texture = baked.scene, baked.atlas, baked.texture
    mesh = topology(scene.faces)
    values = texture.values[texture.valid]
    valid, alone = int(np.count_nonzero(texture.valid)), _ground_alone(baked)
    lost = needs_uvs(scene) & ~atlas.mapped
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
        ),
        texels=TexelCounts(options.width, options.height, valid),
        ao=OcclusionStatistics(
            mean=round(float(values.mean(dtype=np.float64)), 6),
            min=round(float(values.min()), 6),
            max=round(float(values.max()), 6),
            unseen_share=round(baked.dark.share, 6),
            ground_alone=None if alone is None else round(alone, 6),
        ),
        dark=_dark_texel_shares(baked.dark),
        verify=None if verified is None else RayTracedErrors.of(verified),
        seconds=seconds,
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )


def _dark_texel_shares(dark: DarkTexels) -> DarkTexelShares | None:
    if not dark.samples:
        return None
    names = ("inside", "inwards", "on_ground", "above_ground", "narrow")
    shares = {name: round(getattr(dark, name), 6) for name in names}
    parts = tuple(DarkPartShares(part.name, round(part.inside, 6), round(part.inwards, 6)) for part in dark.parts)
    return DarkTexelShares(**shares, parts=parts, samples=dark.samples)


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
