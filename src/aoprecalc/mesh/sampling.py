"""From numbers in [0, 1) to places spread uniformly over a surface: a face by its area, then a point in the face.

(Section 1.2.1 of *Précalcul*.)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normals import area_vectors
from aoprecalc.mesh.unit_sphere import to_unit_sphere
from aoprecalc.types import BoolArray, Float64Array, Scene


def pick_faces(upto: Float64Array, where: Float64Array) -> NDArray[np.intp]:
    """Return the face at each of k numbers in [0, 1]; one without area is never met.

    upto   (f,) the areas of each face and all before it; the last is > 0
    """
    faces: NDArray[np.intp] = np.searchsorted(upto, np.minimum(where * upto[-1], np.nextafter(upto[-1], 0)), "right")
    return faces


def fold_to_triangle(along: Float64Array, across: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Fold numbers in [0, 1), which span a parallelogram, into the triangle that is its half."""
    beyond = along + across > 1
    return np.where(beyond, 1 - along, along), np.where(beyond, 1 - across, across)


# Points spread uniformly over a surface, as places on its faces.


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Places on the faces of a scene.

    faces     (k,) face numbers
    weights   (k, 3) float64 of the faces' corners, each row sums to 1
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
    """Draw `count` points uniformly by area from the faces in `covers`, (f,) bool; some of these must have area.

    The faces laid end to end are cut into `count` pieces of equal area, and each piece has one point: how many fall on
    a region varies far less than if each were drawn from all of them.
    """
    areas = np.linalg.norm(area_vectors(to_unit_sphere(scene.positions)[scene.faces]), axis=1) * mapped
    rng = np.random.default_rng(seed)
    where = (np.arange(count) + rng.random(count)) / count
    along, across = fold_to_triangle(rng.random(count), rng.random(count))
    return SurfacePoints(pick_faces(np.cumsum(areas), where), np.column_stack([1 - along - across, along, across]))
