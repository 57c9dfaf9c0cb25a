"""What can be chosen about a job, with the defaults; the command line takes both from here.

Standard library only, so that `aoprecalc --help` is instant.
"""

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Literal, get_args, get_type_hints

from aoprecalc.errors import UsageError

Sampling = Literal["fibonacci", "random"]
Estimator = Literal["ratio", "mean"]
Backend = Literal["auto", "gl", "ray"]
Unwrap = Literal["auto", "keep", "xatlas", "uvunwrap"]
Fill = Literal["mean", "pushpull", "none"]
Normals = Literal["auto", "file", "smooth", "flat"]
BitDepth = Literal["auto", "8", "16", "half", "float"]
Instances = Literal["bake", "share"]
Pack = Literal["none", "orm"]
Up = Literal["auto", "x", "y", "z"]
Radius = Literal["mean", "uniform", "cover"]
Init = Literal["first", "kmeans++"]
Method = Literal["lloyd", "algebraic", "shadow", "collision"]
Ship = Literal["auto", "folder", "bytes"]

# name -> (least, greatest): the ranges that help texts print and that every way in is held to.
RANGES: dict[str, tuple[int, int]] = {
    "width": (1, 32768),
    "height": (1, 32768),
    "directions": (1, 1_000_000),
    "shadow_size": (16, 8192),
    "unwrap_timeout": (0, 1_000_000),
    "padding": (0, 256),
    "crease_angle": (0, 180),
    "target_error": (0, 1),
    "threads": (0, 1024),
    "memory_limit": (1, 1 << 50),
    "seed": (0, 2**32 - 1),
    "spheres": (1, 1_000_000),
    "samples": (1, 100_000_000),
    "max_iterations": (1, 1_000_000),
    "points": (1, 10_000_000),
    "rays": (64, 1_000_000),
    "tolerance": (0, 1),
    "jobs": (0, 4096),
    "timeout": (0, 10_000_000),
    "retries": (0, 100),
}

# Options that are called otherwise than their fields.
_NAMES = {"width": "size", "height": "size"}

# Above this many triangles `--unwrap auto` prefers uvunwrap, 10 to 40 times faster than xatlas on large surfaces.
LARGE_MESH = 30_000


def _check(options: Any) -> None:
    """Hold every field to its range or its choices; raises UsageError."""
    hints = get_type_hints(type(options))
    for field in fields(options):
        value, hint = getattr(options, field.name), hints[field.name]
        name = f"--{_NAMES.get(field.name, field.name).replace('_', '-')}"
        choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
        if choices and value not in choices:
            raise UsageError(f"{name} is {value!r}; expected one of {', '.join(choices)}")
        if field.name in RANGES and value is not None:
            low, high = RANGES[field.name]
            kinds = (int, float) if float in (hint, *get_args(hint)) else (int,)
            if not isinstance(value, kinds) or isinstance(value, bool) or not low <= value <= high:
                kind = "number" if float in kinds else "whole number"
                raise UsageError(f"{name} is {value!r}; expected a {kind} from {low} to {high}")


@dataclass(frozen=True, kw_only=True)
class LightOptions:
    """What receives light and what is in its way.

    only            names (patterns with * and ?) of the parts that receive; the others still occlude; empty: all
    exclude         names of parts that neither receive nor occlude
    occluders_only  names of parts that occlude and do not receive
    glass_occludes  parts that light passes through (glTF: BLEND, transmission) occlude as others do
    two_sided       both sides of every face receive light: a texel has the larger of the two sides' values; else only
                    sheets that the file says to be cut out and double-sided (glTF), such as leaves
    ground          the scene stands on an endless floor: no light comes from below
    up              the axis that points away from that floor; auto: y, and z for STL
    """

    only: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    occluders_only: tuple[str, ...] = ()
    glass_occludes: bool = False
    two_sided: bool = False
    ground: bool = False
    up: Up = "auto"

    def __post_init__(self) -> None:
        """Raise UsageError where a value is out of its range."""
        _check(self)
        if self.up != "auto" and not self.ground:
            raise UsageError(f"--up {self.up} says where the floor is, but there is none; add --ground or omit it")


