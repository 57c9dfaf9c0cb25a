"""Points spread uniformly over a surface, as places on its faces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles, Mask, Scene
from aoprecalc.surface.normals import area_vectors
from aoprecalc.surface.uniform import faces_by_area, folded
from aoprecalc.surface.unit import centred


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Places on the faces of a scene.

    faces     (k,) face numbers
    weights   (k, 3) float64 of the faces' corners, each row sums to 1
    """

    faces: NDArray[np.intp]
    weights: Doubles

    def __len__(self) -> int:
        return len(self.faces)

    def at(self, corners: NDArray[np.floating]) -> Doubles:
        """Interpolate values at the corners of all faces, (f, 3, c), to the points, (k, c) float64."""
        values: Doubles = np.einsum("kc,kcx->kx", self.weights, corners[self.faces].astype(np.float64))
        return values


def spread_points(scene: Scene, covers: Mask, count: int, seed: int) -> SurfacePoints:
    """Draw `count` points uniformly by area from the faces in `covers`, (f,) bool; some of these must have area.

    The faces laid end to end are cut into `count` pieces of equal area, and each piece has one point: how many fall on
    a region varies far less than if each were drawn from all of them.
    """
    areas = np.linalg.norm(area_vectors(centred(scene.positions)[scene.faces]), axis=1) * covers
    rng = np.random.default_rng(seed)
    where = (np.arange(count) + rng.random(count)) / count
    along, across = folded(rng.random(count), rng.random(count))
    return SurfacePoints(faces_by_area(np.cumsum(areas), where), np.column_stack([1 - along - across, along, across]))
