"""Options of `spheres`, `compare`, `preview`, `batch` and `verify`."""

from dataclasses import InitVar, dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Annotated, Literal

from aoprecalc.errors import ArgumentError
from aoprecalc.options.bake import (
    AllPartsField,
    Backend,
    BackfacesField,
    CageField,
    ConeField,
    CreaseAngleField,
    EstimatorField,
    ExcludeField,
    FalloffField,
    GlassOccludesField,
    GroundField,
    GroundHeightField,
    HighField,
    MatchField,
    MaxDistanceField,
    NormalsField,
    OccluderField,
    OccludersOnlyField,
    OnlyField,
    PoseField,
    SelfOcclusionField,
    SkyField,
    ThreadsField,
    TwoSidedField,
    Up,
    UpField,
    ValueOptions,
    WeightField,
    plain_pose,
)
from aoprecalc.options.fields import Option, Validated, documented, option_field, option_fields
from aoprecalc.options.quantities import BYTES, LEVELS, NONE, SIZE, VECTOR

Radius = Literal["mean", "uniform", "cover"]
Init = Literal["first", "kmeans++"]
Method = Literal["lloyd", "algebraic", "shadow", "collision"]
Ship = Literal["auto", "folder", "bytes"]
Shading = Literal["ao", "clay", "material"]
SpheresView = Literal["beside", "over"]

_spheres = partial(Option, group="Spheres")
_samples = partial(Option, group="Samples")
_measurement = partial(Option, group="Measurement")
_picture = partial(Option, group="Picture")
_run = partial(Option, group="Run")
_cache = partial(Option, group="Cache")
_cluster = partial(Option, group="Cluster")

_MAX_PIXELS = 1 << 29  # of all views or frames of a preview, which are held at once

# fmt: off
# One paragraph an option: its type, help, range, what the documentation adds, and its default.


@documented
@dataclass(frozen=True)
class SphereOptions(Validated):
    """How to fit spheres to a mesh."""

    spheres: Annotated[int, _spheres(
        "Number of spheres; exactly as many are fitted.", "-n", common=True, range=(1, 1_000_000))] = 100
    samples: Annotated[int, _samples(
        "Points drawn from the surface.", "-s", common=True, range=(1, 100_000_000),
        more="There must be at least as many as spheres.")] = 100_000
    seed: Annotated[int, _samples("Seed of the samples and of every random choice.", range=(0, 2**32 - 1))] = 0
    radius: Annotated[Radius, _spheres(
        "Radius of a sphere: mean distance of its samples (mean), largest (cover), or one mean of all samples for all "
        "spheres (uniform).",
        more="For lloyd and algebraic; the mean is the root mean square for algebraic.")] = "mean"
    init: Annotated[Init, _spheres(
        "Start at the first samples, or at samples that are far apart (kmeans++).",
        more="For lloyd and algebraic.")] = "first"
    max_iterations: Annotated[int, _spheres(
        "Stop after this many iterations even if not converged.", range=(1, 1_000_000),
        more='For lloyd and algebraic; a warning says so, and `"converged"` is false.')] = 1000
    method: Annotated[Method, _spheres(
        "Cluster means (lloyd), least squares (algebraic), best silhouettes (shadow), or spheres that contain the "
        "whole surface (collision).", common=True,
        more="For soft shadows shadow is the best; lloyd and algebraic are those of the report Précalcul.")] = "lloyd"
    tolerance: Annotated[float | None, _spheres(
        "Find the smallest number of spheres whose error is at most E, instead of `spheres`.", common=True,
        range=(0, 1), metavar="E", default_text="take `spheres`", instead_of="spheres",
        more="The error is 1 - silhouette IoU for shadow and collision, the mean surface error over the "
        "diagonal for lloyd and algebraic. The number, at most 4096 and a tenth of the samples, is found by "
        "doubling and halving; one sphere less, which was tried, has a larger error.")] = None
    levels: Annotated[tuple[int, ...], _spheres(
        "Fit several sets, coarse to fine, instead of `spheres` (JSON only).", common=True, quantity=LEVELS,
        instead_of="spheres",
        more="Numbers of spheres, ascending, such as 8,32,128. Every sphere of a finer set names its parent in "
        "the coarser one, which lies about it but need not contain it.")] = ()

    all_parts: Annotated[bool, _samples(
        "Treat levels of detail and collision hulls as ordinary parts.",
        more="Without it spheres stand for the finest level of detail (MSFT_lod, names like tree_LOD0), and collision "
        "hulls (names like UCX_tree, COL_tree, tree-colonly) are left out.")] = False

    def __post_init__(self) -> None:
        """Check every value; raise ArgumentError where one is wrong, or where two contradict each other."""
        super().__post_init__()
        low, high = option_field(SphereOptions, "spheres").option.range or (1, 1)
        ascending = all(first < second for first, second in pairwise(self.levels))
        if self.levels and not (ascending and low <= self.levels[0] and self.levels[-1] <= high):
            raise ArgumentError(
                "levels", f"is {LEVELS.write(self.levels)}; expected ascending numbers of spheres such as 8,32,128"
            )
        if self.levels and self.tolerance is not None:
            raise ArgumentError("levels", "and {tolerance} both say how many spheres; use one of them", "tolerance")
        if self.method in ("shadow", "collision"):
            for name in ("radius", "init", "max_iterations"):
                if getattr(self, name) != getattr(SphereOptions, name):
                    raise ArgumentError(
                        name, f"is not for {{method}} {self.method}, which chooses by itself; omit it", "method"
                    )
        count = 1 if self.tolerance is not None else max(self.levels, default=self.spheres)
        if count > self.samples:
            raise ArgumentError(
                "levels" if self.levels else "spheres",
                f"asks for {count} spheres from {self.samples} samples, but each sphere starts at a sample of its own; "
                f"ask for fewer spheres, or for at least {count} samples with {{samples}}",
                "samples",
            )


