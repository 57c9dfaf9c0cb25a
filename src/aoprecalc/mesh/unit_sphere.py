"""A scene's surface as visibility is computed on it: in the unit sphere, with normals of both kinds and occluders."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normals import geometric_normals, normalize
from aoprecalc.mesh.opaque_triangles import opaque_triangles
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene


@dataclass(frozen=True, eq=False)
class NormalizedSurface:
    """A surface and its occluders, within 1 of the origin, where 32-bit floats resolve 1e-7.

    positions          (v, 3) float32; those that neither receive nor occlude may lie farther away
    faces              (f, 3) int32 into positions
    shading_normals    (f, 3, 3) float32: the unit shading normals n at the corners
    geometric_normals  (f, 3) float32: the unit geometric normals g, zero for faces without area
    occluders          (o, 3, 3) float32, o >= 1: the corners of the triangles that stop light
    bounding_points    (r, 3) float32: the positions that receive or occlude
    ground_normal      the unit vector away from the infinite ground plane; None where there is none
    """

    positions: Float32Array
    faces: Int32Array
    shading_normals: Float32Array
    geometric_normals: Float32Array
    occluders: Float32Array
    bounding_points: Float32Array
    ground_normal: tuple[float, float, float] | None

    @classmethod
    def from_scene(cls, scene: Scene, shading: Float32Array) -> Self:
        """Normalize a scene with (f, 3, 3) shading normals."""
        active = active_positions(scene)
        center, radius = bounding_sphere(active)

        def normalized(positions: Float64Array) -> Float32Array:
            return ((positions - center) / radius).astype(np.float32)

        occluders = opaque_triangles(scene)
        return cls(
            positions=normalized(scene.positions),
            faces=scene.faces,
            shading_normals=shading,
            geometric_normals=geometric_normals(scene, shading),
            # Renderers and ray tracers need at least one triangle; this one has no area.
            occluders=normalized(occluders) if len(occluders) else np.zeros((1, 3, 3), np.float32),
            bounding_points=normalized(active),
            ground_normal=scene.ground_normal,
        )

    def is_below_ground(self, directions: NDArray[np.floating]) -> BoolArray:
        """Return which of (..., 3) directions point down to the ground plane; horizontal ones do not."""
        below: BoolArray = np.zeros(directions.shape[:-1], bool)
        return (
            below if self.ground_normal is None else directions @ np.asarray(self.ground_normal, directions.dtype) < 0
        )

    def flipped(self) -> Self:
        """Return the surface with its other side in front."""
        return replace(self, shading_normals=-self.shading_normals, geometric_normals=-self.geometric_normals)

    def interpolate(
        self, faces: NDArray[np.integer], weights: NDArray[np.floating]
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return positions, n and g, (k, 3) float64 each, at k points: their faces and (k, 3) barycentric weights.

        Where n would be on the other side of the surface (n.g <= 0) it is g.
        """
        weights = weights.astype(np.float64)
        positions = np.einsum("kc,kcx->kx", weights, self.positions[self.faces[faces]])
        geometric = self.geometric_normals[faces].astype(np.float64)
        shading = np.einsum("kc,kcx->kx", weights, self.shading_normals[faces])
        opposed = np.einsum("kx,kx->k", shading, geometric) <= 0
        shading[opposed] = geometric[opposed]
        return positions, normalize(shading), geometric


def active_positions(scene: Scene) -> Float64Array:
    """Return the positions, (r, 3), of the faces that receive or occlude."""
    active = scene.receives | scene.occludes
    return scene.positions if active.all() else scene.positions[np.unique(scene.faces[active])]


def to_unit_sphere(positions: Float64Array) -> Float64Array:
    """Move and scale (v, 3) positions into the unit sphere about the centre of their bounding box."""
    center, radius = bounding_sphere(positions)
    scaled: Float64Array = (positions - center) / radius
    return scaled


def bounding_sphere(positions: Float64Array) -> tuple[Float64Array, float]:
    """Return the centre of the bounding box of (v, 3) positions and their greatest distance from it; 1 for a point."""
    center: Float64Array = (positions.min(axis=0) + positions.max(axis=0)) / 2
    radius = float(np.sqrt(((positions - center) ** 2).sum(axis=1).max()))
    return center, radius if radius > 0 else 1.0
