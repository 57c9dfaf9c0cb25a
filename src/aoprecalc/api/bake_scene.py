"""The bake itself, in memory: from a Scene to its ambient-occlusion texture, with warnings and notes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

from aoprecalc.api.bake_messages import describe_uvs, messages_on
from aoprecalc.api.certified_bake import Attempt, Certified, certify_texture, direction_counts, until_certain
from aoprecalc.api.high_to_low import messages_on_misses, missed_texels, nothing_met
from aoprecalc.api.prepared_scene import PreparedScene, prepare_bake, value_options
from aoprecalc.api.texture_size import ChosenTexture, choose_texture, next_size
from aoprecalc.api.vertex_ao import fit_to_texture
from aoprecalc.errors import AoprecalcError, InputError, UsageError, counted
from aoprecalc.mesh.detail import detail_of
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress, StageTimer, notes_of, warnings_of
from aoprecalc.raster.padding import fill_missed, pad_and_fill
from aoprecalc.raster.resolve import lighter_of_sides, resolve_texels
from aoprecalc.types import CONFIDENCE, Baked, Certificate, DarkTexels, Scene, Texels, Texture
from aoprecalc.visibility.backend import Backend, open_backend
from aoprecalc.visibility.dark_texels import dark_texels
from aoprecalc.visibility.directions import DirectionPlan
from aoprecalc.visibility.gather import TexelOcclusion, gather
from aoprecalc.visibility.map_error import warnings_on_maps
from aoprecalc.visibility.pilot import enough_directions
from aoprecalc.visibility.plan import GatherPlan, plan_gather
from aoprecalc.visibility.rays import require_embreex
from aoprecalc.visibility.setup import BakeInputs, BakeSetup, SurfaceSide
from aoprecalc.visibility.source import LocalVisibility, VisibilityFactory


def bake_scene(
    scene: Scene,
    options: BakeOptions,
    progress: Progress | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
) -> Baked:
    """Bake one texture of a scene in memory (Précalcul, section 1.1).

    Raises what `prepare_bake`, `open_backend` and `bake_prepared` raise.
    """
    progress = progress or Progress()
    prepared = prepare_bake(scene, options)
    with open_backend(options, progress) as backend:
        return bake_prepared(prepared, backend, options, progress, StageTimer(progress), make_visibility)


def bake_prepared(
    prepared: PreparedScene,
    backend: Backend,
    options: BakeOptions,
    progress: Progress,
    timer: StageTimer,
    make_visibility: VisibilityFactory = LocalVisibility,
    textures: int = 1,
) -> Baked:
    """Bake one texture of a prepared scene on a backend that is open.

    timer             receives the seconds of each stage
    make_visibility   makes the source of the visibility sums of one side; by default this process computes them
    textures          of the same bake, whose certificates are right together
    Raises InputError where the scene cannot be unwrapped as asked or covers no texel, UsageError where the size is
    beyond the renderer or too small for the charts, where the unwrapper is not installed and where no texel faces any
    direction, RendererError where the renderer fails.
    """
    run = _Run(prepared, backend, make_visibility, progress, timer)
    chosen = run.choose(options)
    certified = None
    if options.max_error is None:
        made = run.make(chosen, None)
    else:
        require_embreex()
        doubt = (1 - CONFIDENCE) / textures
        certified = run.make_certain(chosen, options, options.max_error, doubt)
        while certified.too_coarse and (size := next_size(chosen, backend, prepared.scene, options)) is not None:
            attempts = certified.attempts
            del certified  # before the next one takes memory
            chosen = run.choose(replace(options, size=size))
            certified = run.make_certain(chosen, options, options.max_error, doubt, attempts)
        made = certified.made
    uncertain = [] if certified is None else certified.warnings(options)
    measured, options = made.measured, chosen.options
    baked = Baked(
        scene=prepared.scene,
        texture=made.texture,
        atlas=chosen.atlas,
        normals=prepared.normals,
        directions=measured.directions,
        directions_per_texel=measured.directions_per_texel,
        sampling_error=measured.sampling_error,
        dark=measured.dark,
        backend=backend.kind,
        renderer=backend.name,
        shadow_size=measured.shadow_size,
        size_estimates=chosen.estimates,
        options=value_options(prepared.scene, options),
        missed=len(measured.missed),
        certificate=None if certified is None else certified.certificate,
    )
    if options.vertex_ao != "none":
        with timer.stage("vertices"):
            baked = replace(baked, vertex_ao=fit_to_texture(baked))
    messages = [*chosen.warnings, *measured.messages, *uncertain, *messages_on(baked, options, measured.overlap)]
    return replace(baked, warnings=warnings_of(messages), notes=notes_of(messages))


@dataclass(frozen=True, eq=False)
class _MadeTexture:
    """A finished texture, and what was measured for it."""

    measured: "MeasuredTexels"
    texture: Texture


@dataclass(frozen=True, eq=False)
class _Run:
    """Makes textures of a prepared scene; see `bake_prepared`."""

    prepared: PreparedScene
    backend: Backend
    make_visibility: VisibilityFactory
    progress: Progress
    timer: StageTimer

    def choose(self, options: BakeOptions) -> ChosenTexture:
        """Choose the size and the UVs."""
        with self.timer.stage("unwrap"):
            chosen = choose_texture(self.backend, self.prepared, options, self.progress)
        self.progress.note(describe_uvs(chosen.atlas, chosen.options.padding))
        return chosen

    def make(self, chosen: ChosenTexture, directions: DirectionPlan | None) -> _MadeTexture:
        """Make the texture of a size and UVs, with directions; None: as the options say."""
        scene, normals = self.prepared.scene, self.prepared.normals
        setup = BakeSetup(self.backend, BakeInputs(scene, chosen.atlas, normals, chosen.options, directions))
        if directions is None and setup.interleaved:
            with self.timer.stage("pilot sample"):
                setup = setup.with_directions(enough_directions(setup))
        measured = _measure(setup, self.make_visibility, self.progress, self.timer)
        with self.timer.stage("finish"):
            return _MadeTexture(measured, _finish(measured, setup.inputs))

    def make_certain(
        self,
        chosen: ChosenTexture,
        options: BakeOptions,
        max_error: float,
        doubt: float,
        before: Sequence[Attempt] = (),
    ) -> Certified[_MadeTexture]:
        """Make textures of a size and UVs until the error of one is certain, or cannot be; see `until_certain`."""

        def measure(made: _MadeTexture, confidence: float, attempt: int) -> Certificate:
            with self.timer.stage("certify"):
                return certify_texture(
                    self.prepared,
                    chosen.atlas,
                    made.texture.values,
                    options,
                    max_error,
                    confidence=confidence,
                    attempt=attempt,
                )

        return until_certain(
            lambda directions: self.make(chosen, directions),
            measure,
            max_error,
            direction_counts(options),
            doubt=doubt,
            before=before,
        )


@dataclass(frozen=True, eq=False)
class MeasuredTexels:
    """What a backend has measured of the texels of one texture.

    sides         the occlusion of each side, at least one texel of which has a value
    missed        covered texels without a value as their points are not on the detailed surface
    dark          texels that get no light, and why
    overlap       share of the covered texels whose centre lies inside more than one triangle
    shadow_size   side of the depth maps in texels; None without maps
    messages      warnings and notes about depth maps and misses
    """

    sides: tuple[TexelOcclusion, ...]
    missed: Texels
    dark: DarkTexels
    overlap: float
    shadow_size: int | None
    messages: tuple[str, ...]

    @property
    def directions(self) -> int:
        """The number of light directions that were used."""
        return max(side.directions for side in self.sides)

    @property
    def directions_per_texel(self) -> float:
        """How many of them a texel took itself, in the mean."""
        taken = sum(side.per_texel * len(side.texels) for side in self.sides)
        return taken / sum(len(side.texels) for side in self.sides)

    @property
    def sampling_error(self) -> float | None:
        """The greater of the sides' sampling errors, RMS; None where there is no estimate."""
        return max((side.error for side in self.sides if side.error is not None), default=None)


