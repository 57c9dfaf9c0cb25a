"""Sphere sets of several finenesses, one above the other."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.options import Method, SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.algebraic import fit_algebraic
from aoprecalc.spheres.collision import fit_collision
from aoprecalc.spheres.fitted import SphereFit
from aoprecalc.spheres.lloyd import Clusters, cluster_radii, initial_centers, lloyd
from aoprecalc.spheres.metrics import Quality, signed_distances, silhouette_quality, sphere_quality
from aoprecalc.spheres.sampling import NormalizedFrame, sample_surface
from aoprecalc.spheres.shadow import SilhouetteTarget, fit_shadow
from aoprecalc.types import Float64Array, Int32Array, Scene, SphereSet

_MOST = 1 << 20  # pairs that are measured at a time: bounds memory


def assign_parents(finer: SphereSet, coarser: SphereSet) -> Int32Array:
    """Return the number of the coarser sphere that each finer one belongs to, (n,) int32.

    That is the one whose surface is nearest to the finer sphere's centre, or lies farthest beyond it.
    """
    found: Int32Array = np.empty(len(finer), np.int32)
    block = max(1, _MOST // len(coarser))
    for start in range(0, len(finer), block):
        aside = finer.centers[start : start + block, None] - coarser.centers
        found[start : start + block] = np.argmin(np.linalg.norm(aside, axis=2) - coarser.radii, axis=1)
    return found


# As few spheres as are good enough.

MAX_SPHERES = 4096
MIN_SAMPLES_PER_SPHERE = 10  # that each sphere has at least: fewer would be fitted, not stood for


def search_count(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    attempt: Callable[[int], SphereFit],
    tolerance: float,
    method: Method,
) -> SphereFit:
    """Return a fit whose error is at most `tolerance`, of few spheres: at most MAX_SPHERES, and a tenth of the samples.

    attempt   fits as many spheres, in the frame, by `method`

    The error is 1 - silhouette_iou for the methods shadow and collision, surface_error_mean for others. It need not
    fall with every sphere: what is found is good enough, and one sphere less, which was tried, is not.
    Raises AoprecalcError where no number of spheres will do.
    """
    by_silhouettes = method in ("shadow", "collision")
    positions = frame.to_normalized(scene.positions)
    most = min(
        MAX_SPHERES,
        max(1, len(np.unique(points[: MIN_SAMPLES_PER_SPHERE * MAX_SPHERES], axis=0)) // MIN_SAMPLES_PER_SPHERE),
    )

    def error(made: SphereFit) -> float:
        if by_silhouettes:
            return 1.0 - silhouette_quality(scene, positions, made.centers, made.radii)["silhouette_iou"]
        away = signed_distances(points, made.centers, made.radii)
        return float(np.abs(away).mean() / (frame.diagonal or 1.0))

    too_few, count = 0, 1
    failed: list[tuple[float, int]] = []
    while (found := error(made := attempt(count))) > tolerance:
        failed.append((found, count))
        if count == most:
            kind = "1 - silhouette IoU" if by_silhouettes else "mean surface error"
            least, by = min(failed)
            raise AoprecalcError(
                f"{scene.path}: no number of spheres up to {most} was found with an error of --tolerance {tolerance:g} "
                f"({kind}), the least was {least:.4g} with {by}; allow that, or use more --samples or another --method"
            )
        too_few, count = count, min(2 * count, most)
    while count - too_few > 1:
        middle = (too_few + count) // 2
        tried = attempt(middle)
        if error(tried) <= tolerance:
            made, count = tried, middle
        else:
            too_few = middle
    return made


# The ways to fit spheres to samples of a surface, by the names that options give them.


def fit_method(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    count: int,
    options: SphereOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> SphereFit:
    """Fit `count` spheres, in the frame, by `options.method`; points: (s, 3) samples of the scene's surface in it."""
    if options.method == "shadow":
        return fit_shadow(scene, frame, SilhouetteTarget.of(scene, frame), points, count, rng, progress)
    if options.method == "collision":
        return fit_collision(scene, frame, points, count, rng, progress)
    first = initial_centers(points, count, options.init, rng)
    if options.method == "algebraic":
        fit = fit_algebraic(points, first, options.max_iterations, progress)
        if options.radius == "mean":  # the fit's own: the root mean square distance of a sphere's samples
            return SphereFit(fit.centers, fit.radii, fit.iterations, fit.converged, fit.guarded)
        distances = np.linalg.norm(points - fit.centers[fit.labels], axis=1)
        clusters = Clusters(fit.centers, fit.labels, distances, fit.iterations, fit.converged)
        return SphereFit(
            fit.centers, cluster_radii(clusters, options.radius), fit.iterations, fit.converged, fit.guarded
        )
    clusters = lloyd(points, first, options.max_iterations, progress)
    return SphereFit(clusters.centers, cluster_radii(clusters, options.radius), clusters.iterations, clusters.converged)


