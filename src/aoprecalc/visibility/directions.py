"""Light directions, uniform on the sphere, as axes; and the orthographic projection along each.

An axis is a pair of opposite light directions, given by one unit vector. Uniform sets follow the spherical
Fibonacci lattice (R. Swinbank and R. J. Purser, "Fibonacci grids", 2006) on the half sphere. In index order it runs
from the equator to the pole; it is visited with a stride that makes every group of GROUP_SIZE axes uniform too.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import area_vectors, normalize, positions_of
from aoprecalc.options import BakeOptions, Sampling
from aoprecalc.types import Atlas, Float64Array, Scene

GROUP_SIZE = 64  # axes that share a texel offset and are uniform by themselves, unless another number is asked for
INV_GOLDEN_RATIO = (np.sqrt(5.0) - 1.0) / 2.0
_PLASTIC_RATIO = 1.324717957244746  # generates the R2 sequence of offsets
_ROTATION = 0.137  # of a whole turn: keeps the first axes away from the planes in which people model
_MAX_STRIDES = 400
_MOST_COMPARED = 256  # axes of a group whose distances tell how uniform it is: bounds time and memory

MIN_SHADOW_SIZE, MAX_SHADOW_SIZE = 512, 2048
_SIZE_STEP = 128
_FINENESS = 1.25  # map texels across a surface texel: one would do for a distant occluder, not for one in contact
_FINE_DIRECTIONS = 1000  # with as many directions maps of that fineness pay off
_SIZING_AXES = 128  # over which the extent of maps is averaged

_ROTATIONS = 16  # about the axis that are tried for the smallest rectangle
_PARALLEL = 1e-3  # length of the product of two unit vectors below which they count as parallel
_PROJECTED = 1 << 18  # coordinates at a time: bounds memory, and the processor's cache holds them
_MARGIN = 1.0  # map texels around what receives: for the neighbours that are read, and so that rounding leaves no tile


@dataclass(frozen=True)
class DirectionPlan:
    """How many light directions a bake takes.

    count         of them, before it is rounded up to pairs
    interleaved   where rays are traced, neighbouring texels may take different ones; see `interleaving`
    """

    count: int
    interleaved: bool

    @classmethod
    def from_options(cls, options: BakeOptions) -> Self:
        """Return what the options ask for."""
        return cls(options.direction_count, options.interleaves)


def light_axes(
    directions: int, sampling: Sampling = "fibonacci", seed: int = 0, group_size: int = GROUP_SIZE
) -> Float64Array:
    """Return ceil(directions / 2) axes, (a, 3) float64 unit vectors (Précalcul, section 1.1.1).

    fibonacci ignores the seed; random draws from it, uniformly on the sphere. For `group_size` see `axis_groups`.
    """
    count = (directions + 1) // 2
    if sampling == "random":
        return normalize(np.random.default_rng(seed).normal(size=(count, 3)))
    return fibonacci_hemisphere(np.arange(count) * _stride(count, group_size) % count, count)


def axis_groups(count: int, group_size: int = GROUP_SIZE) -> list[slice]:
    """Cut `count` axes into groups of `group_size`, the last one possibly shorter, in the order of summation."""
    return [slice(start, min(start + group_size, count)) for start in range(0, count, group_size)]


def texel_offset(group: int) -> tuple[float, float]:
    """Return where in a texel's unit square the samples of a group of axes lie; those of group 0 at its centre.

    Even and odd groups each follow the R2 sequence (M. Roberts, "Quasirandom sequences", 2018), the odd ones shifted,
    so that either half of the groups covers the square by itself.
    """
    pair, odd = divmod(group, 2)
    right = 0.5 + pair / _PLASTIC_RATIO + odd * INV_GOLDEN_RATIO
    down = 0.5 + pair / _PLASTIC_RATIO**2 + odd * INV_GOLDEN_RATIO**2
    return right % 1.0, down % 1.0


def fibonacci_hemisphere(index: NDArray[np.int64], count: int, rotation: float = 0.0) -> Float64Array:
    """Return points of the lattice of `count` points on the half sphere z > 0, by index of any shape, (..., 3) float64.

    rotation   of the lattice about z, in turns: lattices of different rotations have no point in common
    """
    z = (index + 0.5) / count
    angle = 2.0 * np.pi * ((index * INV_GOLDEN_RATIO + _ROTATION + rotation) % 1.0)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)


def orthonormal_basis(units: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return two unit vectors, (k, 3) each, that complete each of (k, 3) unit vectors to a right-handed frame.

    (J. R. Frisvad, 2012; T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.)
    """
    x, y, z = units.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    bitangent = np.column_stack([b, sign + y * y * a, -y])
    return tangent, bitangent


