"""Points uniform on a surface: a face by its area, then a point in the face (Précalcul, section 1.2.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normals import area_vectors
from aoprecalc.mesh.unit_sphere import to_unit_sphere
from aoprecalc.types import BoolArray, Float64Array, Scene


def pick_faces(cumulative_areas: Float64Array, u: Float64Array) -> NDArray[np.intp]:
    """Return the face for each of k numbers in [0, 1), with probability proportional to its area.

    cumulative_areas   (f,) the area of each face and all before it; the last is > 0
    """
    total = cumulative_areas[-1]
    faces: NDArray[np.intp] = np.searchsorted(cumulative_areas, np.minimum(u * total, np.nextafter(total, 0)), "right")
    return faces


def fold_to_triangle(u: Float64Array, v: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Fold pairs of numbers in [0, 1), uniform on a parallelogram, into the triangle that is its half."""
    outside = u + v > 1
    return np.where(outside, 1 - u, u), np.where(outside, 1 - v, v)


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on the faces of a scene.

    faces     (k,) face indices
    weights   (k, 3) float64, barycentric: each row sums to 1
    """

    faces: NDArray[np.intp]
    weights: Float64Array

    def __len__(self) -> int:
        return len(self.faces)

    def interpolate(self, corners: NDArray[np.floating]) -> Float64Array:
        """Interpolate values at the corners of all faces, (f, 3, c), to the points, (k, c) float64."""
        values: Float64Array = np.einsum("kc,kcx->kx", self.weights, corners[self.faces].astype(np.float64))
        return values


def sample_surface(scene: Scene, mapped: BoolArray, count: int, seed: int) -> SurfacePoints:
    """Draw `count` points uniformly by area from the faces in `mapped`, (f,) bool; some of these must have area.

    The points are stratified: the faces laid end to end are cut into `count` strata of equal area with one point each,
    so that the number in any region varies far less than with independent points.
    """
    areas = np.linalg.norm(area_vectors(to_unit_sphere(scene.positions)[scene.faces]), axis=1) * mapped
    rng = np.random.default_rng(seed)
    u = (np.arange(count) + rng.random(count)) / count
    second, third = fold_to_triangle(rng.random(count), rng.random(count))
    return SurfacePoints(pick_faces(np.cumsum(areas), u), np.column_stack([1 - second - third, second, third]))
