"""Light directions, uniform on the sphere, as axes.

An axis is a pair of opposite light directions, given by one unit vector. Uniform sets follow the spherical
Fibonacci lattice (R. Swinbank and R. J. Purser, "Fibonacci grids", 2006) on the half sphere. In index order it runs
from the equator to the pole; it is visited with a stride that makes every group of GROUP_SIZE axes uniform too.
"""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normals import normalize
from aoprecalc.options import Sampling
from aoprecalc.types import Float64Array

GROUP_SIZE = 64  # axes that share a texel offset and are uniform by themselves
INV_GOLDEN_RATIO = (np.sqrt(5.0) - 1.0) / 2.0
_PLASTIC_RATIO = 1.324717957244746  # generates the R2 sequence of offsets
_ROTATION = 0.137  # of a whole turn: keeps the first axes away from the planes in which people model
_MAX_STRIDES = 400


def light_axes(directions: int, sampling: Sampling = "fibonacci", seed: int = 0) -> Float64Array:
    """Return ceil(directions / 2) axes, (a, 3) float64 unit vectors (Précalcul, section 1.1.1).

    fibonacci ignores the seed; random draws from it, uniformly on the sphere.
    """
    count = (directions + 1) // 2
    if sampling == "random":
        return normalize(np.random.default_rng(seed).normal(size=(count, 3)))
    return fibonacci_hemisphere(np.arange(count) * _stride(count) % count, count)


def axis_groups(count: int) -> list[slice]:
    """Cut `count` axes into groups of GROUP_SIZE, the last one possibly shorter, in the order of summation."""
    return [slice(start, min(start + GROUP_SIZE, count)) for start in range(0, count, GROUP_SIZE)]


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


def _stride(count: int) -> int:
    """Return the step through the lattice, coprime to its size, whose first group is most uniform.

    Later groups are the same pattern moved along the lattice. The most uniform group has the least potential
    energy, in which each axis repels the others from both its ends.
    """
    if count <= GROUP_SIZE:
        return 1
    strides = np.arange(1, count, dtype=np.int64)
    strides = strides[np.gcd(strides, count) == 1][:_MAX_STRIDES]
    groups = fibonacci_hemisphere(strides[:, None] * np.arange(GROUP_SIZE) % count, count)
    cosines = np.abs(groups @ groups.transpose(0, 2, 1))
    cosines[:, np.arange(GROUP_SIZE), np.arange(GROUP_SIZE)] = 0.0
    energy = (1.0 / np.sqrt(np.maximum(1.0 - cosines**2, 1e-12))).sum(axis=(1, 2))
    return int(strides[np.argmin(energy)])
