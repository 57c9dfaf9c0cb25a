"""A surface as visibility is computed on it, in the unit sphere and with its occluders; and random points on it."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normals import area_vectors, geometric_normals, normalize
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


# Points uniform on a surface: a face by its area, then a point in the face (Précalcul, section 1.2.1).


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
