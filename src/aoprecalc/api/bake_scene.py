"""The bake itself, in memory: from a Scene to its ambient-occlusion texture, with warnings and notes."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial, reduce

from aoprecalc.api.bake_messages import describe_uvs, messages_on
from aoprecalc.api.high_to_low import messages_on_misses, missed_texels, nothing_met, with_detail
from aoprecalc.api.mesh import with_poses
from aoprecalc.api.surroundings import with_surroundings
from aoprecalc.api.texture_size import choose_texture
from aoprecalc.api.vertex_ao import fit_to_texture
from aoprecalc.errors import InputError, UsageError, counted
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.roles import assign_roles, in_poses, up_axis
from aoprecalc.mesh.surface import default_crease_angle, shading_normals
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.progress import Progress, StageTimer, notes_of, warnings_of
from aoprecalc.raster.resolve import fill_missed, lighter_of_sides, pad_and_fill, resolve_texels
from aoprecalc.types import Baked, DarkTexels, Float32Array, Scene
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
