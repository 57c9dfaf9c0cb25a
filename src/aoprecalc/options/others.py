"""Options of `spheres`, `compare` and `batch`."""

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated, Literal

from aoprecalc.errors import ArgumentError
from aoprecalc.options.fields import BYTES, LEVELS, Option, Validated, documented, option_field

Radius = Literal["mean", "uniform", "cover"]
Init = Literal["first", "kmeans++"]
Method = Literal["lloyd", "algebraic", "shadow", "collision"]
Ship = Literal["auto", "folder", "bytes"]

_spheres = partial(Option, group="Spheres")
_samples = partial(Option, group="Samples")
_measurement = partial(Option, group="Measurement")
_run = partial(Option, group="Run")
_cache = partial(Option, group="Cache")
_cluster = partial(Option, group="Cluster")

# fmt: off
# One paragraph an option: its type, help, range, what the documentation adds, and its default.


@documented
@dataclass(frozen=True)
class SphereOptions(Validated):
    """How to fit spheres to a mesh."""

    spheres: Annotated[int, _spheres(
        "Number of spheres; exactly as many are fitted.", "-n", range=(1, 1_000_000))] = 100
    samples: Annotated[int, _samples(
        "Points drawn from the surface.", "-s", range=(1, 100_000_000),
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
        "whole surface (collision).",
        more="For soft shadows shadow is the best; lloyd and algebraic are those of the report Précalcul.")] = "lloyd"
    tolerance: Annotated[float | None, _spheres(
        "Find the smallest number of spheres whose error is at most E, instead of `spheres`.", range=(0, 1),
        metavar="E", default_text="take `spheres`", instead_of="spheres",
        more="The error is 1 - silhouette IoU for shadow and collision, the mean surface error over the "
        "diagonal for lloyd and algebraic. The number, at most 4096 and a tenth of the samples, is found by "
        "doubling and halving; one sphere less, which was tried, has a larger error.")] = None
    levels: Annotated[tuple[int, ...], _spheres(
        "Fit several sets, coarse to fine, instead of `spheres` (JSON only).", quantity=LEVELS, instead_of="spheres",
        more="Numbers of spheres, ascending, such as 8,32,128. Every sphere of a finer set names its parent in "
        "the coarser one, which lies about it but need not contain it.")] = ()

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
@dataclass(frozen=True)
class BatchOptions(Validated):
    """How to work through many meshes."""

    jobs: Annotated[int, _run(
        "Meshes at a time, each in a process of its own; 0: as many as cores and memory allow.", "-j", range=(0, 4096),
        more="0 is one a core, if there is a GiB of memory for each. Cores beyond that are shared out.")] = 0
    timeout: Annotated[float | None, _run(
        "Give up a mesh that takes longer than this.", range=(0, 10_000_000), above_min=True, unit="seconds",
        metavar="SECONDS", default_text="no limit")] = None
    retries: Annotated[int, _run(
        "Further tries for a mesh whose process died.", range=(0, 100),
        more="It may have crashed, or have been killed because memory ran out.")] = 1
    fail_fast: Annotated[bool, _run("Stop at the first failure, or go on with the others.", off="--keep-going")] = False
    force: Annotated[bool, _run("Make everything again, whatever is there already.")] = False
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