@dataclass(frozen=True)
class BakeOptions(LightOptions):
    """How to bake an ambient-occlusion texture; see LightOptions for what receives and what occludes.

    width, height   of the texture, in texels
    directions      light directions, uniform on the sphere; an odd number is rounded up, as they come in pairs
    sampling        fibonacci: an even lattice; random: antithetic pairs drawn from `seed`
    seed            of the random directions
    estimator       ratio: exactly 1 on an open point; mean: the unnormalised sum 4/N * sum(cos * visible)
    shadow_size     side of a near/far map in texels; None: so that its texels are smaller than the
                    texture's, larger with fewer than 1000 directions
    backend         what measures visibility: gl (depth maps), ray (rays, by embreex), or auto: gl, else ray
    unwrap          where UVs come from: keep the file's, xatlas, uvunwrap, or auto
    unwrap_timeout  seconds after which xatlas or uvunwrap is stopped and the bake fails; None: never
    padding         texels by which charts are extended into the gutter around them
    fill            what the texels of no chart hold: mean, pushpull or none (0)
    bit_depth       auto: 8 for PNG, half for EXR, 8 for others
    normals         auto: the file's (glTF without any: flat), else smooth; flat: the faces' own
    crease_angle    degrees: edges that bend more are hard where normals are made; None: 180, and 40 for STL
    target_error    stop before `directions` once the estimated sampling error (RMS) is at most this; None: never
    threads         for software rendering and rays; 0: all cores; a process keeps to what its first bake asked for
    memory_limit    bytes that this process is to stay within, unwrapping apart; None: none. Less memory takes more
                    time and gives the same texture
    instances       bake: each instance of a mesh has a place of its own in the texture; share: they have one together,
                    with the mean of what they see
    pack            orm: occlusion becomes the red channel of the material's roughness and metalness where these have
                    the same UVs (glTF)
    """

    width: int = 1024
    height: int = 1024
    directions: int = 1000
    sampling: Sampling = "fibonacci"
    seed: int = 0
    estimator: Estimator = "ratio"
    shadow_size: int | None = None
    backend: Backend = "auto"
    unwrap: Unwrap = "auto"
    unwrap_timeout: float | None = None
    padding: int = 8
    fill: Fill = "mean"
    bit_depth: BitDepth = "auto"
    normals: Normals = "auto"
    crease_angle: float | None = None
    target_error: float | None = None
    threads: int = 0
    memory_limit: int | None = None
    instances: Instances = "bake"
    pack: Pack = "none"

    def __post_init__(self) -> None:
        """Raise UsageError where a value is out of its range."""
        super().__post_init__()
        if self.unwrap_timeout == 0:
            raise UsageError("--unwrap-timeout is 0; expected more, or no such option for no limit")


