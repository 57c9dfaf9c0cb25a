"""The ways to fit spheres to samples of a surface, by the names that options give them."""

import numpy as np

from aoprecalc.model import Doubles, Scene
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres.clusters.algebraic import algebraic
from aoprecalc.spheres.clusters.lloyd import Clusters, lloyd
from aoprecalc.spheres.clusters.radius import radii
from aoprecalc.spheres.clusters.starts import starts
from aoprecalc.spheres.descent.collision import collision
from aoprecalc.spheres.descent.shadow import Target, shadow
from aoprecalc.spheres.fitted import Fitted
from aoprecalc.spheres.frame import Frame


def fitted(
    scene: Scene,
    frame: Frame,
    points: Doubles,
    count: int,
    options: SphereOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> Fitted:
    """Fit `count` spheres, in the frame, by `options.method`; points: (s, 3) samples of the scene's surface in it."""
    if options.method == "shadow":
        return shadow(scene, frame, Target.of(scene, frame), points, count, rng, progress)
    if options.method == "collision":
        return collision(scene, frame, points, count, rng, progress)
    first = starts(points, count, options.init, rng)
    if options.method == "algebraic":
        fit = algebraic(points, first, options.max_iterations, progress)
        if options.radius == "mean":  # the fit's own: the root mean square distance of a sphere's samples
            return Fitted(fit.centers, fit.radii, fit.iterations, fit.converged, fit.guarded)
        distances = np.linalg.norm(points - fit.centers[fit.labels], axis=1)
        clusters = Clusters(fit.centers, fit.labels, distances, fit.iterations, fit.converged)
        return Fitted(fit.centers, radii(clusters, options.radius), fit.iterations, fit.converged, fit.guarded)
    clusters = lloyd(points, first, options.max_iterations, progress)
    return Fitted(clusters.centers, radii(clusters, options.radius), clusters.iterations, clusters.converged)
