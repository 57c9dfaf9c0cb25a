"""Spheres fitted to clusters of samples: algorithm 1.2.1 of *Précalcul* with its metric A, the algebraic distance.

The metric is f(P, S) = |P - S|^2 - r^2 (equation 1.2.2.1). Every sample is assigned to the sphere of least |f|, then
every sphere is replaced by the linear least-squares solution for its samples (equation 1.2.2.2), until no sample
changes its sphere. Neither step raises the sum of f^2, guards included, so the iteration terminates.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.progress import Progress
from aoprecalc.spheres.lloyd import refill_empty, two_nearest
from aoprecalc.types import BoolArray, Float64Array, Int64Array

_MAX_RADIUS = 3**0.5  # circumscribed sphere of the box [-1, 1]^3: a larger radius has diverged
_MIN_FLATNESS = 1e-9  # (thickness / width)^2 of a cluster that counts as flat; well above the rounding of float32 files
_F_ROUNDING = 1e-13  # exceeds the rounding error of f, for samples in the box and spheres up to the maximum radius
_CHUNK_VALUES = 1 << 16  # values of f computed at once: they stay in cache, and BLAS starts no threads for so few


@dataclass(frozen=True, eq=False)
class AlgebraicFit:
    """Spheres and the samples assigned to each. Sizes: n spheres, s samples.

    centers      (n, 3) float64
    radii        (n,) float64, 0 to sqrt(3): the root mean square distance of a sphere's samples from its centre, except
                 for spheres that a guard left unchanged
    labels       (s,) int64: sphere index of each sample; every sphere has samples
    iterations   how many times all samples were assigned to their best spheres
    converged    the last iteration reassigned no sample
    guarded      how often, over all spheres and iterations, a guard replaced the least-squares solution
    costs        (iterations) floats: the sum of f^2 after each assignment; never rises, except by rounding
    """

    centers: Float64Array
    radii: Float64Array
    labels: Int64Array
    iterations: int
    converged: bool
    guarded: int
    costs: tuple[float, ...]


def fit_algebraic(points: Float64Array, initial: Float64Array, max_iterations: int, progress: Progress) -> AlgebraicFit:
    """Alternate between assigning samples to the spheres of least |f| and fitting the spheres to their samples.

    points           (s, 3) float64 in [-1, 1], rounded by `sampling.round_to_grid`: means of equal points are exact
    initial          (n, 3) float64 in [-1, 1]: initial centres, with radius 0; at least n of the points are distinct
    max_iterations   >= 1: stop then even if samples still change spheres

    Ties go to the sphere with the lower index, but a sample stays with its sphere unless another is strictly better.
    Each iteration advances `progress` by one.
    """
    lifted = np.column_stack([points, (points**2).sum(axis=1), np.ones(len(points))])
    spheres = np.column_stack([initial, np.zeros(len(initial))])
    labels, nearest, _ = two_nearest(points, initial, cKDTree(initial))  # radius 0: |f| is the squared distance
    magnitudes = nearest**2
    costs: list[float] = []
    guarded, converged = 0, False
    while True:
        moved = refill_empty(points, labels, np.bincount(labels, minlength=len(initial)), magnitudes)
        magnitudes[moved] = 0  # the best sphere of a single sample is that point
        costs.append(float((magnitudes**2).sum()))  # not a dot product, for which BLAS would start threads
        progress.advance()
        spheres, is_guarded = _best_spheres(points, spheres, labels, magnitudes)
        guarded += int(is_guarded.sum())
        if converged or len(costs) == max_iterations:
            break
        before = labels
        labels, magnitudes = _assign(lifted, spheres, before)
        converged = np.array_equal(labels, before)
    return AlgebraicFit(spheres[:, :3], spheres[:, 3], labels, len(costs), converged, guarded, tuple(costs))


def _assign(lifted: Float64Array, spheres: Float64Array, labels: Int64Array) -> tuple[Int64Array, Float64Array]:
    """Find the sphere of least |f| for each sample, and that |f|.

    f = |P|^2 - 2 P.S + |S|^2 - r^2 is linear in the lifted samples x, y, z, |P|^2, 1, (s, 5). A sample keeps its
    sphere, labels (s,), unless another is better by more than rounding: samples that lie on two spheres would else
    alternate between them forever.
    Returns (s,) int64, (s,) float64.
    """
    centers, radii = spheres[:, :3].T, spheres[:, 3]
    factors = np.vstack([-2 * centers, np.ones(len(radii)), (centers**2).sum(axis=0) - radii**2])
    assigned, magnitudes = np.empty_like(labels), np.empty(len(labels))
    chunk_size = max(1, _CHUNK_VALUES // len(radii))
    buffer, rows = np.empty((chunk_size, len(radii))), np.arange(chunk_size)
    for start in range(0, len(labels), chunk_size):
        chunk = slice(start, start + chunk_size)
        current = labels[chunk]
        f, row = buffer[: len(current)], rows[: len(current)]
        np.matmul(lifted[chunk], factors, out=f)
        np.abs(f, out=f)
        best = f.argmin(axis=1)
        best = np.where(f[row, best] < f[row, current] - _F_ROUNDING, best, current)
        assigned[chunk], magnitudes[chunk] = best, f[row, best]
    return assigned, magnitudes


def _best_spheres(
    points: Float64Array, spheres: Float64Array, labels: Int64Array, magnitudes: Float64Array
) -> tuple[Float64Array, BoolArray]:
    """Fit each sphere to its samples (equation 1.2.2.2), guarded against ill-conditioned clusters.

    With q = p - m relative to the mean m of a cluster and s = S - m, f = |q|^2 - 2 q.s + |s|^2 - r^2 is linear in s and
    in the constant. As the q sum to 0, the two separate: s = 1/2 (sum q q^T)^-1 sum q |q|^2, and the mean of f must be
    0, so r^2 = |s|^2 + mean |q|^2. That is the mean squared distance from the new centre.

    If the samples lie in a plane, on a line or at a point, rounding would determine s, and if they nearly do, r may
    diverge. The sphere centred at m (s = 0) or the previous one then replaces the solution, whichever has the smaller
    sum of f^2. No centre diverges without its radius: there are samples within r of it.

    spheres (n, 4): centres and radii; labels (s,): every sphere has samples; magnitudes (s,): |f| of each sample.
    Returns (n, 4) float64; (n,) bool, true where a guard replaced the solution.
    """
    sizes = np.bincount(labels, minlength=len(spheres))

    def mean(values: Float64Array) -> Float64Array:
        return np.asarray(np.bincount(labels, values) / sizes, np.float64)

    means = np.stack([mean(column) for column in points.T])
    q = points.T - means[:, labels]
    squared = (q * q).sum(axis=0)
    variance = mean(squared)
    third_moment = np.stack([mean(row * squared) for row in q], axis=1)
    covariance = np.empty((len(spheres), 3, 3))
    for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)):
        covariance[:, i, j] = covariance[:, j, i] = mean(q[i] * q[j])

    eigenvalues, axes = np.linalg.eigh(covariance)  # ascending
    flat = eigenvalues[:, 0] <= _MIN_FLATNESS * eigenvalues[:, 2]
    eigenvalues[flat] = np.inf
    shift = np.einsum("nij,nj,nkj,nk->ni", axes, 0.5 / eigenvalues, axes, third_moment)
    radii = np.sqrt((shift**2).sum(axis=1) + variance)
    guarded = flat | (radii > _MAX_RADIUS)

    centered = np.column_stack([means.T, np.sqrt(variance)])
    keep = mean(magnitudes**2) < mean((squared - variance[labels]) ** 2)
    solution = np.column_stack([means.T + shift, radii])
    return np.where(guarded[:, None], np.where(keep[:, None], spheres, centered), solution), guarded
