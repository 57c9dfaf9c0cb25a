"""Spheres through clusters of samples: algorithm 1.2.1 of *Précalcul* with its metric A, the algebraic distance.

The metric is f(P, S) = |P - S|^2 - r^2 (equation 1.2.2.1). Pairing gives every sample to the sphere of least |f|, then
every sphere becomes the linear least-squares solution for its samples (1.2.2.2), until no sample changes its sphere.
Neither step raises the sum of f^2, guards included, and so the iteration ends.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.progress import Progress
from aoprecalc.spheres.lloyd import two_nearest
from aoprecalc.types import BoolArray, Float64Array, Int64Array

_LARGEST = 3**0.5  # a radius beyond that of the sphere around the box [-1, 1]^3 has run away
_FLAT = 1e-9  # a cluster is flat if its thickness / width, squared, is below: well above what float32 files round
_ROUNDING = 1e-13  # more than the rounding error of f, for samples in the box and spheres up to the largest
_BLOCK = 1 << 16  # values of f computed together: they stay in cache, and BLAS starts no threads for so few


@dataclass(frozen=True, eq=False)
class AlgebraicFit:
    """Spheres, and which samples each stands for. Sizes: n spheres, s samples.

    centers      (n, 3) float64
    radii        (n,) float64, 0 to sqrt(3): the root mean square distance of a sphere's samples from its centre, but
                 for spheres that a guard kept as they were
    labels       (s,) int64: the number of each sample's sphere; every sphere has samples
    iterations   how many times every sample was given to its best sphere
    converged    the last iteration changed no sample's sphere
    guarded      how often, over all spheres and iterations, a guard decided instead of the least squares
    costs        (iterations) floats: the sum of f^2 after each pairing; never rises, but for rounding
    """

    centers: Float64Array
    radii: Float64Array
    labels: Int64Array
    iterations: int
    converged: bool
    guarded: int
    costs: tuple[float, ...]


def fit_algebraic(points: Float64Array, starts: Float64Array, max_iterations: int, progress: Progress) -> AlgebraicFit:
    """Give samples to the spheres of least |f| and fit the spheres to their samples until nothing changes.

    points           (s, 3) float64 in [-1, 1], on the grid of `sample.on_grid`: that makes means of equal points exact
    starts           (n, 3) float64 in [-1, 1]: the first spheres, of radius 0; there are at least n distinct samples
    max_iterations   >= 1: stop then even if samples still change spheres

    Of equally near spheres the first counts, but a sample never leaves its own for one that is no nearer. Counts its
    iterations as progress.
    """
    lifted = np.column_stack([points, (points**2).sum(axis=1), np.ones(len(points))])
    spheres = np.column_stack([starts, np.zeros(len(starts))])
    labels, nearest, _ = two_nearest(points, starts, cKDTree(starts))  # radius 0: |f| is the squared distance
    distances = nearest**2
    costs: list[float] = []
    guarded, converged = 0, False
    while True:
        _fill_empty(points, labels, distances, len(starts))
        costs.append(float((distances**2).sum()))  # no dot product: BLAS would start threads for it
        progress.advance()
        spheres, by_guard = _best_spheres(points, spheres, labels, distances)
        guarded += int(by_guard.sum())
        if converged or len(costs) == max_iterations:
            break
        before = labels
        labels, distances = _pair(lifted, spheres, before)
        converged = np.array_equal(labels, before)
    return AlgebraicFit(spheres[:, :3], spheres[:, 3], labels, len(costs), converged, guarded, tuple(costs))


def _pair(lifted: Float64Array, spheres: Float64Array, labels: Int64Array) -> tuple[Int64Array, Float64Array]:
    """Find the sphere of least |f| for each sample, and that |f|.

    f = |P|^2 - 2 P.S + |S|^2 - r^2 is linear in the lifted samples, (s, 5): x, y, z, |P|^2, 1. labels (s,): the
    spheres that they have, and keep unless another one is nearer by more than rounding. Otherwise samples that lie on
    two spheres would change between them for ever.
    Returns (s,) int64, (s,) float64.
    """
    centers, radii = spheres[:, :3].T, spheres[:, 3]
    factors = np.vstack([-2 * centers, np.ones(len(radii)), (centers**2).sum(axis=0) - radii**2])
    found, distances = np.empty_like(labels), np.empty(len(labels))
    size = max(1, _BLOCK // len(radii))
    values, rows = np.empty((size, len(radii))), np.arange(size)
    for start in range(0, len(labels), size):
        block = slice(start, start + size)
        own = labels[block]
        f, row = values[: len(own)], rows[: len(own)]
        np.matmul(lifted[block], factors, out=f)
        np.abs(f, out=f)
        best = f.argmin(axis=1)
        best = np.where(f[row, best] < f[row, own] - _ROUNDING, best, own)
        found[block], distances[block] = best, f[row, best]
    return found, distances


def _fill_empty(points: Float64Array, labels: Int64Array, distances: Float64Array, count: int) -> None:
    """Restart every sphere without samples, of `count`, as a point: the sample of greatest |f| that can be spared.

    Spheres in ascending order; among equally far samples the first; never the last sample of a sphere, and no place
    twice. The best sphere of one sample is that point, f = 0, so the sum of f^2 falls. Changes labels and distances.
    """
    sizes = np.bincount(labels, minlength=count)
    empty = np.flatnonzero(sizes == 0)[::-1].tolist()
    if not empty:
        return
    taken: set[bytes] = set()
    for row in np.argsort(-distances, kind="stable"):
        place = points[row].tobytes()
        if sizes[labels[row]] == 1 or place in taken:
            continue
        taken.add(place)
        sizes[labels[row]] -= 1
        labels[row] = empty.pop()
        distances[row] = 0
        if not empty:
            break


def _best_spheres(
    points: Float64Array, spheres: Float64Array, labels: Int64Array, distances: Float64Array
) -> tuple[Float64Array, BoolArray]:
    """Fit each sphere to its samples (equation 1.2.2.2), or guard it from samples that would not hold it.

    With q = p - m about the mean m of a cluster and s = S - m, f = |q|^2 - 2 q.s + |s|^2 - r^2 is linear in s and in
    the constant. As the q sum up to 0, the two part: s = 1/2 (sum q q^T)^-1 sum q |q|^2, and the mean of f must be 0,
    so that r^2 = |s|^2 + mean |q|^2. That is the mean squared distance from the new centre.

    Where the samples are flat, a line or a point, rounding would choose s, and where they are nearly so, r may run
    away. There the sphere around m (s = 0) takes its place, or the sphere stays, whichever has the smaller sum of f^2.
    No centre runs away alone: within r of it there are samples.

    spheres (n, 4): centres and radii; labels (s,): every sphere has samples; distances (s,): |f| of each sample.
    Returns (n, 4) float64; (n,) bool, where a guard decided.
    """
    sizes = np.bincount(labels, minlength=len(spheres))

    def mean(values: Float64Array) -> Float64Array:
        return np.asarray(np.bincount(labels, values) / sizes, np.float64)

    middle = np.stack([mean(column) for column in points.T])
    q = points.T - middle[:, labels]
    squared = (q * q).sum(axis=0)
    spread = mean(squared)
    skew = np.stack([mean(row * squared) for row in q], axis=1)
    covariance = np.empty((len(spheres), 3, 3))
    for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)):
        covariance[:, i, j] = covariance[:, j, i] = mean(q[i] * q[j])

    widths, axes = np.linalg.eigh(covariance)  # squared, ascending
    flat = widths[:, 0] <= _FLAT * widths[:, 2]
    widths[flat] = np.inf
    shift = np.einsum("nij,nj,nkj,nk->ni", axes, 0.5 / widths, axes, skew)
    radii = np.sqrt((shift**2).sum(axis=1) + spread)
    guarded = flat | (radii > _LARGEST)

    around = np.column_stack([middle.T, np.sqrt(spread)])
    stay = mean(distances**2) < mean((squared - spread[labels]) ** 2)
    fitted = np.column_stack([middle.T + shift, radii])
    return np.where(guarded[:, None], np.where(stay[:, None], spheres, around), fitted), guarded
