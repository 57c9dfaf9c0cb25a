"""Certificates: whether the error of a texture, as rendered, is at most E, with 95% confidence.

At random points of the surface the texture is looked up, and compared with two independent estimates a and b of the
ambient occlusion, by rays. In the mean the product Z = (texture - a)(texture - b), which lies in [-1, 1], is the
squared error, whatever the noise of the rays. (That of the divisor of the ratio estimator is small: rays are
stratified.)

The hypothesis that the mean of Z is E^2 or more is tested by betting against it (I. Waudby-Smith, A. Ramdas,
"Estimating means of bounded random variables by betting", 2024): a capital of 1 grows by the factor 1 + s (E^2 - Z) at
each point, for a stake s in [0, 1). Under the hypothesis it does not grow in the mean, so the probability that it ever
reaches 1 / p is at most p (Ville's inequality). So points may be added until it does, and nothing is assumed of how
errors are distributed: they may be rare and large. Stratified points may be used, too: by the inequality of arithmetic
and geometric means, strata of different means only let the capital grow less.
"""

import math
from collections.abc import Callable

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.metrics.reference import MeasuredSurface, RayReference
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import CONFIDENCE, Atlas, Certificate, Float32Array, Float64Array, Scene
from aoprecalc.visibility.integrand import Integrand

BATCH = 1 << 14  # points that are added at a time
RAYS = 64  # from a point, for each of the two estimates
_RAYS_FOR_SIDE = 4 * RAYS
_STAKES = (0.95, 0.4, 0.15)  # among which the capital is divided; small ones are for errors that are rare and large
_MOST_POINTS = 5.0  # times what a texture without error needs; they suffice up to a squared error of 0.8 E^2
_FIRST_BATCHES = 2  # that tell whether they will
_STANDARD_ERRORS = 2.0  # by which their mean may be greater than what suffices
_DECIMALS = 1e6  # to which errors are rounded, and bounds are rounded up
_STEP = 1.005  # of the squared bounds that are tried

Products = Callable[[int], Float64Array]  # the number of a batch -> Z at its points, (k,)


def certify(
    products: Products,
    max_error: float,
    *,
    confidence: float = CONFIDENCE,
    seed: int = 0,
    rays: int = 2 * RAYS,
    effort: float = 1.0,
) -> Certificate:
    """Add points until the RMS error is at most `max_error` with a confidence, or until there is little hope of that.

    products     of batches 0, 1, 2, ..., which are independent; see `RenderedErrors`
    seed, rays   of the products, for the certificate
    effort       factor of the most points that are taken
    """
    target, wanted = max_error**2, -math.log1p(-confidence)
    needed = (wanted + math.log(len(_STAKES))) / _STAKES[0]  # points times what the mean is below the target
    most = effort * _MOST_POINTS * needed / target
    suffices = target - needed / most
    found, logs, points, total, squares = list[Float64Array](), np.zeros(len(_STAKES)), 0, 0.0, 0.0
    while True:
        found.append(products(len(found)))
        logs += _logs(target, found[-1])
        points += len(found[-1])
        total += float(found[-1].sum())
        squares += float((found[-1] ** 2).sum())
        mean = total / points
        spread = math.sqrt(max(squares / points - mean**2, 0.0) / points)
        holds = _log_capital(logs) >= wanted
        hopeless = len(found) >= _FIRST_BATCHES and mean - _STANDARD_ERRORS * spread > suffices
        if holds or hopeless or points >= most:
            break
    squared = _bound(np.concatenate(found), target, wanted, holds=holds)
    bound = math.ceil(math.sqrt(squared) * _DECIMALS) / _DECIMALS
    return Certificate(
        max_error=max_error,
        error=round(math.sqrt(max(mean, 0.0)) * _DECIMALS) / _DECIMALS,
        bound=min(bound, max_error) if holds else bound,
        confidence=confidence,
        points=points,
        rays=rays,
        seed=seed,
    )


def _logs(mean: float, products: Float64Array) -> Float64Array:
    """Return the logarithm of what each stake becomes by betting against a mean."""
    return np.array([np.log1p(stake * (mean - products)).sum() for stake in _STAKES])


def _log_capital(logs: Float64Array) -> float:
    """Return the logarithm of the capital, of which each stake had an equal part."""
    largest = float(logs.max())
    return largest + math.log(float(np.exp(logs - largest).mean()))


def _bound(products: Float64Array, target: float, wanted: float, *, holds: bool) -> float:
    """Return a mean that is refuted, as are all greater ones: about the smallest one; at most 1.

    wanted   logarithm of the capital that refutes
    holds    the target is refuted
    """

    def refuted(mean: float) -> bool:
        return _log_capital(_logs(mean, products)) >= wanted

    bound = target
    if holds:
        while refuted(bound / _STEP):
            bound /= _STEP
        return bound
    while bound < 1 and not refuted(bound):
        bound *= _STEP
    return min(bound, 1.0)


class RenderedErrors:
    """The products of batches of points, for `certify`: by rays, at points uniform on the surface of a texture."""

    def __init__(
        self,
        scene: Scene,
        normals: Float32Array,
        atlas: Atlas,
        texture: Float32Array,
        integrand: Integrand,
        seed: tuple[int, ...],
        threads: int,
    ) -> None:
        """Keep what is measured; raises RendererError where rays cannot be cast.

        scene      with the roles of its parts
        normals    (f, 3, 3) float32: the shading normals at the corners
        texture    (h, w) float32 in [0, 1], row 0 at v = 1
        seed       of the points and rays: those of two seeds are independent
        """
        self._surface = MeasuredSurface(scene, normals, threads)
        self._reference = RayReference(self._surface.scene, self._surface.normals, integrand, threads)
        self._scene, self._atlas, self._texture, self._seed = scene, atlas, texture, seed

    def __call__(self, batch: int) -> Float64Array:
        """Return Z at the points of a batch that are on the measured surface; raises InputError where none are."""
        for_points, for_side, *for_rays = np.random.SeedSequence((*self._seed, batch)).generate_state(4).tolist()
        drawn = sample_surface(self._scene, self._atlas.mapped, BATCH, for_points)
        hit, on_surface = self._surface.points(drawn)
        if not hit.any():
            raise InputError(
                f"{self._scene.path}: none of its points are on the detailed surface; use a greater --cage"
            )
        uvs = drawn.select(hit).interpolate(self._atlas.uvs)
        values = bilinear(self._texture, uvs, repeats=self._atlas.repeats)
        first, second = (self._reference.of_sides(on_surface, RAYS, seed, Progress()) for seed in for_rays)
        if second[1].any():  # two-sided faces: the lighter side is chosen by rays of its own
            back = self._reference.of_sides(on_surface, _RAYS_FOR_SIDE, for_side, Progress()).argmax(axis=0) == 1
            first[0, back], second[0, back] = first[1, back], second[1, back]
        products: Float64Array = (values - first[0]) * (values - second[0])
        return products.clip(-1.0, 1.0)  # a file may hold values beyond [0, 1]
