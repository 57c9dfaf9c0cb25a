"""Clusters of samples around their means: algorithm 1.2.1 of *Précalcul* with its metric B, the centre distance.

Every sample is assigned to the nearest centre (equation 1.2.2.3), then every centre moves to the mean of its samples
(equation 1.2.2.4), until no sample changes its cluster. This is Lloyd's algorithm (Lloyd, Least squares quantization in
PCM, 1982), or k-means. `NearestCenters` accelerates the assignment without changing its result.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.options import Init, Radius
from aoprecalc.progress import Progress
from aoprecalc.types import Float64Array, Int64Array

_NEIGHBOURS = 12  # centres in a neighbourhood: on a surface, the centre itself, 6 around it and most of the next ring
_REFRESH_INTERVAL = 16  # updates after which cluster extents are computed exactly instead of bounded
_CHUNK_SIZE = 1 << 17  # samples or pairs processed at once, to bound temporary memory
_GAP_ROUNDING = 1e-9  # exceeds the accumulated rounding error of gaps in a million updates, for points in [-1, 1]
_TIE_TOLERANCE = 1e-14  # relative difference of two distances that may be equal but for rounding


@dataclass(frozen=True, eq=False)
class Clusters:
    """Samples grouped around centres. Sizes: n clusters, s samples.

    centers      (n, 3) float64: the mean of each cluster's samples
    labels       (s,) int64: cluster index of each sample; no cluster is empty
    distances    (s,) float64: distance of each sample from the centre of its cluster
    iterations   how many times all samples were assigned to their nearest centres
    converged    the last iteration reassigned no sample
    """

    centers: Float64Array
    labels: Int64Array
    distances: Float64Array
    iterations: int
    converged: bool


def lloyd(points: Float64Array, initial: Float64Array, max_iterations: int, progress: Progress) -> Clusters:
    """Cluster samples by Lloyd's algorithm.

    points           (s, 3) float64, rounded by `sampling.round_to_grid`, which makes the sums below exact
    initial          (n, 3) float64: the initial centres; at least n of the points are distinct
    max_iterations   >= 1: stop then even if samples still change clusters

    Ties go to the centre with the lower index. An empty cluster restarts from the sample farthest from its centre (see
    `NearestCenters`). Each iteration advances `progress` by one.
    """
    nearest = NearestCenters(points, initial)
    sums = _sum_per_label(points, nearest.labels, len(initial))
    iterations, converged = 1, False
    progress.advance()
    while iterations < max_iterations and not converged:
        before = nearest.labels.copy()
        nearest.update(sums / nearest.sizes[:, None])
        changed = np.flatnonzero(nearest.labels != before)
        sums -= _sum_per_label(points[changed], before[changed], len(initial))
        sums += _sum_per_label(points[changed], nearest.labels[changed], len(initial))
        iterations, converged = iterations + 1, len(changed) == 0
        progress.advance()

    centers = sums / nearest.sizes[:, None]
    distances = np.linalg.norm(points - centers[nearest.labels], axis=1)
    return Clusters(centers, nearest.labels, distances, iterations, converged)


def cluster_radii(clusters: Clusters, rule: Radius) -> Float64Array:
    """Return the sphere radius of each cluster, (n,) float64, from the distances |p - c| of its samples.

    mean      each cluster's mean of |p - c| (*Précalcul*, equation 1.2.2.4)
    uniform   the same for all clusters: the mean of |p - c| over all samples
    cover     each cluster's maximum of |p - c|, so that the spheres contain every sample

    The radius of a cluster that is a single point is 0, unless uniform.
    """
    count = len(clusters.centers)
    if rule == "uniform":
        return np.full(count, clusters.distances.mean())
    if rule == "cover":
        return max_per_label(clusters.distances, clusters.labels, count)
    return np.bincount(clusters.labels, clusters.distances) / np.bincount(clusters.labels)


def initial_centers(points: Float64Array, count: int, init: Init, rng: np.random.Generator) -> Float64Array:
    """Choose `count` of the samples, (s, 3) float64 with at least that many distinct ones, as initial centres.

    first      the first samples (*Précalcul*, algorithm 1.2.1)
    kmeans++   one at random, then each with a probability proportional to its squared distance from the nearest centre
               so far (Arthur and Vassilvitskii, k-means++: the advantages of careful seeding, 2007)

    Returns (count, 3) float64.
    """
    if init == "first":
        return points[:count].copy()
    columns = np.ascontiguousarray(points.T)
    chosen = [int(rng.integers(len(points)))]
    squared = np.full(len(points), np.inf)
    for quantile in rng.random(count - 1):
        np.minimum(squared, _squared_norms(columns - points[chosen[-1], :, None]), out=squared)
        cumulative = np.cumsum(squared)
        target = min(quantile * cumulative[-1], np.nextafter(cumulative[-1], 0))
        chosen.append(int(np.searchsorted(cumulative, target, side="right")))
    return points[chosen]


class NearestCenters:
    """The nearest centre of every sample, kept up to date while the centres move.

    Each sample has a *gap*: a lower bound on how much farther than its own centre every other centre is. When centres
    move, the gap shrinks by at most the sum of the movements, and only the samples whose gap is used up need new
    distances, to the centres around their own.
    Based on: Hamerly, Making k-means even faster, 2010 (one bound per sample); Ryšavý and Hamerly, Geometric methods to
    accelerate k-means algorithms, 2016 (only the movement of neighbouring centres counts).

    labels   (s,) int64: index of each sample's nearest centre, the lowest index among equally near ones
    sizes    (n,) int64: number of samples in each cluster, all >= 1
    """

    def __init__(self, points: Float64Array, centers: Float64Array) -> None:
        """Assign samples, (s, 3) in [-1, 1] with at least n distinct ones, to centres, (n, 3)."""
        self._columns = np.ascontiguousarray(points.T)
        self._centers = centers
        self.labels, nearest, second = two_nearest(points, centers, cKDTree(centers))
        self._gaps = second - nearest
        self._extents = max_per_label(nearest, self.labels, len(centers))  # (n,): bounds of distances in each cluster
        self._until_refresh = _REFRESH_INTERVAL
        self._fill_empty()

    def update(self, centers: Float64Array) -> None:
        """Reassign the samples after the centres have moved to `centers`, (n, 3) float64."""
        moved = np.sqrt(_squared_norms((centers - self._centers).T))
        self._centers = centers
        self._update_extents(moved)

        neighbourhoods = _Neighbourhoods(centers)
        moved_nearby = neighbourhoods.max_of_others(moved)
        # Lower bound of the gap to any centre outside the neighbourhood, wherever that centre came from.
        outside = neighbourhoods.radius - 2 * self._extents
        for start in range(0, len(self.labels), _CHUNK_SIZE):
            chunk = slice(start, start + _CHUNK_SIZE)
            labels, gaps = self.labels[chunk], self._gaps[chunk]
            gaps -= moved[labels]
            local = np.minimum(gaps - moved_nearby[labels], outside[labels])
            np.maximum(gaps - moved.max(), local, out=gaps)
            self._reassign(start + np.flatnonzero(gaps <= _GAP_ROUNDING), neighbourhoods)
        self._fill_empty()

    def _update_extents(self, moved: Float64Array) -> None:
        self._until_refresh -= 1
        if self._until_refresh > 0:
            self._extents += moved
            return
        self._extents = max_per_label(self._distances(), self.labels, len(moved))
        self._until_refresh = _REFRESH_INTERVAL

    def _reassign(self, rows: Int64Array, neighbourhoods: "_Neighbourhoods") -> None:
        """Find the nearest centres of the samples with indices `rows`."""
        before = self.labels[rows]
        labels, nearest, second = neighbourhoods.two_nearest(np.take(self._columns, rows, axis=1), before)
        self.labels[rows], self._gaps[rows] = labels, second - nearest
        joined = np.flatnonzero(labels != before)
        np.maximum.at(self._extents, labels[joined], nearest[joined])

    def _fill_empty(self) -> None:
        """Move one sample into each empty cluster: the one farthest from its centre, from a cluster with others.

        This lowers the inertia, so the iteration still terminates.
        """
        self.sizes = np.bincount(self.labels, minlength=len(self._centers))
        if self.sizes.all():
            return
        moved = refill_empty(self._columns.T, self.labels, self.sizes, self._distances())
        self._gaps[moved] = 0
        self._until_refresh = 0  # a moved sample may be far from the previous centre of its new cluster

    def _distances(self) -> Float64Array:
        """Return the distance of every sample from its centre, (s,) float64."""
        return np.sqrt(_squared_norms(self._columns - np.take(self._centers, self.labels, axis=0).T))


class _Neighbourhoods:
    """The m nearest centres of each of n centres, itself included.

    members   (m, n) int64: column c has the indices of the neighbourhood of centre c
    radius    (n,) float64: every centre outside the neighbourhood is at least this far from c; infinite if none is
    """

    def __init__(self, centers: Float64Array) -> None:
        self._centers = centers
        self._tree = cKDTree(centers)
        distances, members = _query(self._tree, centers, _NEIGHBOURS + 1)
        self.members = np.ascontiguousarray(members[:, : min(_NEIGHBOURS, len(centers))].T)
        self.radius = distances[:, _NEIGHBOURS]
        self._member_centers = np.ascontiguousarray(centers[self.members].transpose(0, 2, 1))  # (m, 3, n)

    def max_of_others(self, values: Float64Array) -> Float64Array:
        """Return the maximum of values, (n,) >= 0, over each neighbourhood without its own centre, (n,) float64."""
        own = self.members == np.arange(len(values))
        return np.asarray(np.where(own, 0.0, values[self.members]).max(axis=0), np.float64)

    def two_nearest(self, columns: Float64Array, labels: Int64Array) -> tuple[Int64Array, Float64Array, Float64Array]:
        """Find what the function `two_nearest` finds for points, (3, k), starting around the centres `labels`.

        The second distance is a lower bound if the second nearest centre may lie outside the neighbourhood.
        """
        first, second = np.full(len(labels), np.inf), np.full(len(labels), np.inf)
        member = np.zeros(len(labels), np.intp)
        for k, centers in enumerate(self._member_centers):
            squared = _squared_norms(np.take(centers, labels, axis=1) - columns)
            np.copyto(member, k, where=squared < first)
            np.minimum(second, np.maximum(first, squared), out=second)
            np.minimum(first, squared, out=first)
        nearest = self.members[member, labels]

        # By the triangle inequality, centres outside the neighbourhood are at least this far.
        outside = self.radius[labels] - np.sqrt(_squared_norms(columns - np.take(self._centers, labels, axis=0).T))
        first, second = np.sqrt(first), np.minimum(np.sqrt(second), outside)
        unsure = np.flatnonzero(second <= first * (1 + _TIE_TOLERANCE))
        if len(unsure):
            points = columns[:, unsure].T
            nearest[unsure], first[unsure], second[unsure] = two_nearest(points, self._centers, self._tree)
        return nearest, first, second


def two_nearest(
    points: Float64Array, centers: Float64Array, tree: cKDTree
) -> tuple[Int64Array, Float64Array, Float64Array]:
    """Find the nearest centre of each point, and the distances of the nearest and the second nearest centre.

    points (k, 3) float64, centers (n, 3) float64, tree: k-d tree of the centres.
    Returns (k,) int64, the lowest index among equally near centres; (k,) float64; (k,) float64, infinite if n = 1.
    """
    distances, indices = _query(tree, points, 2)
    first, second, labels = distances[:, 0], distances[:, 1], indices[:, 0]
    tied = np.flatnonzero(second <= first * (1 + _TIE_TOLERANCE))  # the tree returns ties in no defined order
    chunk_size = max(1, _CHUNK_SIZE // len(centers))
    for start in range(0, len(tied), chunk_size):
        rows = tied[start : start + chunk_size]
        labels[rows] = _squared_norms(points[rows].T[:, :, None] - centers.T[:, None, :]).argmin(axis=1)
    return labels, first, second


def refill_empty(points: Float64Array, labels: Int64Array, sizes: Int64Array, distances: Float64Array) -> list[int]:
    """Move one sample into each empty cluster; return the rows of the moved samples.

    points      (s, 3) float64
    labels      (s,) int64, updated
    sizes       (n,) int64: samples per cluster, updated
    distances   (s,) float64: the samples with the greatest distance move first, ties in the order of rows

    Empty clusters are filled in ascending order. The last sample of a cluster stays, and no two of the moved samples
    have equal coordinates.
    """
    empty = np.flatnonzero(sizes == 0)[::-1].tolist()
    taken: set[bytes] = set()
    moved: list[int] = []
    for row in np.argsort(-distances, kind="stable") if empty else ():
        coordinates = points[row].tobytes()
        if sizes[labels[row]] == 1 or coordinates in taken:
            continue
        taken.add(coordinates)
        sizes[labels[row]] -= 1
        labels[row] = empty.pop()
        sizes[labels[row]] = 1
        moved.append(row)
        if not empty:
            break
    return moved


def max_per_label(values: Float64Array, labels: Int64Array, count: int) -> Float64Array:
    """Return the maximum of the values, (s,) >= 0, with each label, (count,) float64; 0 for labels without values."""
    maxima = np.zeros(count)
    np.maximum.at(maxima, labels, values)
    return maxima


def _sum_per_label(points: Float64Array, labels: Int64Array, count: int) -> Float64Array:
    """Return the sum of the points with each label, (count, 3) float64."""
    return np.stack([np.bincount(labels, column, count) for column in points.T], axis=1)


def _query(tree: cKDTree, points: Float64Array, count: int) -> tuple[Float64Array, Int64Array]:
    """Return distances and indices of the nearest, (k, count); infinite and n where there are fewer than `count`."""
    distances, indices = tree.query(points, k=list(range(1, count + 1)))
    return np.asarray(distances, np.float64), np.asarray(indices, np.intp)


def _squared_norms(vectors: Float64Array) -> Float64Array:
    """Return x^2 + y^2 + z^2 of vectors, (3, ...)."""
    x, y, z = vectors
    squared: Float64Array = x * x + y * y + z * z
    return squared
