"""A scene's surface as visibility is computed on it: in the unit sphere, with the normals of both kinds."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles, Floats, Ints, Scene
from aoprecalc.surface.normals import geometric_normals


@dataclass(frozen=True, eq=False)
class UnitSurface:
    """A surface within 1 of the origin, where 32-bit floats resolve 1e-7.

    positions   (v, 3) float32
    faces       (f, 3) int32 into positions
    shading     (f, 3, 3) float32: the unit shading normals n at the corners
    geometric   (f, 3) float32: the unit geometric normals g, zero for faces without area
    """

    positions: Floats
    faces: Ints
    shading: Floats
    geometric: Floats

    @classmethod
    def of(cls, scene: Scene, shading: Floats) -> Self:
        """Take a scene and its (f, 3, 3) shading normals."""
        positions = centred(scene.positions).astype(np.float32)
        return cls(positions, scene.faces, shading, geometric_normals(scene, shading))

    def turned(self) -> Self:
        """Return the surface with its other side in front."""
        return replace(self, shading=-self.shading, geometric=-self.geometric)

    def at(self, faces: NDArray[np.integer], weights: NDArray[np.floating]) -> tuple[Doubles, Doubles, Doubles]:
        """Return positions, n and g, (k, 3) float64 each, at k points: their faces and (k, 3) barycentric weights.

        Where n would leave the surface's own side (n.g <= 0) it is g.
        """
        at = weights.astype(np.float64)
        positions = np.einsum("kc,kcx->kx", at, self.positions[self.faces[faces]])
        geometric = self.geometric[faces].astype(np.float64)
        shading = np.einsum("kc,kcx->kx", at, self.shading[faces])
        opposed = np.einsum("kx,kx->k", shading, geometric) <= 0
        shading[opposed] = geometric[opposed]
        lengths = np.linalg.norm(shading, axis=1, keepdims=True)
        return positions, shading / np.where(lengths > 0, lengths, 1), geometric


def centred(positions: Doubles) -> Doubles:
    """Move and scale (v, 3) positions into the unit sphere about the middle of their box."""
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    moved = positions - middle
    radius = np.sqrt((moved**2).sum(axis=1).max())
    scaled: Doubles = moved / (radius if radius > 0 else 1.0)
    return scaled