def _stride(count: int, group_size: int) -> int:
    """Return the step through the lattice, coprime to its size, whose first group is most uniform.

    Later groups are the same pattern moved along the lattice. The most uniform group has the least energy.
    """
    if count <= group_size:
        return 1
    strides = np.arange(1, count, dtype=np.int64)
    steps = np.arange(min(group_size, _MOST_COMPARED))
    strides = strides[np.gcd(strides, count) == 1][:_MAX_STRIDES]
    return int(min(strides, key=lambda stride: _energy(fibonacci_hemisphere(stride * steps % count, count))))


def _energy(axes: Float64Array) -> float:
    """Return the potential energy of (a, 3) axes that repel each other from both their ends."""
    cosines = axes @ axes.T
    np.fill_diagonal(cosines, 0.0)
    return float((1.0 / np.sqrt(np.maximum(1.0 - cosines**2, 1e-12))).sum())


# Projections: a square depth map for every axis, fitted tightly around what receives: what occludes it along the axis
# lies in the same map texels, however far away.


@dataclass(frozen=True, eq=False)
class Projections:
    """Projections of points along each of `a` axes.

    rows     (a, 3, 4) float64: rows @ (x, y, z, 1) gives map x and y in map texels, in [0, size], and the depth
             along the axis, greater towards the axis' positive end, in the points' units
    pitch    (a, 2) float64: the sides of a map texel, in the points' units
    below    (a,) float64: 1 or -1 where the positive or the negative end of the axis points below the ground, else 0
    """

    rows: Float64Array
    pitch: Float64Array
    below: Float64Array

    def select(self, chosen: slice) -> "Projections":
        """Return those of a slice of the axes."""
        return Projections(self.rows[chosen], self.pitch[chosen], self.below[chosen])


def convex_hull_points(positions: Float64Array) -> Float64Array:
    """Return the corners of the convex hull of (v, 3) positions, in their plane if flat; of a line its two ends."""
    from scipy.spatial import ConvexHull, QhullError  # in functions: slow to import

    principal = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)[2]
    for dimensions in (3, 2):
        try:
            corners: Float64Array = positions[ConvexHull(positions @ principal[:dimensions].T).vertices]
        except (QhullError, ValueError):  # no volume or no area, or too few points for any
            continue
        return corners
    along = positions @ principal[0]
    return positions[[along.argmin(), along.argmax()]]


def fit_projections(
    axes: Float64Array, hull: Float64Array, size: int, ground_normal: tuple[float, float, float] | None = None
) -> Projections:
    """Fit a map of `size` x `size` texels to the points `hull`, (h, 3), along each of `axes`, (a, 3).

    ground_normal   the unit vector away from the ground plane, if there is one
    """
    across, upward = orthonormal_basis(axes)
    points = np.ascontiguousarray(hull.T)
    longest = np.linalg.svd(hull - hull.mean(axis=0), full_matrices=False)[2][0]
    # Align the map with the longest extent, so that thin objects get a thin map.
    along_longest = np.arctan2(upward @ longest, across @ longest)
    angles = [np.full(len(axes), angle) for angle in np.arange(_ROTATIONS) * (np.pi / 2 / _ROTATIONS)]
    min_area = np.full(len(axes), np.inf)
    rows = np.zeros((len(axes), 3, 4))
    pitch = np.ones((len(axes), 2))
    for angle in [along_longest, *angles]:
        cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
        sides = np.stack([cosine * across + sine * upward, cosine * upward - sine * across], axis=1)
        low, high = _bounds(sides, points)
        # A flat object seen edge-on has no width; a map texel is never taller than a thousand times its width.
        extent = np.maximum(high - low, 1e-3 * (high - low).max(axis=1, keepdims=True))
        area = extent.prod(axis=1)
        better = area < min_area
        step = extent / (size - 2 * _MARGIN)
        middle = (low + high) / 2
        min_area[better] = area[better]
        pitch[better] = step[better]
        rows[better, :2, :3] = (sides / step[:, :, None])[better]
        rows[better, :2, 3] = (size / 2 - middle / step)[better]
    rows[:, 2, :3] = axes
    below = np.zeros(len(axes)) if ground_normal is None else -np.sign(axes @ ground_normal)
    return Projections(rows, pitch, below)


