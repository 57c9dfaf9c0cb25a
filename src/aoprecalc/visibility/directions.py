"""Unit vectors spread evenly over the half sphere: each stands for itself and its opposite.

(The spherical Fibonacci lattice: R. Swinbank and R. J. Purser, "Fibonacci grids", 2006.)
"""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.options import Sampling
from aoprecalc.types import Float64Array

INV_GOLDEN_RATIO = (np.sqrt(5.0) - 1.0) / 2.0
_TURN = 0.137  # of a whole one: keeps the first axes away from the planes in which people model


def fibonacci_hemisphere(index: NDArray[np.int64], count: int, turn: float = 0.0) -> Float64Array:
    """Return the points number `index`, of any shape, of the lattice of `count`, (..., 3) float64.

    turn   of the lattice about z, as a share of a whole one: lattices of different turns have no point in common
    """
    z = (index + 0.5) / count
    angle = 2.0 * np.pi * ((index * INV_GOLDEN_RATIO + _TURN + turn) % 1.0)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=-1)


# Two directions at right angles to a given one.


def orthonormal_basis(units: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return two unit vectors, (k, 3) each, that make a right-handed frame with each of (k, 3) unit vectors.

    (J. R. Frisvad, 2012; T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.)
    """
    x, y, z = units.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    across = np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    upward = np.column_stack([b, sign + y * y * a, -y])
    return across, upward


# Directions of light, uniform on the sphere, as axes: a direction and its opposite share one rendering pass.
#
# Even sets follow the Fibonacci lattice, which in its own order sweeps from pole to equator; it is visited
# with a stride that makes every run of GROUP axes an even set too.

GROUP_SIZE = 64  # axes that share a sub-texel offset; also the runs that are even by themselves
_PLASTIC = 1.324717957244746  # of R2, the sequence for offsets
_MOST_STRIDES = 400


def light_axes(directions: int, sampling: Sampling = "fibonacci", seed: int = 0) -> Float64Array:
    """Return ceil(directions / 2) unit vectors, (a, 3) float64; each stands for itself and its opposite.

    fibonacci ignores the seed; random draws from it, uniformly on the sphere.
    """
    count = (directions + 1) // 2
    if sampling == "random":
        vectors = np.random.default_rng(seed).normal(size=(count, 3))
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        return vectors
    return fibonacci_hemisphere(np.arange(count) * _stride(count) % count, count)


def axis_groups(count: int) -> list[slice]:
    """Return the runs of GROUP axes, the last one possibly shorter, in the order in which they are summed."""
    return [slice(start, min(start + GROUP_SIZE, count)) for start in range(0, count, GROUP_SIZE)]


def texel_offset(group: int) -> tuple[float, float]:
    """Return where in a texel's unit square the samples of group number `group` lie; the first at its centre.

    Even and odd groups each follow the R2 sequence (M. Roberts, "Quasirandom sequences", 2018), the odd ones moved
    aside, so that either half of the groups covers the square by itself.
    """
    pair, odd = divmod(group, 2)
    right, down = 0.5 + pair / _PLASTIC + odd * INV_GOLDEN_RATIO, 0.5 + pair / _PLASTIC**2 + odd * INV_GOLDEN_RATIO**2
    return right % 1.0, down % 1.0


def _stride(count: int) -> int:
    """Return the step through the lattice, prime to its size, whose first run of GROUP axes is most even.

    Later runs are the same pattern moved along the lattice. Evenness is the potential energy of the run, with each axis
    repelling the others from both its ends.
    """
    if count <= GROUP_SIZE:
        return 1
    strides = np.arange(1, count, dtype=np.int64)
    strides = strides[np.gcd(strides, count) == 1][:_MOST_STRIDES]
    chunks = fibonacci_hemisphere(strides[:, None] * np.arange(GROUP_SIZE) % count, count)
    cosines = np.abs(chunks @ chunks.transpose(0, 2, 1))
    cosines[:, np.arange(GROUP_SIZE), np.arange(GROUP_SIZE)] = 0.0
    energy = (1.0 / np.sqrt(np.maximum(1.0 - cosines**2, 1e-12))).sum(axis=(1, 2))
    return int(strides[np.argmin(energy)])
