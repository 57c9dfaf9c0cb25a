"""From a scene to a sphere set and its quality: the methods by name, levels of detail, and the search for a count."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aoprecalc.errors import AoprecalcError, counted
from aoprecalc.mesh.roles import finest_level
from aoprecalc.options import Method, SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.algebraic import fit_algebraic
from aoprecalc.spheres.collision import fit_collision
from aoprecalc.spheres.lloyd import Clusters, cluster_radii, initial_centers, lloyd
from aoprecalc.spheres.sampling import (
    NormalizedFrame,
    Quality,
    SphereFit,
    sample_points,
    signed_distances,
    silhouette_quality,
    sphere_quality,
)
from aoprecalc.spheres.shadow import SilhouetteTarget, fit_shadow
from aoprecalc.types import Float64Array, Int32Array, Scene, SphereSet

MAX_SPHERES = 4096  # tried by `search_count`
MIN_SAMPLES_PER_SPHERE = 10  # in `search_count`: with fewer, spheres fit single samples rather than the surface
_CHUNK_PAIRS = 1 << 20  # pairs of spheres compared at once, to bound memory
_CLUSTERING_METHODS = ("lloyd", "algebraic")  # the methods that use options.radius and options.init
_SILHOUETTE_METHODS = ("shadow", "collision")


def fit_sphere_set(scene: Scene, options: SphereOptions, progress: Progress) -> tuple[SphereSet, Quality]:
    """Fit spheres to the surface of a scene.

    The same scene and options give the same spheres. Translating or scaling the mesh does the same to its spheres,
    within rounding (shadow, collision: within what rounding errors grow to in an optimisation).

    Returns the spheres in mesh coordinates, exactly as many as the options ask for, and what `sphere_quality` computes.
    With `options.levels` these are the spheres of the finest level, which links to the others by `coarser`.
    Raises InputError if the surface has no area or too few distinct samples, AoprecalcError if no allowed number of
    spheres reaches `options.tolerance`.
    """
    scene = shown_scene(scene, options, progress)
    frame = NormalizedFrame.from_positions(scene.positions)
    rng = np.random.default_rng(options.seed)
    counts = options.levels or (1 if options.tolerance is not None else options.spheres,)
    with progress.stage("samples"):
        points = sample_points(scene, frame, options.samples, counts[-1], rng)
    state_after_sampling = rng.bit_generator.state

    def attempt(count: int) -> SphereFit:
        rng.bit_generator.state = state_after_sampling  # the result must not depend on earlier attempts
        return fit_method(scene, frame, points, count, options, rng, progress)

    with progress.stage("spheres", unit="iterations"):
        if options.tolerance is None:
            fit = attempt(counts[0])
        else:
            fit = search_count(scene, frame, points, attempt, options.tolerance, options.method)
        spheres = _sphere_set(fit, frame, options)
        levels = [spheres]
        for count in counts[1:]:
            fit = attempt(count)
            finer = _sphere_set(fit, frame, options)
            spheres = replace(finer, coarser=spheres, parents=assign_parents(finer, spheres))
            levels.append(spheres)
    for level in reversed(levels):
        if not level.converged:
            progress.warn(
                f"{scene.path}: samples still change spheres after {counted(level.iterations, 'iteration')}; "
                "raise --max-iterations"
            )
    with progress.stage("quality"):
        quality = sphere_quality(scene, frame, points, fit.centers, fit.radii)
    return spheres, quality


def shown_scene(scene: Scene, options: SphereOptions, progress: Progress) -> Scene:
    """Return what spheres stand for: the finest level of detail, without collision hulls, unless asked otherwise."""
    if options.all_parts:
        return scene
    finest, kept = finest_level(scene)
    if not kept.all():
        left_out = counted(len(scene.parts) - len(finest.parts), "part")
        progress.note(f"{left_out} left out, as collision hulls or coarser levels of detail; see --all-parts")
    return finest


def surface_samples(scene: Scene, count: int, seed: int) -> Float64Array:
    """Return the samples to which `fit_sphere_set` fits spheres, (count, 3) in mesh coordinates."""
    frame = NormalizedFrame.from_positions(scene.positions)
    return frame.from_normalized(sample_points(scene, frame, count, 1, np.random.default_rng(seed)))


def measure_quality(
    scene: Scene, centers: Float64Array, radii: Float64Array, options: SphereOptions, progress: Progress
) -> Quality:
    """Compute `sphere_quality` of any spheres, (n, 3) and (n,) in mesh coordinates.

    Of the options only `samples`, `seed` and `all_parts` are used. Raises InputError if the surface has no area.
    """
    scene = shown_scene(scene, options, progress)
    frame = NormalizedFrame.from_positions(scene.positions)
    with progress.stage("quality"):
        points = sample_points(scene, frame, options.samples, 1, np.random.default_rng(options.seed))
        return sphere_quality(scene, frame, points, frame.to_normalized(centers), radii / frame.scale)


def fit_method(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    count: int,
    options: SphereOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> SphereFit:
    """Fit `count` spheres by `options.method` to samples of the scene's surface, (s, 3) in normalised coordinates."""
    if options.method == "shadow":
        return fit_shadow(scene, frame, SilhouetteTarget.from_scene(scene, frame), points, count, rng, progress)
    if options.method == "collision":
        return fit_collision(scene, frame, points, count, rng, progress)
    initial = initial_centers(points, count, options.init, rng)
    if options.method == "lloyd":
        clusters, guarded = lloyd(points, initial, options.max_iterations, progress), 0
    else:
        fit = fit_algebraic(points, initial, options.max_iterations, progress)
        if options.radius == "mean":  # the least-squares radii: root mean square distances of samples
            return SphereFit(fit.centers, fit.radii, fit.iterations, fit.converged, fit.guarded)
        distances = np.linalg.norm(points - fit.centers[fit.labels], axis=1)
        clusters = Clusters(fit.centers, fit.labels, distances, fit.iterations, fit.converged)
        guarded = fit.guarded
    radii = cluster_radii(clusters, options.radius)
    return SphereFit(clusters.centers, radii, clusters.iterations, clusters.converged, guarded)