@documented
@dataclass(frozen=True)
class CompareOptions(Validated):
    """How to compare two results.

    The difference is, of textures, the root mean square of B - A over the texels that the surface covers, or over the
    whole picture where no mesh is known; of meshes, the greatest of the distances of positions over the diagonal, of
    UVs, of normals, and the difference of their textures; of sphere sets, the farthest pair of spheres over the
    diagonal; of reports, the largest relative difference of two
    numbers.
    """

    tolerance: Annotated[float, _measurement(
        "Largest difference that passes; beyond it the exit code is 1.", range=(0, 1), metavar="E",
        more="The outputs stay. The default is less than an eye sees, and leaves room for another version of "
        "Mesa.")] = 0.005


@documented
@dataclass(frozen=True, kw_only=True)
class PreviewOptions(Validated):
    """How to draw a mesh with its ambient occlusion, and its spheres.

    `size` sets `width` and `height`, and takes precedence over them.
    """

    width: Annotated[int, Option("Width of the picture.", range=(16, 8192), unit="pixels", part_of="size")] = 1200
    height: Annotated[int, Option("Height of the picture.", range=(16, 8192), unit="pixels", part_of="size")] = 900
    shading: Annotated[Shading, _picture(
        "ao: clay darkened by the texture; clay: without it; material: the base colours with it.", common=True,
        more="Meshes without a texture are drawn as clay.")] = "ao"
    spheres_view: Annotated[SpheresView, _picture(
        "Draw the spheres beside the mesh, or over it.")] = "beside"
    ground: Annotated[bool, _picture(
        "Compare the soft shadows on the ground: the mesh's own, and that of the spheres.", common=True,
        more="Without spheres the mesh alone casts its shadow.")] = False
    views: Annotated[int, _picture(
        "Views from all around, in one contact sheet.", common=True, range=(1, 64))] = 1
    turntable: Annotated[bool, _picture(
        "Turn the mesh once: an animated .webp, or a folder of frames.", common=True)] = False
    frames: Annotated[int, _picture("Frames of `turntable`.", range=(2, 720))] = 48
    azimuth: Annotated[float, _picture(
        "Angle of the camera around the upward axis; 0 is in front of the mesh.", common=True, range=(-360, 360),
        unit="degrees", metavar="DEG")] = 24.0
    elevation: Annotated[float, _picture(
        "Angle of the camera above the ground.", range=(-90, 90), unit="degrees", metavar="DEG")] = 20.0
    up: Annotated[Up, _picture("Axis that points up. auto: y; z for STL, or as USD says.")] = "auto"
    pose: Annotated[str | None, _picture(
        "Draw the mesh where an animation of its glTF is at a time, such as walk@0.5.", metavar="NAME@SECONDS",
        default_text="the rest pose")] = None
    backend: Annotated[Backend, _run("Draw in OpenGL (gl) or by rays (ray). auto: gl, else ray.")] = "auto"
    threads: ThreadsField = 0
    size: InitVar[Annotated[int | tuple[int, int] | None, _picture(
        "Size of one view in pixels: one number for a square, or width and height.", common=True, range=(16, 8192),
        unit="pixels", quantity=SIZE)]] = None

    def __post_init__(self, size: int | tuple[int, int] | None) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        if size is not None:
            width, height = option_field(PreviewOptions, "size").check(size)
            object.__setattr__(self, "width", width)
            object.__setattr__(self, "height", height)
        super().__post_init__()
        if self.pose is not None:
            object.__setattr__(self, "pose", plain_pose(self.pose))
        if self.turntable and self.views > 1:
            raise ArgumentError("turntable", "and {views} both say which views to draw; use one of them", "views")
        count = self.frames if self.turntable else self.views
        if count * self.width * self.height > _MAX_PIXELS:
            raise ArgumentError(
                "size",
                f"is {self.width} x {self.height}: {count} of them are {count * self.width * self.height / 1e6:,.0f} "
                f"million pixels, at most {_MAX_PIXELS / 1e6:,.0f} million are drawn at once; use a smaller one",
            )
        if not self.turntable and self.frames != PreviewOptions.frames:
            raise ArgumentError("frames", "are those of a {turntable}; add it, or omit {frames}", "turntable", "frames")


