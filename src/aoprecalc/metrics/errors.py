"""How large errors are, and where they are largest."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.texture_lookup import bilinear, mip_chain
from aoprecalc.types import Float32Array, Float64Array

MIP_LEVELS = 5
_APART = 0.01  # of the bounding diagonal: as near as two of the worst places may be


@dataclass(frozen=True)
class ErrorStatistics:
    """Of texture minus reference, both ambient occlusion in [0, 1].

    rmse            root of the mean square
    bias            mean; positive where the texture is too bright
    p50, p95, p99   the magnitude that as many percent of the errors stay within
    max             the greatest magnitude
    """

    rmse: float
    bias: float
    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class WorstPoint:
    """One point and its error: position in the mesh's units, UV (v upwards), values in [0, 1]."""

    position: tuple[float, float, float]
    uv: tuple[float, float]
    value: float
    reference: float

    @property
    def error(self) -> float:
        """Texture minus reference."""
        return self.value - self.reference


def error_statistics(differences: Float64Array) -> ErrorStatistics:
    """Describe (k,) errors, k >= 1."""
    sizes = np.abs(differences)
    p50, p95, p99 = np.percentile(sizes, [50, 95, 99])
    rmse = np.sqrt(np.mean(differences**2))
    return ErrorStatistics(*map(float, (rmse, differences.mean(), p50, p95, p99, sizes.max())))


def errors_per_mip_level(
    picture: Float32Array, uvs: Float64Array, reference: Float64Array, *, repeats: bool, levels: int = MIP_LEVELS
) -> tuple[ErrorStatistics, ...]:
    """Describe the errors of each level of a picture's mip chain, as far as there are so many.

    picture     (h, w), row 0 at v = 1
    uvs         (k, 2) of the points
    reference   (k,) what a look-up should find there
    """
    chain = mip_chain(picture, levels)
    return tuple(error_statistics(bilinear(level, uvs, repeats=repeats) - reference) for level in chain)


def worst_points(
    positions: Float64Array,
    uvs: Float64Array,
    values: Float64Array,
    reference: Float64Array,
    diagonal: float,
    count: int = 10,
) -> tuple[WorstPoint, ...]:
    """Return the points of greatest error, the worst first, no two nearer than a hundredth of the bounding diagonal.

    Points without error are left out, so there may be fewer than `count`.

    positions   (k, 3), in the same units as the diagonal
    uvs         (k, 2)
    values      (k,) of the texture, as `reference` of the truth
    """
    left = np.abs(values - reference)
    places: list[WorstPoint] = []
    while len(places) < count and left.max() > 0:
        at = int(left.argmax())
        x, y, z = positions[at].tolist()
        u, v = uvs[at].tolist()
        places.append(WorstPoint((x, y, z), (u, v), float(values[at]), float(reference[at])))
        left[np.linalg.norm(positions - positions[at], axis=1) <= _APART * diagonal] = 0
    return tuple(places)


@dataclass(frozen=True, eq=False)
class TextureErrors:
    """How far a texture is from ray tracing, at points spread uniformly over a surface.

    levels   the errors of each level of the texture's mip chain, full resolution first
    worst    the places of greatest error at full resolution
    rays     cast from each point
    uvs      (k, 2) float64 of the points, v upwards
    errors   (k,) float64 there, at full resolution
    """

    levels: tuple[ErrorStatistics, ...]
    worst: tuple[WorstPoint, ...]
    rays: int
    uvs: Float64Array
    errors: Float64Array

    @property
    def points(self) -> int:
        """How many points there are."""
        return len(self.errors)
