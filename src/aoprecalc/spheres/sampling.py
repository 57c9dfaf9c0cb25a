"""The coordinates in which spheres are fitted: the mesh's box, centred and scaled to [-1, 1]."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.mesh.normals import face_normals
from aoprecalc.mesh.sampling import fold_to_triangle, pick_faces
from aoprecalc.types import Float64Array, Scene


@dataclass(frozen=True, eq=False)
class NormalizedFrame:
    """Moves a mesh to the origin and scales it, so that its place and size in the file do not matter.

    center     (3,) float64: the middle of the mesh's bounding box, in the mesh's units
    scale      half the longest side of the box, in the mesh's units, > 0
    diagonal   of the box, in units of `scale`: 2 to 2 sqrt(3); 0 for a single point
    """

    center: Float64Array
    scale: float
    diagonal: float

    @classmethod
    def from_positions(cls, positions: Float64Array) -> Self:
        """Frame the bounding box of finite positions, (v, 3) float64, v >= 1."""
        low, high = positions.min(axis=0) / 2, positions.max(axis=0) / 2  # halved first: no sum overflows
        half = high - low
        scale = float(half.max()) or 1.0
        return cls(low + high, scale, 2 * float(np.linalg.norm(half / scale)))

    def to_normalized(self, positions: Float64Array) -> Float64Array:
        """Bring positions, (..., 3) float64, from the mesh's coordinates into the frame."""
        return (positions - self.center) / self.scale

    def from_normalized(self, positions: Float64Array) -> Float64Array:
        """Bring positions, (..., 3) float64, from the frame back to the mesh's coordinates."""
        return positions * self.scale + self.center


# Points drawn uniformly on a surface (section 1.2.1 of *Précalcul*): a face by its area, then a point in the face.

_BLOCK = 1 << 17  # points drawn at a time, so that memory beyond the result stays small


def sample_surface(
    scene: Scene, frame: NormalizedFrame, count: int, distinct: int, rng: np.random.Generator
) -> Float64Array:
    """Draw `count` points uniformly on the surface, at least `distinct` of them different.

    The first points do not depend on `count`, but for the rounding of `on_grid`.

    Returns (count, 3) float64 in the frame, each coordinate in [-1, 1] and on the grid of `on_grid`.
    Raises InputError where the surface has no area, and where it is too small for `distinct` points.
    """
    corners, upto = _surface(scene, frame)
    points = np.empty((count, 3))
    for start in range(0, count, _BLOCK):
        block = points[start : start + _BLOCK]
        where, along, across = rng.random((len(block), 3)).T
        block[:] = _inside(corners[pick_faces(upto, where)], *fold_to_triangle(along, across))
    points = round_to_grid(points)
    if (found := _distinct(points, distinct)) < distinct:
        raise InputError(
            f"{scene.path}: the {count} samples fall on {found} distinct points, fewer than the {distinct} spheres "
            "that start there; ask for fewer spheres or more samples"
        )
    return points


def sample_surface_with_normals(
    scene: Scene, frame: NormalizedFrame, count: int, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Draw points uniformly on the surface; returns them, in the frame, and their faces' unit normals, (count, 3) each.

    Raises InputError where the surface has no area.
    """
    corners, upto = _surface(scene, frame)
    where, along, across = rng.random((count, 3)).T
    chosen = corners[pick_faces(upto, where)]
    return _inside(chosen, *fold_to_triangle(along, across)), face_normals(chosen)[0]


def round_to_grid(points: Float64Array) -> Float64Array:
    """Round (s, 3) coordinates in [-1, 1] to multiples of the power of two that makes the sum of any of them exact.

    A sum then depends neither on its order nor on its history, and the rounding noise that comes from where the
    mesh lies and how large it is vanishes. The step is 2^-35 of half the box for 100,000 samples.
    """
    step = 2.0 ** (int(len(points) - 1).bit_length() - 52)
    return np.asarray(np.rint(points / step) * step + 0.0, np.float64)  # + 0.0: no negative zeros, equal is identical


def _surface(scene: Scene, frame: NormalizedFrame) -> tuple[Float64Array, Float64Array]:
    """The faces' corners in the frame, (f, 3, 3), and twice the area of each face and all before it, (f,)."""
    corners = frame.to_normalized(scene.corners)
    upto = np.cumsum(_areas(corners, scene, frame))
    if upto[-1] == 0:
        raise InputError(
            f"{scene.path}: the surface has no area (all {len(corners)} faces are points or lines), "
            "but spheres are fitted to points on it; repair the mesh"
        )
    return corners, upto


def _areas(corners: Float64Array, scene: Scene, frame: NormalizedFrame) -> Float64Array:
    """(f,) twice the faces' areas in the frame; 0 where rounding of the coordinates could account for all of it."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.linalg.norm(np.cross(first, second), axis=1)
    longest = np.sqrt(np.maximum((first**2).sum(axis=1), (second**2).sum(axis=1)))
    rounding = np.finfo(np.float64).eps * max(1.0, float(np.abs(scene.positions).max() / frame.scale))
    return np.where(areas > 4 * rounding * longest, areas, 0.0)


def _inside(corners: Float64Array, along: Float64Array, across: Float64Array) -> Float64Array:
    """Points of triangles, (k, 3, 3), at shares of their first and third side."""
    origin = corners[:, 0]
    return origin + along[:, None] * (corners[:, 1] - origin) + across[:, None] * (corners[:, 2] - origin)


def _distinct(points: Float64Array, enough: int) -> int:
    """Count distinct points; any number from `enough` upwards may stand for more."""
    head = len(np.unique(points[: 2 * enough], axis=0))  # nearly always enough, and far faster than all
    return head if head >= enough else len(np.unique(points, axis=0))