@documented
@dataclass(frozen=True)
class FigureOptions(Validated):
    """The figures of a bake."""

    figure_direction: Annotated[tuple[float, float, float] | None, Option(
        "Direction towards the light of `--figures`, in the mesh's coordinates.", group="Output", quantity=VECTOR,
        default_text="towards the camera of previews",
        more="Its length does not matter. By default it points 24 degrees to the right of the front (+z) and 20 "
        "degrees upwards.")] = None


@documented
@dataclass(frozen=True)
class BatchOptions(Validated):
    """How to work through many meshes."""

    jobs: Annotated[int, _run(
        "Meshes at a time, each in a process of its own; 0: as many as cores and memory allow.", "-j", common=True,
        range=(0, 4096),
        more="0 is one a core, if there is a GiB of memory for each. Cores beyond that are shared out.")] = 0
    timeout: Annotated[float | None, _run(
        "Give up a mesh that takes longer than this.", common=True, range=(0, 10_000_000), above_min=True,
        unit="seconds", metavar="SECONDS", default_text="no limit")] = None
    retries: Annotated[int, _run(
        "Further tries for a mesh whose process died.", range=(0, 100),
        more="It may have crashed, or have been killed because memory ran out.")] = 1
    fail_fast: Annotated[bool, _run("Stop at the first failure, or go on with the others.", off="--keep-going")] = False
    force: Annotated[bool, _run("Make everything again, whatever is there already.", common=True)] = False
    prune: Annotated[bool, _run(
        "Remove what earlier batches made of meshes that are no longer among these.",
        more="Files that were changed since stay.")] = False
    cache_size: Annotated[int, _cache(
        "Prune the cache to this size, least recently used results first.", range=(1, 1 << 50), unit="bytes",
        default_text="10G", quantity=BYTES,
        more="This happens after a batch that added to it, every ten minutes at most.")] = 10 << 30
    scheduler: Annotated[str | None, _cluster(
        "Work on the Dask cluster of this scheduler, such as tcp://host:8786.", metavar="ADDRESS",
        default_text="work on this machine")] = None
    ship: Annotated[Ship, _cluster(
        "How files get to the workers and back: through a folder that they share, or as bytes over the network.",
        more="auto: folder, if all workers have access to the output folder under the same path.")] = "auto"
    split: Annotated[bool, _cluster(
        "Divide the visibility of each bake among the workers, one mesh after the other.")] = False

    def __post_init__(self) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        super().__post_init__()
        if self.scheduler is None and (self.split or self.ship != "auto"):
            name = "split" if self.split else "ship"
            raise ArgumentError(
                name,
                f"is for the workers of a {{scheduler}}, which was not given; add it, or omit {{{name}}}",
                "scheduler",
                name,
            )


