"""Options of `spheres`, `compare` and `batch`."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from aoprecalc.errors import ArgumentError
from aoprecalc.options.fields import BYTES, LEVELS, Option, Validated, documented, option_field

Radius = Literal["mean", "uniform", "cover"]
Init = Literal["first", "kmeans++"]
Method = Literal["lloyd", "algebraic", "shadow", "collision"]
Ship = Literal["auto", "folder", "bytes"]


@documented
@dataclass(frozen=True)
class SphereOptions(Validated):
    """How to fit spheres to a mesh."""

    spheres: Annotated[
        int,
        Option("Number of spheres; exactly as many are fitted.", short="-n", group="Spheres", range=(1, 1_000_000)),
    ] = 100
    samples: Annotated[
        int,
        Option(
            "Points drawn from the surface.",
            short="-s",
            more="There must be at least as many as spheres.",
            group="Samples",
            range=(1, 100_000_000),
        ),
    ] = 100_000
    seed: Annotated[
        int, Option("Seed of the samples and of every random choice.", group="Samples", range=(0, 2**32 - 1))
    ] = 0
    radius: Annotated[
        Radius,
        Option(
            "mean or largest (cover) distance of a sphere's samples, or one mean for all (uniform).",
            more="For lloyd and algebraic; the mean is the root mean square for algebraic.",
            group="Spheres",
        ),
    ] = "mean"
    init: Annotated[
        Init,
        Option(
            "Start at the first samples, or at samples that are far apart (kmeans++).",
            more="For lloyd and algebraic.",
            group="Spheres",
        ),
    ] = "first"
    max_iterations: Annotated[
        int,
        Option(
            "Stop after this many iterations even if not converged.",
            more='For lloyd and algebraic; a warning says so, and `"converged"` is false.',
            group="Spheres",
            range=(1, 1_000_000),
        ),
    ] = 1000
    method: Annotated[
        Method,
        Option(
            "Cluster means (lloyd), least squares (algebraic), best silhouettes (shadow), or spheres that contain the "
            "whole surface (collision).",
            more="For soft shadows shadow is the best; lloyd and algebraic are the source's.",
            group="Spheres",
        ),
    ] = "lloyd"
    tolerance: Annotated[
        float | None,
        Option(
            "Find the smallest number of spheres whose error is at most E, instead of `spheres`.",
            more="The error is 1 - silhouette IoU for shadow and collision, the mean surface error over the diagonal "
            "for lloyd and algebraic. The number, at most 4096 and a tenth of the samples, is found by doubling and "
            "halving; one sphere less, which was tried, has a larger error.",
            group="Spheres",
            range=(0, 1),
            metavar="E",
            default_text="take `spheres`",
            instead_of="spheres",
        ),
    ] = None
    levels: Annotated[
        tuple[int, ...],
        Option(
            "Fit several sets, coarse to fine, instead of `spheres` (JSON only).",
            more="Numbers of spheres, ascending, such as 8,32,128. Every sphere of a finer set names its parent in the "
            "coarser one, which lies about it but need not contain it.",
            group="Spheres",
            quantity=LEVELS,
            instead_of="spheres",
        ),
    ] = ()

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
    """How to compare two results."""

    tolerance: Annotated[
        float,
        Option(
            "Largest difference that passes; beyond it the exit code is 1.",
            more="The outputs stay. The default is less than an eye sees, and leaves room for another version of Mesa.",
            group="Measurement",
            range=(0, 1),
            metavar="E",
        ),
    ] = 0.005


@documented
@dataclass(frozen=True)
class BatchOptions(Validated):
    """How to work through many meshes."""

    jobs: Annotated[
        int,
        Option(
            "Meshes at a time, each in a process of its own; 0: by the cores and the memory.",
            short="-j",
            more="0 is one a core, if there is a GiB of memory for each. Cores beyond that are shared out.",
            group="Run",
            range=(0, 4096),
        ),
    ] = 0
    timeout: Annotated[
        float | None,
        Option(
            "Give up a mesh that takes longer than this.",
            group="Run",
            range=(0, 10_000_000),
            above_min=True,
            unit="seconds",
            metavar="SECONDS",
            default_text="no limit",
        ),
    ] = None
    retries: Annotated[
        int,
        Option(
            "Further tries for a mesh whose process died.",
            more="It may have crashed, or have been killed because memory ran out.",
            group="Run",
            range=(0, 100),
        ),
    ] = 1
    fail_fast: Annotated[
        bool, Option("Stop at the first failure, or go on with the others.", group="Run", off="--keep-going")
    ] = False
    force: Annotated[bool, Option("Make everything again, whatever is there already.", group="Run")] = False
    prune: Annotated[
        bool,
        Option(
            "Remove what earlier batches made of meshes that are no longer among these.",
            more="Files that were changed since stay.",
            group="Run",
        ),
    ] = False
    cache_size: Annotated[
        int,
        Option(
            "Prune the cache to this size, least recently used results first.",
            more="This happens after a batch that added to it, every ten minutes at most.",
            group="Cache",
            range=(1, 1 << 50),
            unit="bytes",
            quantity=BYTES,
            default_text="10G",
        ),
    ] = 10 << 30
    scheduler: Annotated[
        str | None,
        Option(
            "Work on the Dask cluster of this scheduler, such as tcp://host:8786.",
            group="Cluster",
            metavar="ADDRESS",
            default_text="work on this machine",
        ),
    ] = None
    ship: Annotated[
        Ship,
        Option(
            "How files get to the workers and back: through a folder that they share, or as bytes over the network.",
            more="auto: folder, if all workers see the output folder under the same path.",
            group="Cluster",
        ),
    ] = "auto"
    split: Annotated[
        bool,
        Option("Divide the visibility of each bake among the workers, one mesh after the other.", group="Cluster"),
    ] = False

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