def search_count(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    attempt: Callable[[int], SphereFit],
    tolerance: float,
    method: Method,
) -> SphereFit:
    """Search for a small number of spheres whose error is at most `tolerance`, by doubling and then bisection.

    attempt   fits the given number of spheres by `method`

    The error is 1 - silhouette_iou for the methods shadow and collision, surface_error_mean for the others. At most
    MAX_SPHERES, and one sphere per MIN_SAMPLES_PER_SPHERE distinct samples, are tried. The error need not fall
    monotonically: the result is within the tolerance, and one sphere fewer was tried and is not.
    Raises AoprecalcError if no number of spheres that is tried is within the tolerance.
    """
    by_silhouettes = method in _SILHOUETTE_METHODS
    positions = frame.to_normalized(scene.positions)
    distinct = len(np.unique(points[: MIN_SAMPLES_PER_SPHERE * MAX_SPHERES], axis=0))
    max_count = min(MAX_SPHERES, max(1, distinct // MIN_SAMPLES_PER_SPHERE))

    def error_of(fit: SphereFit) -> float:
        if by_silhouettes:
            return 1.0 - silhouette_quality(scene, positions, fit.centers, fit.radii)["silhouette_iou"]
        distances = signed_distances(points, fit.centers, fit.radii)
        return float(np.abs(distances).mean() / (frame.diagonal or 1.0))

    too_few, count = 0, 1
    failed: list[tuple[float, int]] = []
    while (error := error_of(fit := attempt(count))) > tolerance:
        failed.append((error, count))
        if count == max_count:
            error_name = "1 - silhouette IoU" if by_silhouettes else "mean surface error"
            min_error, best_count = min(failed)
            raise AoprecalcError(
                f"{scene.path}: no number of spheres up to {max_count} has an error ({error_name}) of at most "
                f"--tolerance {tolerance:g}; the least is {min_error:.4g} with {best_count}; "
                "raise the tolerance, or try more --samples or another --method"
            )
        too_few, count = count, min(2 * count, max_count)
    while count - too_few > 1:
        middle = (too_few + count) // 2
        candidate = attempt(middle)
        if error_of(candidate) <= tolerance:
            fit, count = candidate, middle
        else:
            too_few = middle
    return fit


def assign_parents(finer: SphereSet, coarser: SphereSet) -> Int32Array:
    """Return the index of the coarser sphere that each finer sphere belongs to, (n,) int32.

    It is the one with the least signed distance from its surface to the finer sphere's centre.
    """
    parents: Int32Array = np.empty(len(finer), np.int32)
    chunk_size = max(1, _CHUNK_PAIRS // len(coarser))
    for start in range(0, len(finer), chunk_size):
        chunk = slice(start, start + chunk_size)
        offsets = finer.centers[chunk, None] - coarser.centers
        parents[chunk] = np.argmin(np.linalg.norm(offsets, axis=2) - coarser.radii, axis=1)
    return parents


def _sphere_set(fit: SphereFit, frame: NormalizedFrame, options: SphereOptions) -> SphereSet:
    return SphereSet(
        centers=frame.from_normalized(fit.centers),
        radii=fit.radii * frame.scale,
        iterations=fit.iterations,
        converged=fit.converged,
        method=options.method,
        radius_rule=options.radius if options.method in _CLUSTERING_METHODS else "own",
        samples=options.samples,
        seed=options.seed,
        guarded=fit.guarded,
    )
