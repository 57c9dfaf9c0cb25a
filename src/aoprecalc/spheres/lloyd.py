"""Gives every sample to its nearest centre, and again whenever the centres have moved, without measuring most pairs.

A sample keeps one number, its *gap*: a lower bound on how much farther than its own centre every other centre is.
When centres move, the gap shrinks by at most as much as they moved, and only the samples whose gap is used up are
measured again, against the centres around their own one.
Based on: Hamerly, Making k-means even faster, 2010 (one bound a sample); Ryšavý and Hamerly, Geometric methods to
accelerate k-means algorithms, 2016 (only the movement of centres nearby counts).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.options import Init, Radius
from aoprecalc.progress import Progress
from aoprecalc.types import Float64Array, Int64Array

_LISTED = 12  # centres in a neighbourhood: on a surface, the 6 around the own one and most of the next ring
_REFRESH = 16  # movements of the centres after which the clusters' reach is measured instead of bounded
_BLOCK = 1 << 17  # samples or pairs looked at together, so that memory beyond the state stays small
_ROUNDING = 1e-9  # more than the gaps' rounding errors sum up to in a million movements, for points in [-1, 1]
_TIE = 1e-14  # relative difference below which two distances may be one and the same, computed in two ways


class NearestCenters:
    """Samples, centres, and which centre is nearest to which sample; of equally near ones the first.

    labels   (s,) int64: the number of each sample's cluster
    sizes    (n,) int64: samples in each cluster, all >= 1
    """

    def __init__(self, points: Float64Array, centers: Float64Array) -> None:
        """Pair samples, (s, 3) in [-1, 1] with at least n distinct ones, with centres, (n, 3)."""
        self._columns = np.ascontiguousarray(points.T)
        self._centers = centers
        self.labels, nearest, second = two_nearest(points, centers, cKDTree(centers))
        self._gaps = second - nearest
        self._reach = max_per_label(nearest, self.labels, len(centers))  # (n,) bounds the distances in a cluster
        self._until_refresh = _REFRESH
        self._fill_empty()

    def update(self, centers: Float64Array) -> None:
        """Pair the samples again, now that the centres are at `centers`, (n, 3) float64."""
        moved = np.sqrt(_squares(*(centers - self._centers).T))
        self._centers = centers
        self._update_reach(moved)

        around = _Neighbourhoods(centers)
        moved_around = around.greatest_other(moved)
        floor = around.radius - 2 * self._reach  # the gap to any centre beyond the neighbourhood, however it got there
        for start in range(0, len(self.labels), _BLOCK):
            block = slice(start, start + _BLOCK)
            labels, gaps = self.labels[block], self._gaps[block]
            gaps -= moved[labels]
            local = np.minimum(gaps - moved_around[labels], floor[labels])
            np.maximum(gaps - moved.max(), local, out=gaps)
            self._measure(start + np.flatnonzero(gaps <= _ROUNDING), around)
        self._fill_empty()

    def _update_reach(self, moved: Float64Array) -> None:
        self._until_refresh -= 1
        if self._until_refresh > 0:
            self._reach += moved
            return
        self._reach = max_per_label(self._distances(), self.labels, len(moved))
        self._until_refresh = _REFRESH

    def _measure(self, rows: Int64Array, around: "_Neighbourhoods") -> None:
        """Find the nearest centres of the samples `rows` afresh."""
        before = self.labels[rows]
        labels, nearest, second = around.two_nearest(np.take(self._columns, rows, axis=1), before)
        self.labels[rows], self._gaps[rows] = labels, second - nearest
        joined = np.flatnonzero(labels != before)
        np.maximum.at(self._reach, labels[joined], nearest[joined])

    def _fill_empty(self) -> None:
        """Give every cluster without samples one to start again from: the farthest from its centre that can be spared.

        Clusters in ascending order; among equally far samples the first; never the last sample of a cluster, and
        no place twice. What is given was not at its centre, so the inertia falls and the iteration still ends.
        """
        self.sizes = np.bincount(self.labels, minlength=len(self._centers))
        empty = np.flatnonzero(self.sizes == 0)[::-1].tolist()
        if not empty:
            return
        taken: set[bytes] = set()
        for row in np.argsort(-self._distances(), kind="stable"):
            place = self._columns[:, row].tobytes()
            if self.sizes[self.labels[row]] == 1 or place in taken:
                continue
            taken.add(place)
            self.sizes[self.labels[row]] -= 1
            self.labels[row] = empty.pop()
            self.sizes[self.labels[row]] = 1
            self._gaps[row] = 0
            if not empty:
                break
        self._until_refresh = 0  # a given sample may be far from where its new cluster's centre was

    def _distances(self) -> Float64Array:
        """(s,) float64: of every sample from its centre."""
        return np.sqrt(_squares(*(self._columns - np.take(self._centers, self.labels, axis=0).T)))


class _Neighbourhoods:
    """Around each of n centres the m nearest to it, itself among them.

    members   (m, n) int64: column c lists the neighbourhood of centre c
    radius    (n,) float64: every centre that is not listed is at least this far from c; infinite if all are
    """

    def __init__(self, centers: Float64Array) -> None:
        self._centers = centers
        self._tree = cKDTree(centers)
        distances, members = _query(self._tree, centers, _LISTED + 1)
        self.members = np.ascontiguousarray(members[:, : min(_LISTED, len(centers))].T)
        self.radius = distances[:, _LISTED]
        self._places = np.ascontiguousarray(centers[self.members].transpose(0, 2, 1))  # (m, 3, n)

    def greatest_other(self, values: Float64Array) -> Float64Array:
        """(n,) float64: the greatest of the values, (n,) >= 0, in each neighbourhood but for the centre's own."""
        own = self.members == np.arange(len(values))
        return np.asarray(np.where(own, 0.0, values[self.members]).max(axis=0), np.float64)

    def two_nearest(self, columns: Float64Array, labels: Int64Array) -> tuple[Int64Array, Float64Array, Float64Array]:
        """Do as the function `nearest_two`, for points given as (3, k), looking around the centres `labels` first.

        The second distance is a lower bound where the second nearest centre may lie beyond the neighbourhood.
        """
        first, second = np.full(len(labels), np.inf), np.full(len(labels), np.inf)
        member = np.zeros(len(labels), np.intp)
        for k, places in enumerate(self._places):
            squared = _squares(*(np.take(places, labels, axis=1) - columns))
            np.copyto(member, k, where=squared < first)
            np.minimum(second, np.maximum(first, squared), out=second)
            np.minimum(first, squared, out=first)
        found = self.members[member, labels]

        # By the triangle inequality, centres beyond the neighbourhood are at least this far.
        beyond = self.radius[labels] - np.sqrt(_squares(*(columns - np.take(self._centers, labels, axis=0).T)))
        first, second = np.sqrt(first), np.minimum(np.sqrt(second), beyond)
        unsure = np.flatnonzero(second <= first * (1 + _TIE))
        if len(unsure):
            points = columns[:, unsure].T
            found[unsure], first[unsure], second[unsure] = two_nearest(points, self._centers, self._tree)
        return found, first, second