def _measure(
    setup: BakeSetup, make_visibility: VisibilityFactory, progress: Progress, timer: StageTimer
) -> MeasuredTexels:
    """Measure the texels of a setup; see `bake_prepared`."""
    if not len(setup.texels):
        raise _nothing_covered(setup.inputs)
    overlap, plan = setup.overlap(), plan_gather(setup)
    again = "" if plan.passes == len(setup.sides) else f", {plan.passes} times to save memory"
    directions = 2 * len(setup.axes) * max(1, len(setup.inputs.scene.poses))
    passes = plan.passes + len(setup.sides) * setup.interleaved  # the first is of one group at each texel
    with timer.stage("visibility", passes * directions, f"directions{again}"):
        sides = tuple(_gather_side(setup, side, plan, make_visibility, progress) for side in setup.sides)
    setup.backend.free_unused()
    dark, missed = dark_texels(setup, sides), missed_texels(setup, sides)
    shadow_size = plan.shadow_size if setup.backend.kind == "gl" else None
    on_maps = [] if shadow_size is None else warnings_on_maps(setup, sides, shadow_size)
    messages = (*on_maps, *messages_on_misses(setup, missed))
    setup.backend.check_errors()
    if not any(side.measured.any() for side in sides):
        raise _nothing_measured(setup)
    return MeasuredTexels(sides, missed, dark, overlap, shadow_size, messages)


def _gather_side(
    setup: BakeSetup, side: SurfaceSide, plan: GatherPlan, make_visibility: VisibilityFactory, progress: Progress
) -> TexelOcclusion:
    """Measure one side; what its visibility is tested with is freed before the next side's is made."""
    visibility = make_visibility(setup, side, plan.shadow_size, plan.chunk_size, progress)
    return gather(setup, side, visibility, plan.chunk_size)


def _finish(measured: MeasuredTexels, inputs: BakeInputs) -> Texture:
    """Return the texture: the lighter of its sides, padded and filled (Précalcul, section 1.1.3)."""
    resolved = [
        resolve_texels(side.texels, side.values, side.measured, side.reconstruction, side.vectors)
        for side in measured.sides
    ]
    lighter = fill_missed(reduce(lighter_of_sides, resolved), measured.missed)  # of levels of detail, too
    return pad_and_fill(lighter, inputs.options.padding, inputs.options.fill, repeats=inputs.atlas.repeats)


def _nothing_covered(inputs: BakeInputs) -> InputError:
    options = inputs.options
    advice = "use a larger --size" if options.texel_density is None else "use a greater --texel-density"
    size = f"{options.width} x {options.height}"
    return InputError(f"{inputs.scene.path}: its surface covers none of {size} texels; {advice}")


def _nothing_measured(setup: BakeSetup) -> AoprecalcError:
    scene, texels = setup.inputs.scene, len(setup.texels)
    if (detail := detail_of(scene)) is not None:
        return InputError(nothing_met(scene, detail, texels))
    facing = f"covered, but facing none of {2 * len(setup.axes)} directions"
    return UsageError(f"{counted(texels, 'texel')} {facing}; use more --directions")
