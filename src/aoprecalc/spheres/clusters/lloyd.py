"""Clusters of samples around their means: algorithm 1.2.1 of *Précalcul* with its metric B, the distance to the centre.

Pairing gives every sample to the nearest centre (equation 1.2.2.3), then every centre moves to the mean of its
samples (1.2.2.4), until no sample changes its cluster. Known as Lloyd's algorithm (Lloyd, Least squares
quantization in PCM, 1982) or k-means. `pairing` makes it fast and leaves its result as it is.
"""

from dataclasses import dataclass

import numpy as np

from aoprecalc.model import Doubles
from aoprecalc.progress import Progress
from aoprecalc.spheres.clusters.pairing import Indices, Pairing


@dataclass(frozen=True, eq=False)
class Clusters:
    """Samples in groups, each around a centre. Sizes: n clusters, s samples.

    centers      (n, 3) float64: the mean of each cluster's samples
    labels       (s,) int64: the number of each sample's cluster; every cluster has samples
    distances    (s,) float64: of each sample from its cluster's centre
    iterations   how many times every sample was given to its nearest centre
    converged    the last iteration changed no sample's cluster
    """

    centers: Doubles
    labels: Indices
    distances: Doubles
    iterations: int
    converged: bool


def lloyd(points: Doubles, starts: Doubles, max_iterations: int, progress: Progress) -> Clusters:
    """Move centres to the means of the samples that are nearest to them until nothing changes.

    points           (s, 3) float64, on the grid of `sample.on_grid`: that makes the sums below exact
    starts           (n, 3) float64: the first centres; there are at least n distinct samples
    max_iterations   >= 1: stop then even if samples still change clusters

    Of equally near centres the first counts. A cluster that loses all its samples starts again from the sample
    farthest from its centre (`Pairing`). Counts its iterations as progress.
    """
    pairing = Pairing(points, starts)
    sums = _sums(points, pairing.labels, len(starts))
    iterations, converged = 1, False
    progress.advance()
    while iterations < max_iterations and not converged:
        before = pairing.labels.copy()
        pairing.follow(sums / pairing.sizes[:, None])
        changed = np.flatnonzero(pairing.labels != before)
        sums -= _sums(points[changed], before[changed], len(starts))
        sums += _sums(points[changed], pairing.labels[changed], len(starts))
        iterations, converged = iterations + 1, len(changed) == 0
        progress.advance()

    centers = sums / pairing.sizes[:, None]
    distances = np.linalg.norm(points - centers[pairing.labels], axis=1)
    return Clusters(centers, pairing.labels, distances, iterations, converged)


def _sums(points: Doubles, labels: Indices, count: int) -> Doubles:
    """(count, 3) float64: the sum of the points with each label."""
    return np.stack([np.bincount(labels, column, count) for column in points.T], axis=1)