def two_nearest(
    points: Float64Array, centers: Float64Array, tree: cKDTree
) -> tuple[Int64Array, Float64Array, Float64Array]:
    """Find the nearest centre of each point, and how far it and the second nearest are.

    points (k, 3) float64, centers (n, 3) float64, tree: of the centres.
    Returns (k,) int64, of equally near centres the first; (k,) float64; (k,) float64, infinite if n = 1.
    """
    distances, indices = _query(tree, points, 2)
    first, second, labels = distances[:, 0], distances[:, 1], indices[:, 0]
    tied = np.flatnonzero(second <= first * (1 + _TIE))  # a tree gives equally near centres in no defined order
    size = max(1, _BLOCK // len(centers))
    for start in range(0, len(tied), size):
        rows = tied[start : start + size]
        labels[rows] = _squares(*(points[rows].T[:, :, None] - centers.T[:, None, :])).argmin(axis=1)
    return labels, first, second


def max_per_label(values: Float64Array, labels: Int64Array, count: int) -> Float64Array:
    """(count,) float64: the greatest of the values, (s,) >= 0, with each label, (s,); 0 where there are none."""
    found = np.zeros(count)
    np.maximum.at(found, labels, values)
    return found


def _query(tree: cKDTree, points: Float64Array, count: int) -> tuple[Float64Array, Int64Array]:
    """(k, count) distances and indices of the nearest; infinite, and beyond the last, where there are fewer."""
    distances, indices = tree.query(points, k=list(range(1, count + 1)))
    return np.asarray(distances, np.float64), np.asarray(indices, np.intp)


def _squares(x: Float64Array, y: Float64Array, z: Float64Array) -> Float64Array:
    return x * x + y * y + z * z


# Clusters of samples around their means: algorithm 1.2.1 of *Précalcul* with its metric B, the distance to the centre.
#
# Pairing gives every sample to the nearest centre (equation 1.2.2.3), then every centre moves to the mean of its
# samples (1.2.2.4), until no sample changes its cluster. Known as Lloyd's algorithm (Lloyd, Least squares
# quantization in PCM, 1982) or k-means. `pairing` makes it fast and leaves its result as it is.


@dataclass(frozen=True, eq=False)
class Clusters:
    """Samples in groups, each around a centre. Sizes: n clusters, s samples.

    centers      (n, 3) float64: the mean of each cluster's samples
    labels       (s,) int64: the number of each sample's cluster; every cluster has samples
    distances    (s,) float64: of each sample from its cluster's centre
    iterations   how many times every sample was given to its nearest centre
    converged    the last iteration changed no sample's cluster
    """

    centers: Float64Array
    labels: Int64Array
    distances: Float64Array
    iterations: int
    converged: bool


def lloyd(points: Float64Array, starts: Float64Array, max_iterations: int, progress: Progress) -> Clusters:
    """Move centres to the means of the samples that are nearest to them until nothing changes.

    points           (s, 3) float64, on the grid of `sample.on_grid`: that makes the sums below exact
    starts           (n, 3) float64: the first centres; there are at least n distinct samples
    max_iterations   >= 1: stop then even if samples still change clusters

    Of equally near centres the first counts. A cluster that loses all its samples starts again from the sample
    farthest from its centre (`Pairing`). Counts its iterations as progress.
    """
    pairing = NearestCenters(points, starts)
    sums = _sums(points, pairing.labels, len(starts))
    iterations, converged = 1, False
    progress.advance()
    while iterations < max_iterations and not converged:
        before = pairing.labels.copy()
        pairing.update(sums / pairing.sizes[:, None])
        changed = np.flatnonzero(pairing.labels != before)
        sums -= _sums(points[changed], before[changed], len(starts))
        sums += _sums(points[changed], pairing.labels[changed], len(starts))
        iterations, converged = iterations + 1, len(changed) == 0
        progress.advance()

    centers = sums / pairing.sizes[:, None]
    distances = np.linalg.norm(points - centers[pairing.labels], axis=1)
    return Clusters(centers, pairing.labels, distances, iterations, converged)


def _sums(points: Float64Array, labels: Int64Array, count: int) -> Float64Array:
    """(count, 3) float64: the sum of the points with each label."""
    return np.stack([np.bincount(labels, column, count) for column in points.T], axis=1)


# How large the sphere of a cluster is.


def cluster_radii(clusters: Clusters, rule: Radius) -> Float64Array:
    """Choose a radius for each cluster, from the distances |p - c| of samples p from their centre c.

    mean      each cluster's mean of |p - c| (equation 1.2.2.4 of *Précalcul*)
    uniform   one for all: the mean of |p - c| over all samples
    cover     each cluster's greatest |p - c|, so that the spheres hold every sample

    Returns (n,) float64 in the unit of the distances; 0 for a cluster that is a single point, unless uniform.
    """
    count = len(clusters.centers)
    if rule == "uniform":
        return np.full(count, clusters.distances.mean())
    if rule == "cover":
        return max_per_label(clusters.distances, clusters.labels, count)
    return np.bincount(clusters.labels, clusters.distances) / np.bincount(clusters.labels)


# The centres that the iteration starts from.


def initial_centers(points: Float64Array, count: int, init: Init, rng: np.random.Generator) -> Float64Array:
    """Choose `count` of the samples, (s, 3) float64 with at least that many distinct ones, as the first centres.

    first      the first samples (algorithm 1.2.1 of *Précalcul*)
    kmeans++   one at random, then each with a probability in proportion to its squared distance to the nearest
               one chosen so far (Arthur and Vassilvitskii, k-means++: the advantages of careful seeding, 2007)

    Returns (count, 3) float64.
    """
    return points[:count].copy() if init == "first" else _spread(points, count, rng)


def _spread(points: Float64Array, count: int, rng: np.random.Generator) -> Float64Array:
    columns = np.ascontiguousarray(points.T)
    chosen = [int(rng.integers(len(points)))]
    squared = np.full(len(points), np.inf)
    for dart in rng.random(count - 1):
        x, y, z = columns - points[chosen[-1], :, None]
        np.minimum(squared, x * x + y * y + z * z, out=squared)
        upto = np.cumsum(squared)
        chosen.append(int(np.searchsorted(upto, min(dart * upto[-1], np.nextafter(upto[-1], 0)), side="right")))
    return points[chosen]