@dataclass(frozen=True)
class SphereOptions:
    """How to fit spheres to a mesh.

    spheres          how many
    samples          points drawn on the surface, at least `spheres`
    seed             of the samples and of every random choice
    radius           mean: per cluster, the mean distance of its samples (algebraic: the root mean square, which is its
                     own); uniform: one radius, the mean over all samples; cover: per cluster, the greatest distance
    init             first: the first samples are the first centres; kmeans++: spread by squared distance
    max_iterations   stop here even if samples still change spheres; with radius and init for lloyd and algebraic alone
    method           lloyd: means of clusters, the source's metric B; algebraic: least squares, its metric A; shadow:
                     the silhouettes come closest to the mesh's; collision: the spheres hold the whole surface
    tolerance        as few spheres as leave an error of at most this, instead of `spheres`: of 1 - silhouette IoU for
                     shadow and collision, of the mean surface error / diagonal for others; None: `spheres`
    levels           numbers of spheres, ascending, of sets of several finenesses, instead of `spheres`; the default is
                     one
    """

    spheres: int = 100
    samples: int = 100_000
    seed: int = 0
    radius: Radius = "mean"
    init: Init = "first"
    max_iterations: int = 1000
    method: Method = "lloyd"
    tolerance: float | None = None
    levels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Raise UsageError where a value is out of its range."""
        _check(self)
        low, high = RANGES["spheres"]
        ascending = all(first < second for first, second in pairwise(self.levels))
        if self.levels and not (ascending and low <= self.levels[0] and self.levels[-1] <= high):
            told = ",".join(str(level) for level in self.levels)
            raise UsageError(f"--levels is {told}; expected ascending numbers of spheres such as 8,32,128")
        if self.levels and self.tolerance is not None:
            raise UsageError("--levels and --tolerance both say how many spheres; use one of them")
        if self.method in ("shadow", "collision"):
            for field in fields(self):
                if field.name in ("radius", "init", "max_iterations") and getattr(self, field.name) != field.default:
                    name = field.name.replace("_", "-")
                    raise UsageError(f"--{name} is not for --method {self.method}, which chooses by itself; omit it")
        most = 1 if self.tolerance is not None else max(self.levels, default=self.spheres)
        if most > self.samples:
            raise UsageError(
                f"{most} spheres from {self.samples} samples: each sphere starts at a sample of its own; "
                f"ask for fewer spheres or at least {most} samples"
            )


@dataclass(frozen=True)
class VerifyOptions(LightOptions):
    """How to measure a texture against ray tracing; see LightOptions for what occludes.

    points         drawn uniformly on the surface
    rays           cast from each of them; rounded up to a square number, as they are stratified in a square grid
    seed           of the points and the rays
    estimator      of the value that the texture is to hold, as in BakeOptions
    normals, crease_angle   as in BakeOptions
    tolerance      the greatest RMS error that passes, at full resolution; None: any
    threads        that cast rays; 0: all cores
    """

    points: int = 20_000
    rays: int = 48 * 48
    seed: int = 0
    estimator: Estimator = "ratio"
    normals: Normals = "auto"
    crease_angle: float | None = None
    tolerance: float | None = None
    threads: int = 0


@dataclass(frozen=True)
class CompareOptions:
    """How to compare two results.

    tolerance   the greatest difference that passes as near: of textures the root mean square; for others see the
                README. The default is less than an eye sees, and leaves room for another version of a renderer
    """

    tolerance: float = 0.005

    def __post_init__(self) -> None:
        """Raise UsageError where a value is out of its range."""
        _check(self)


@dataclass(frozen=True)
class BatchOptions:
    """How to work through many assets.

    jobs        assets at a time, each in a process of its own; 0: as many as there are cores and GiB of memory
    timeout     seconds after which an asset is given up; None: never
    retries     how often an asset is tried again whose process died (of a crash, or for want of memory)
    fail_fast   stop at the first asset that fails; else the others go on
    force       make everything again, whatever is there already
    prune       remove what earlier batches made of meshes that are not among these any more, unless it was changed
    cache_size  bytes to which the cache is pruned after a batch that added to it; what was used last stays
    scheduler   address of a Dask scheduler whose workers do the work, such as tcp://host:8786; None: this machine
    ship        how files reach those workers and come back: folder: under the same paths, which they share; bytes: over
                the network; auto: folder, if they see the output folder
    split       the visibility of each bake is divided among the workers, one asset after the other
    """

    jobs: int = 0
    timeout: float | None = None
    retries: int = 1
    fail_fast: bool = False
    force: bool = False
    prune: bool = False
    cache_size: int = 10 << 30
    scheduler: str | None = None
    ship: Ship = "auto"
    split: bool = False

    def __post_init__(self) -> None:
        """Raise UsageError where a value is out of its range."""
        _check(self)
        if self.timeout == 0:
            raise UsageError("--timeout is 0; expected more, or no such option for no limit")
        if self.scheduler is None and (self.split or self.ship != "auto"):
            name = "--split" if self.split else "--ship"
            raise UsageError(f"{name} is for the workers of a --scheduler, which was not given; add it or omit {name}")