@documented
@dataclass(frozen=True)
class VerifyOptions(Validated):
    """How to measure a texture against ray tracing.

    None is *as baked*: what the texture's file says of its bake, and the default of `BakeOptions` where it says
    nothing, as that of another program.
    """

    points: Annotated[int, _measurement("Points, uniform by area on the surface.", range=(1, 10_000_000))] = 20_000
    rays: Annotated[int, _measurement(
        "Rays from each point.", range=(64, 1_000_000),
        more="They are stratified in a square grid, so the number is rounded up to a square; 2304 leave a "
        "noise of about 0.002.")] = 48 * 48
    seed: Annotated[int, _measurement("Seed of the points and the rays.", range=(0, 2**32 - 1))] = 0
    estimator: EstimatorField | None = None
    max_distance: MaxDistanceField | None = None
    falloff: FalloffField | None = None
    cone: ConeField | None = None
    weight: WeightField | None = None
    normals: NormalsField | None = None
    crease_angle: CreaseAngleField | None = None
    pose: PoseField | None = None
    high: HighField | None = None
    cage: CageField | None = None
    match: MatchField | None = None
    tolerance: Annotated[float | None, _measurement(
        "Largest RMS error at full resolution that passes; beyond it the exit code is 1.", common=True, range=(0, 1),
        metavar="E", default_text="any error passes", more="The outputs stay.")] = None
    threads: ThreadsField = 0
    only: OnlyField | None = None
    exclude: ExcludeField | None = None
    occluders_only: OccludersOnlyField | None = None
    occluder: OccluderField | None = None
    glass_occludes: GlassOccludesField | None = None
    all_parts: AllPartsField | None = None
    two_sided: TwoSidedField | None = None
    sky: SkyField | None = None
    self_occlusion: SelfOcclusionField | None = None
    backfaces: BackfacesField | None = None
    ground: GroundField | None = None
    ground_height: GroundHeightField | None = None
    up: UpField | None = None

    def value_options(self, baked: ValueOptions | None = None) -> ValueOptions:
        """Return what the texture should hold: the options given here, else those of its bake, else the defaults.

        Parameters
        ----------
        baked : ValueOptions or None
            The options of the bake; None where they are not known.

        Returns
        -------
        ValueOptions

        Raises
        ------
        ArgumentError
            If together they contradict each other.
        """
        names = [field.name for field in option_fields(ValueOptions) if hasattr(self, field.name)]
        given = {name: value for name in names if (value := getattr(self, name)) is not None}
        if given.get("high") == ():
            given = {"cage": "auto", "match": "name"} | given
        value = baked or ValueOptions()
        if given.get("ground") is False:
            given = {"ground_height": None} | given
        if given.get("max_distance") == NONE:
            given = {"falloff": "none"} | given
        if {"ground", "sky"} & given.keys() and "up" not in given:
            lit = replace(value, up="auto", **given)
            return replace(lit, up=value.up) if lit.has_up else lit
        return replace(value, **given)
