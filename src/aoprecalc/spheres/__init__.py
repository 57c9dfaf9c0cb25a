"""Decomposition of a surface into spheres (section 1.2 of *Précalcul*): sample, cluster, choose radii, measure.

NumPy and SciPy only.
"""

import numpy as np

from aoprecalc.model import Scene, SphereSet
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.lloyd import lloyd
from aoprecalc.spheres.quality import Quality, quality
from aoprecalc.spheres.radius import radii
from aoprecalc.spheres.sample import draw
from aoprecalc.spheres.starts import starts

__all__ = ["Quality", "fit"]


def fit(scene: Scene, options: SphereOptions, progress: Progress) -> tuple[SphereSet, Quality]:
    """Fit spheres to the surface of a scene.

    The same scene and options give the same spheres. Moving or scaling the mesh moves and scales its spheres, to
    within rounding.

    Returns the spheres in the mesh's coordinates, exactly `options.spheres` of them, and what `quality` measures.
    Raises InputError where the surface has no area or too few distinct points.
    """
    frame = Frame.around(scene.positions)
    rng = np.random.default_rng(options.seed)
    with progress.stage("samples"):
        points = draw(scene, frame, options.samples, options.spheres, rng)
    with progress.stage("spheres", unit="iterations"):
        first = starts(points, options.spheres, options.init, rng)
        clusters = lloyd(points, first, options.max_iterations, progress)
    if not clusters.converged:
        progress.warn(
            f"{scene.path}: samples still change spheres after {clusters.iterations} iterations; allow more of them"
        )
    with progress.stage("quality"):
        chosen = radii(clusters, options.radius)
        measured = quality(points, clusters, chosen, frame)
    spheres = SphereSet(
        centers=frame.leave(clusters.centers),
        radii=chosen * frame.scale,
        iterations=clusters.iterations,
        converged=clusters.converged,
        method="lloyd",
        radius_rule=options.radius,
        samples=options.samples,
        seed=options.seed,
    )
    return spheres, measured
