"""Errors of an ambient-occlusion texture against ray tracing at surface points (*Précalcul*, equation 1.1.1.1)."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.mesh.topology import edge_ids
from aoprecalc.texture_lookup import bilinear, mip_chain
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Scene

MIP_LEVELS = 5
_MIN_SEPARATION = 0.01  # of two of the worst points, / bounding box diagonal


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of the errors texture - reference, both ambient occlusion in [0, 1].

    rmse            root mean square
    bias            mean; positive if the texture is too bright
    p50, p95, p99   percentiles of the absolute error
    max             maximum of the absolute error
    """

    rmse: float
    bias: float
    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class WorstPoint:
    """A surface point of large error.

    position           in mesh units
    uv                 v upwards
    value, reference   ambient occlusion of the texture and of ray tracing, in [0, 1]
    """

    position: tuple[float, float, float]
    uv: tuple[float, float]
    value: float
    reference: float

    @property
    def error(self) -> float:
        """Texture minus reference."""
        return self.value - self.reference


@dataclass(frozen=True, eq=False)
class TextureErrors:
    """Errors of a texture against ray tracing, at points distributed uniformly over a surface.

    levels   statistics for each level of the texture's mip chain, full resolution first
    worst    points of greatest error at full resolution
    rays     cast from each point
    uvs      (k, 2) float64: of the points, v upwards
    errors   (k,) float64: texture - reference at the points, at full resolution
    reference   (k,) float64: ambient occlusion at the points, by rays
    hit      (n,) bool: which of the points that were drawn these are: those on the detailed surface, if there is one
    """

    levels: tuple[ErrorStatistics, ...]
    worst: tuple[WorstPoint, ...]
    rays: int
    uvs: Float64Array
    errors: Float64Array
    reference: Float64Array
    hit: BoolArray

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.errors)


def error_statistics(errors: Float64Array) -> ErrorStatistics:
    """Compute statistics of errors, (k,) with k >= 1."""
    magnitudes = np.abs(errors)
    p50, p95, p99 = np.percentile(magnitudes, [50, 95, 99])
    rmse = np.sqrt(np.mean(errors**2))
    return ErrorStatistics(*map(float, (rmse, errors.mean(), p50, p95, p99, magnitudes.max())))


def errors_per_mip_level(
    texture: Float32Array, uvs: Float64Array, reference: Float64Array, *, repeats: bool, levels: int = MIP_LEVELS
) -> tuple[ErrorStatistics, ...]:
    """Compute error statistics for bilinear look-ups in each of the first `levels` levels of a texture's mip chain.

    texture     (h, w), row 0 at v = 1
    uvs         (k, 2) of the points
    reference   (k,) expected values
    """
    chain = mip_chain(texture, levels)
    return tuple(error_statistics(bilinear(level, uvs, repeats=repeats) - reference) for level in chain)


def worst_points(
    positions: Float64Array,
    uvs: Float64Array,
    values: Float64Array,
    reference: Float64Array,
    diagonal: float,
    count: int = 10,
) -> tuple[WorstPoint, ...]:
    """Return up to `count` points of greatest error, in descending order, at least 1% of the diagonal apart.

    positions   (k, 3), in the unit of the diagonal
    uvs         (k, 2)
    values      (k,) looked up in the texture
    reference   (k,) expected; points without error are never returned
    """
    remaining = np.abs(values - reference)
    points: list[WorstPoint] = []
    while len(points) < count and remaining.max() > 0:
        worst = int(remaining.argmax())
        x, y, z = positions[worst].tolist()
        u, v = uvs[worst].tolist()
        points.append(WorstPoint((x, y, z), (u, v), float(values[worst]), float(reference[worst])))
        remaining[np.linalg.norm(positions - positions[worst], axis=1) <= _MIN_SEPARATION * diagonal] = 0
    return tuple(points)


# Without a reference: what a texture says of both sides of a seam.

_SEAM_SAMPLES = 4000
_MIN_SEAM = 1e-6  # distance of UVs from which an edge is a seam


@dataclass(frozen=True)
class SeamDifference:
    """How a texture differs across UV seams, where both sides are one place of the surface.

    seams     edges whose two faces have different UVs
    across    mean absolute difference of both sides
    random    that of two places of seams taken at random
    """

    seams: int
    across: float
    random: float


def seam_difference(scene: Scene, texture: Float32Array, uvs: Float64Array, mapped: BoolArray) -> SeamDifference | None:
    """Compare a texture, (h, w), on both sides of the seams of (f, 3, 2) UVs; None where there are no seams.

    mapped   (f,) bool: the faces with UVs
    """
    ids = edge_ids(scene.faces)[mapped].ravel()
    ends = np.stack([scene.faces, np.roll(scene.faces, -1, axis=1)], axis=2)[mapped].reshape(-1, 2)
    at_ends = np.stack([uvs, np.roll(uvs, -1, axis=1)], axis=2)[mapped].reshape(-1, 2, 2)
    turned = ends[:, 0] > ends[:, 1]
    at_ends[turned] = at_ends[turned, ::-1]
    order = np.argsort(ids, kind="stable")
    first, second = order[:-1], order[1:]
    split = (ids[first] == ids[second]) & (np.abs(at_ends[first] - at_ends[second]).max(axis=(1, 2)) > _MIN_SEAM)
    first, second = first[split], second[split]
    lengths = np.linalg.norm(np.diff(scene.positions[ends[first]], axis=1)[:, 0], axis=1)
    if not lengths.sum() > 0:
        return None
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(first), _SEAM_SAMPLES, p=lengths / lengths.sum())
    along = rng.random((_SEAM_SAMPLES, 1))
    here, there = (
        bilinear(texture, at_ends[side[chosen], 0] * (1 - along) + at_ends[side[chosen], 1] * along, repeats=True)
        for side in (first, second)
    )
    across, random = (float(np.abs(here - other).mean()) for other in (there, rng.permutation(there)))
    return SeamDifference(len(first), across, random)
