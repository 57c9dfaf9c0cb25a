"""From a scene to spheres and what they are worth."""

from dataclasses import replace

import numpy as np

from aoprecalc.model import Doubles, Scene, SphereSet
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.fewest import fewest
from aoprecalc.spheres.fitted import Fitted
from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.levels import parents
from aoprecalc.spheres.likeness.quality import Quality, quality
from aoprecalc.spheres.methods import fitted
from aoprecalc.spheres.sample import draw

_BY_CLUSTERS = ("lloyd", "algebraic")  # methods to which options.radius and options.init apply


def fit(scene: Scene, options: SphereOptions, progress: Progress) -> tuple[SphereSet, Quality]:
    """Fit spheres to a scene.

    The same scene and options give the same spheres. Moving or scaling the mesh moves and scales its spheres, to
    within rounding (shadow, collision: to within what rounding makes of a descent).

    Returns the spheres in the mesh's coordinates, exactly as many as the options ask for, and what `quality` measures.
    With `options.levels` the spheres are of the finest one, with the others in their `coarser`.
    Raises InputError where the surface has no area or too few distinct points, AoprecalcError where no number of
    spheres that is allowed reaches `options.tolerance`.
    """
    frame = Frame.around(scene.positions)
    rng = np.random.default_rng(options.seed)
    counts = options.levels or (1 if options.tolerance is not None else options.spheres,)
    with progress.stage("samples"):
        points = draw(scene, frame, options.samples, counts[-1], rng)
    drawn = rng.bit_generator.state

    def attempt(count: int) -> Fitted:
        rng.bit_generator.state = drawn  # so that a number of spheres gives the same ones, whatever was tried before
        return fitted(scene, frame, points, count, options, rng, progress)

    with progress.stage("spheres", unit="iterations"):
        if options.tolerance is None:
            made = attempt(counts[0])
        else:
            made = fewest(scene, frame, points, attempt, options.tolerance, options.method)
        found = _sphere_set(made, frame, options)
        for count in counts[1:]:
            made = attempt(count)
            finer = _sphere_set(made, frame, options)
            found = replace(finer, coarser=found, parents=parents(finer, found))
    levels = [found]
    while levels[-1].coarser is not None:
        levels.append(levels[-1].coarser)
    for level in levels:
        if not level.converged:
            progress.warn(
                f"{scene.path}: samples still change spheres after {level.iterations} iterations; allow more of them"
            )
    with progress.stage("quality"):
        measured = quality(scene, frame, points, made.centers, made.radii)
    return found, measured


def measure(scene: Scene, centers: Doubles, radii: Doubles, options: SphereOptions, progress: Progress) -> Quality:
    """Measure spheres of any origin, (n, 3) and (n,) in the mesh's coordinates, as `quality` does.

    Of the options only `samples` and `seed` count. Raises InputError where the scene's surface has no area.
    """
    frame = Frame.around(scene.positions)
    with progress.stage("quality"):
        points = draw(scene, frame, options.samples, 1, np.random.default_rng(options.seed))
        return quality(scene, frame, points, frame.enter(centers), radii / frame.scale)


def _sphere_set(made: Fitted, frame: Frame, options: SphereOptions) -> SphereSet:
    return SphereSet(
        centers=frame.leave(made.centers),
        radii=made.radii * frame.scale,
        iterations=made.iterations,
        converged=made.converged,
        method=options.method,
        radius_rule=options.radius if options.method in _BY_CLUSTERS else "own",
        samples=options.samples,
        seed=options.seed,
        guarded=made.guarded,
    )