def _bounds(sides: Float64Array, points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the least and the greatest of points, (3, h), along both sides of maps, (a, 2, 3): (a, 2) each."""
    # Parts of about one size: products of a single point are rounded in another way.
    parts = np.array_split(points, max(1, 2 * len(sides) * points.shape[1] // _PROJECTED), axis=1)
    projected = (sides @ part for part in parts)
    low, high = zip(*((part.min(axis=2), part.max(axis=2)) for part in projected), strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def upright_projection(
    direction: Float64Array, up: Float64Array, points: Float64Array, size: int, margin: float
) -> Projections:
    """Project along one direction for a picture: square map texels, and `up` points to the top.

    direction   (3,) float64, a unit vector, towards the viewer
    up          (3,) float64, a unit vector; another is taken where the two are nearly parallel
    points      (h, 3): fitted into a map of `size` x `size` texels
    margin      share of the map's side that stays empty at each side
    """
    right = np.cross(up, direction)
    length = float(np.linalg.norm(right))
    right = right / length if length > _PARALLEL else orthonormal_basis(direction[None])[0][0]
    sides = np.stack([right, np.cross(direction, right)])
    projected = points @ sides.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    step = (float((high - low).max()) or 1.0) / (size * (1 - 2 * margin))
    rows = np.zeros((1, 3, 4))
    rows[0, :2, :3] = sides / step
    rows[0, :2, 3] = size / 2 - (low + high) / 2 / step
    rows[0, 2, :3] = direction
    return Projections(rows, np.full((1, 2), step), np.zeros(1))


def auto_shadow_size(scene: Scene, atlas: Atlas, texels: int, directions: int, measured: Scene | None = None) -> int:
    """Return the side of a depth map, 512 to 2048, that suits `texels` covered texels and a number of directions.

    With 1000 directions or more, map texels are somewhat finer than surface texels; with fewer they are coarser. The
    error that maps add is in proportion to their texels, the error that directions leave to N^-3/4; half of that
    exponent keeps the first below the second (measured on two meshes).

    measured   the scene whose surface the maps show; None: that of the texture
    """
    area = 0.5 * np.linalg.norm(area_vectors(scene.corners[atlas.mapped]), axis=1).sum()
    if not texels or not area:
        return MIN_SHADOW_SIZE
    fineness = _FINENESS * min(1.0, (directions / _FINE_DIRECTIONS) ** 0.375)
    size = fineness * map_texel(measured or scene, MAX_SHADOW_SIZE) * MAX_SHADOW_SIZE / math.sqrt(area / texels)
    return int(min(MAX_SHADOW_SIZE, max(MIN_SHADOW_SIZE, math.ceil(size / _SIZE_STEP) * _SIZE_STEP)))


def map_texel(scene: Scene, size: int) -> float:
    """Return the longer side of a texel of maps of `size` x `size`, in the mean over all axes, in the scene's units."""
    axes, hull = light_axes(2 * _SIZING_AXES), convex_hull_points(positions_of(scene, scene.receives))
    return float(fit_projections(axes, hull, size).pitch.max(axis=1).mean())