# From a scene to spheres and what they are worth.

_BY_CLUSTERS = ("lloyd", "algebraic")  # methods to which options.radius and options.init apply


def fit_sphere_set(scene: Scene, options: SphereOptions, progress: Progress) -> tuple[SphereSet, Quality]:
    """Fit spheres to a scene.

    The same scene and options give the same spheres. Moving or scaling the mesh moves and scales its spheres, to
    within rounding (shadow, collision: to within what rounding makes of a descent).

    Returns the spheres in the mesh's coordinates, exactly as many as the options ask for, and what `quality` measures.
    With `options.levels` the spheres are of the finest one, with the others in their `coarser`.
    Raises InputError where the surface has no area or too few distinct points, AoprecalcError where no number of
    spheres that is allowed reaches `options.tolerance`.
    """
    frame = NormalizedFrame.from_positions(scene.positions)
    rng = np.random.default_rng(options.seed)
    counts = options.levels or (1 if options.tolerance is not None else options.spheres,)
    with progress.stage("samples"):
        points = sample_surface(scene, frame, options.samples, counts[-1], rng)
    drawn = rng.bit_generator.state

    def attempt(count: int) -> SphereFit:
        rng.bit_generator.state = drawn  # so that a number of spheres gives the same ones, whatever was tried before
        return fit_method(scene, frame, points, count, options, rng, progress)

    with progress.stage("spheres", unit="iterations"):
        if options.tolerance is None:
            made = attempt(counts[0])
        else:
            made = search_count(scene, frame, points, attempt, options.tolerance, options.method)
        found = _sphere_set(made, frame, options)
        for count in counts[1:]:
            made = attempt(count)
            finer = _sphere_set(made, frame, options)
            found = replace(finer, coarser=found, parents=assign_parents(finer, found))
    levels = [found]
    while levels[-1].coarser is not None:
        levels.append(levels[-1].coarser)
    for level in levels:
        if not level.converged:
            progress.warn(
                f"{scene.path}: samples still change spheres after {level.iterations} iterations; allow more of them"
            )
    with progress.stage("quality"):
        measured = sphere_quality(scene, frame, points, made.centers, made.radii)
    return found, measured


def measure_quality(
    scene: Scene, centers: Float64Array, radii: Float64Array, options: SphereOptions, progress: Progress
) -> Quality:
    """Measure spheres of any origin, (n, 3) and (n,) in the mesh's coordinates, as `quality` does.

    Of the options only `samples` and `seed` count. Raises InputError where the scene's surface has no area.
    """
    frame = NormalizedFrame.from_positions(scene.positions)
    with progress.stage("quality"):
        points = sample_surface(scene, frame, options.samples, 1, np.random.default_rng(options.seed))
        return sphere_quality(scene, frame, points, frame.to_normalized(centers), radii / frame.scale)


def _sphere_set(made: SphereFit, frame: NormalizedFrame, options: SphereOptions) -> SphereSet:
    return SphereSet(
        centers=frame.from_normalized(made.centers),
        radii=made.radii * frame.scale,
        iterations=made.iterations,
        converged=made.converged,
        method=options.method,
        radius_rule=options.radius if options.method in _BY_CLUSTERS else "own",
        samples=options.samples,
        seed=options.seed,
        guarded=made.guarded,
    )
