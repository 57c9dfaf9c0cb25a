"""The integrand of ambient occlusion, its estimators, and the error of these.

With the shading normal n and the geometric normal g of a surface point, over uniform directions w:

    AO = sum f(n.w) L(w) [g.w > 0] (1 - p(t / D)) / sum f(n.w) L(w) [g.w > 0]

    f   the weight of a direction: n.w, or 1; 0 where w lies outside the cone about n
    L   the radiance of the sky, as a rule 1
    t   the distance to the nearest occluder along w, and D the maximum distance
    p   what an occluder takes at x = t / D < 1: 1, linear 1 - x, or smooth 1 - 3 x^2 + 2 x^3; 0 from x = 1

The visibility vector C is the same sum with each direction w in its numerator; its direction is the bent normal. Under
the light L(w) (E0 + E1.w) a point gets exactly AO E0 + C.E1.
"""

from dataclasses import dataclass, replace
from math import cos, inf, radians, sqrt
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import absolute_length
from aoprecalc.options import Estimator, Falloff, Sampling, ValueOptions, Weight
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Scene
from aoprecalc.visibility.sky import Sky, sky_of

_CHUNK = 1 << 20  # texels whose error is looked at at a time: bounds memory


@dataclass(frozen=True)
class Integrand:
    """What a direction counts for at a surface point, and how much an occluder takes of it.

    min_cosine     of the angle between the shading normal and the directions that count: of half the cone
    max_distance   in the units of the mesh, from which occluders take nothing
    sky            None: uniform
    vectors        visibility vectors are wanted too
    """

    estimator: Estimator = "ratio"
    weight: Weight = "cosine"
    min_cosine: float = 0.0
    max_distance: float = inf
    falloff: Falloff = "none"
    sky: Sky | None = None
    vectors: bool = False

    @classmethod
    def from_options(cls, options: ValueOptions, scene: Scene) -> Self:
        """Return the integrand of a bake; shares of the diagonal are of the bounding box of what receives light."""
        min_cosine = 0.0 if options.cone == 180 else cos(radians(options.cone / 2))
        limit = inf if options.max_distance is None else absolute_length(options.max_distance, scene)
        sky = sky_of(scene, options)
        return cls(options.estimator, options.weight, min_cosine, limit, options.falloff, sky)

    def for_directions(self, directions: Float64Array) -> Self:
        """Return it for the (n, 3) light directions of a bake, uniform on the sphere; see `Sky.averaged`."""
        return self if self.sky is None else replace(self, sky=self.sky.averaged(directions))

    @property
    def columns(self) -> int:
        """The number of visibility sums of a sample: two weights, and a vector where it is wanted."""
        return 5 if self.vectors else 2

    @property
    def mean_weight(self) -> float:
        """The mean of f over all directions: 1/4 for the cosine over the hemisphere."""
        return (1 - self.min_cosine**2) / 4 if self.weight == "cosine" else (1 - self.min_cosine) / 2

    def weights(self, cosines: Float64Array) -> Float64Array:
        """Return f, (k,), for the cosines of k directions with the shading normals."""
        counts = (cosines > 0) & (cosines >= self.min_cosine)
        return np.where(counts, cosines if self.weight == "cosine" else 1.0, 0.0)

    def radiance(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return L, (k,), for (k, 3) unit vectors."""
        return np.ones(len(directions)) if self.sky is None else self.sky.radiance(directions)

    def occlusion(self, distances: NDArray[np.floating]) -> Float64Array:
        """Return p, (k,) in [0, 1], for distances to the nearest occluder in the units of the mesh; NaN for none."""
        x = np.nan_to_num(distances / self.max_distance, nan=1.0).clip(0.0, 1.0)
        if self.falloff == "none":
            return np.where(x < 1, 1.0, 0.0)
        return np.asarray(1 - x if self.falloff == "linear" else (1 - x) ** 2 * (1 + 2 * x), np.float64)

    def estimate(self, sums: Float32Array, directions: int) -> tuple[Float32Array, BoolArray]:
        """Return the ambient occlusion of texels, (k,) float32 >= 0, and which of them have a value, (k,) bool.

        sums   (k, columns): the weight of the visible directions, and of all directions in front of the surface
        ratio  their quotient: self-normalised, exactly 1 on an open point
        mean   the first over the expected weight, 4/N for the cosine: the Monte Carlo estimate of Précalcul, equation
               1.1.1.1, with directions uniform on the sphere (p.d.f. 1 / (4 pi), section 1.1.1); sampling can make it
               greater than 1
        """
        values, measured = self.estimates(sums[:, :2], directions)
        return values[:, 0], measured

    def estimates(self, sums: Float32Array, directions: int) -> tuple[Float32Array, BoolArray]:
        """Return the ambient occlusion of texels and, where it is wanted, their visibility vectors, as `estimate` does.

        (k, 1) or (k, 4) float32: the ambient occlusion first
        """
        total = sums[:, 1]
        measured = total > 0
        values: Float32Array = np.zeros((len(sums), sums.shape[1] - 1), np.float32)
        for column, visible in enumerate((sums[:, 0], *sums[:, 2:].T)):  # no copy: these are the largest arrays
            if self.estimator == "mean":
                np.multiply(visible, np.float32(1 / (self.mean_weight * directions)), out=values[:, column])
            else:
                np.divide(visible, total, out=values[:, column], where=measured)
        return values, measured


def sampling_error(
    halves: Float32Array, directions: list[int], integrand: Integrand, sampling: Sampling
) -> float | None:
    """Return the expected error of both halves together, RMS over the texels that both measured; None without any.

    halves       (2, k, columns): visibility sums of the halves
    directions   how many each has used
    """
    if not all(directions):
        return None
    squares, texels = 0.0, 0
    for start in range(0, halves.shape[1], _CHUNK):
        (first, measured_first), (second, measured_second) = (
            integrand.estimate(sums[start : start + _CHUNK], count)
            for sums, count in zip(halves, directions, strict=True)
        )
        measured_in_both = measured_first & measured_second
        squares += float(((first[measured_in_both] - second[measured_in_both]) ** 2).sum(dtype=np.float64))
        texels += int(np.count_nonzero(measured_in_both))
    if not texels:
        return None
    return sqrt(squares / texels) * error_per_difference(directions, sampling)


def error_per_difference(directions: list[int], sampling: Sampling) -> float:
    """Return the error of both halves together over the difference between the two, RMS.

    directions   how many each half has used
    Let p and q be the halves' shares of the directions. If their errors were independent, their difference would be
    1 / sqrt(pq) times the error of the whole. But the halves of a uniform set complete each other: its error falls as
    N^-3/4, which makes the difference greater by sqrt(p^-1/2 + q^-1/2 - 1), 1.35 for equal halves. Random directions
    are independent.
    """
    p, q = np.divide(directions, sum(directions))
    correlation = 1.0 if sampling == "random" else p**-0.5 + q**-0.5 - 1.0
    return float(np.sqrt(p * q / correlation))
