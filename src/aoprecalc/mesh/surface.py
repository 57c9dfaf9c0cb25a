"""A surface: its normals, its extent, and random points on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.mesh.topology import adjacent_half_edges, corner_groups
from aoprecalc.options import Normals
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene

_SMOOTH_ANGLE = 180.0  # degrees: no edge is hard
_STL_ANGLE = 40.0  # STL stores no smooth normals: sharper edges were probably meant to be hard
_FOLDED = 175.0  # degrees
# Twice the area of a face over its longest edge squared, below which doubles cannot tell its direction.
_MIN_FLATNESS = 1e-12
_FAR = 8  # extents of a mesh between it and the origin, beyond which positions are stored about an origin of their own
_ZERO, _Z_AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def normalize(vectors: NDArray[np.floating]) -> Float64Array:
    """Divide (..., 3) vectors by their lengths; zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Float64Array = vectors / np.where(lengths > 0, lengths, 1)
    return units


def area_vectors(corners: Float64Array) -> Float64Array:
    """Return twice the area of each face times its unit normal, (f, 3), from (f, 3, 3) corners; follows the winding."""
    vectors: Float64Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return vectors


def barycentric_weights(faces: Float64Array, points: Float64Array) -> Float64Array:
    """Return the weights of the corners of (o, 3, 3) triangles at three points of each, (o, 3, 3): points, corners."""
    sides, places = faces[:, 1:] - faces[:, :1], points - faces[:, :1]
    size = np.abs(sides).max(axis=(1, 2), keepdims=True)
    sides, places = (vectors / np.where(size > 0, size, 1) for vectors in (sides, places))
    of_sides = places @ np.linalg.pinv(sides)  # without area: the least weights
    weights: Float64Array = np.concatenate([1 - of_sides.sum(axis=2, keepdims=True), of_sides], axis=2)
    weights[(faces == points).all(axis=(1, 2))] = np.eye(3)
    return weights


def face_normals(corners: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Return (f, 3) unit normals that follow the winding, and which faces have area, (f,) bool, from (f, 3, 3) corners.

    The normal of a face without area is (0, 0, 1). Only the shape of a face matters, not its scale.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1, keepdims=True)
    sides = sides / np.where(longest > 0, longest, 1)[:, :, None]
    normals = np.cross(sides[:, 0], sides[:, 1])
    has_area: BoolArray = np.linalg.norm(normals, axis=1) > _MIN_FLATNESS
    return np.where(has_area[:, None], normalize(normals), _Z_AXIS), has_area


def local_origin(positions: Float64Array) -> Float64Array:
    """Return an origin, (3,), about which float32 holds (n, 3) positions to 1e-7 of their extent.

    (0, 0, 0) where it does so anyway: where no coordinate is beyond 8 times the extent, as on maps. The origin is
    then their middle, rounded so that differences from it are exact in float64.
    """
    low, high = positions.min(axis=0), positions.max(axis=0)
    extent = (high - low).max()
    if np.abs(positions).max() <= _FAR * extent:
        return np.zeros(3)
    step = 2.0 ** np.floor(np.log2(extent))
    return np.asarray(np.round((low / 2 + high / 2) / step) * step + 0.0)


def default_crease_angle(scene: Scene) -> float:
    """Return the dihedral angle in degrees beyond which edges are hard, unless the user says another."""
    return _STL_ANGLE if scene.format == "stl" else _SMOOTH_ANGLE


def shading_normals(scene: Scene, mode: Normals = "auto", crease_angle: float | None = None) -> Float32Array:
    """Return unit shading normals at the corners, (f, 3, 3) float32.

    mode          auto: the file's, else smooth; file: the file's; flat: the face normal; smooth: the area-weighted mean
                  of the faces around a position, split at edges whose dihedral angle exceeds `crease_angle`
    crease_angle  degrees in [0, 180]; None: 180, and 40 for STL
    Raises InputError for mode file where the file has no normals.
    """
    if mode == "file" and scene.normals is None:
        raise InputError(f"{scene.path}: has no normals, which --normals file asks for; use --normals auto or smooth")
    if mode in ("auto", "file") and scene.normals is not None:
        return scene.normals
    if mode == "flat":
        return np.repeat(_unit(area_vectors(scene.corners))[:, None], 3, axis=1).astype(np.float32)
    angle = default_crease_angle(scene) if crease_angle is None else crease_angle
    return smooth_normals(scene.positions, scene.faces, angle)


def smooth_normals(positions: Float64Array, faces: Int32Array, crease_angle: float = _SMOOTH_ANGLE) -> Float32Array:
    """Return unit normals at the corners of faces over welded positions, (f, 3, 3) float32; see `shading_normals`."""
    areas = area_vectors(positions[faces])
    flat = np.repeat(_unit(areas)[:, None], 3, axis=1)
    groups = faces
    if crease_angle < _SMOOTH_ANGLE:
        groups = _smooth_groups(faces, _unit(areas, empty=_ZERO), crease_angle)
    of_corner = groups.ravel()
    sums: Float64Array = np.column_stack([np.bincount(of_corner, np.repeat(areas[:, axis], 3)) for axis in range(3)])
    # Where opposite faces cancel there is no mean: their corners keep the face normal.
    total_area = np.bincount(of_corner, np.repeat(np.linalg.norm(areas, axis=1), 3))
    cancelled = np.linalg.norm(sums, axis=1) <= 1e-9 * total_area
    smooth = np.where(cancelled[groups][..., None], flat, _unit(sums)[groups])
    return smooth.astype(np.float32)


def geometric_normals(scene: Scene, shading: Float32Array) -> Float32Array:
    """Return the unit normal of each face, (f, 3) float32, zero for faces without area.

    It follows the winding, but is flipped where the shading normals at all three corners oppose it.
    """
    normals = _unit(area_vectors(scene.corners), empty=_ZERO)
    opposed = (np.einsum("fcx,fx->fc", shading, normals) < 0).all(axis=1)
    return np.where(opposed[:, None], -normals, normals).astype(np.float32)


def share_at_bends(scene: Scene, angle: float) -> float:
    """Return the share of the receiving surface, in [0, 1], whose faces have an edge that bends more than `angle`.

    angle   in degrees; edges at which the surface turns back on itself are not counted: the sides of a thin sheet
    """
    areas = area_vectors(scene.corners)
    first, second, cosine = _bends(scene.faces, _unit(areas, empty=_ZERO))
    bent = (cosine < np.cos(np.radians(angle))) & (cosine > np.cos(np.radians(_FOLDED)))
    at_bend = np.zeros(len(scene.faces), bool)
    at_bend[first[bent] // 3] = at_bend[second[bent] // 3] = True
    sizes = np.linalg.norm(areas, axis=1) * scene.receives
    return float(sizes[at_bend].sum() / max(sizes.sum(), np.finfo(float).tiny))


def _bends(faces: Int32Array, normals: Float64Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Float64Array]:
    """Return pairs of half edges, (p,) each, as `adjacent_half_edges` does, and the cosines of the angles they bend.

    normals   (f, 3), of unit length; zero for faces without area: these have no direction to bend from, the cosine is 1
    """
    first, second = adjacent_half_edges(faces)
    cosine = np.einsum("ex,ex->e", normals[first // 3], normals[second // 3])
    no_area: BoolArray = np.linalg.norm(normals, axis=1) == 0
    return first, second, np.where(no_area[first // 3] | no_area[second // 3], 1.0, cosine)


def _smooth_groups(faces: Int32Array, normals: Float64Array, angle: float) -> Int32Array:
    """Label corners, (f, 3): equal where faces around a position are joined by edges that bend at most `angle`."""
    first, second, cosine = _bends(faces, normals)  # a face without area joins its neighbours
    gentle = cosine >= np.cos(np.radians(angle)) - 1e-9
    return corner_groups(faces, first[gentle], second[gentle])


def _unit(vectors: Float64Array, empty: tuple[float, float, float] = _Z_AXIS) -> Float64Array:
    """Normalize (m, 3) vectors of any scale; zero vectors become `empty`."""
    # Scaled first: the squared length of a tiny vector would underflow.
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    return np.where(largest > 0, normalize(vectors / np.where(largest > 0, largest, 1.0)), empty)


def positions_of(scene: Scene, chosen: BoolArray) -> Float64Array:
    """Return the positions, (r, 3), of the faces in `chosen`, (f,) bool."""
    return scene.positions if chosen.all() else scene.positions[np.unique(scene.faces[chosen])]


def receiving_diagonal(scene: Scene) -> float:
    """Return the diagonal of the bounding box of what receives light, in the units of the mesh."""
    return float(np.linalg.norm(np.ptp(positions_of(scene, scene.receives), axis=0)))


def absolute_length(length: float | str, scene: Scene) -> float:
    """Return a length in the units of the mesh, which may be given as a share of `receiving_diagonal` such as 10%."""
    if isinstance(length, str):
        return float(length.rstrip("%")) / 100 * receiving_diagonal(scene)
    return length


def to_unit_sphere(positions: Float64Array) -> Float64Array:
    """Move and scale (v, 3) positions into the unit sphere about the centre of their bounding box."""
    center, radius = bounding_sphere(positions)
    scaled: Float64Array = (positions - center) / radius
    return scaled


def bounding_box(points: Float64Array) -> Float64Array:
    """Return the least and the greatest coordinates of (..., 3) points, at least one, (2, 3)."""
    points = points.reshape(-1, 3)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def diagonal(box: Float64Array) -> float:
    """Return the length of the diagonal of a box, (2, 3)."""
    return float(np.linalg.norm(box[1] - box[0]))


def box_distance(box: Float64Array, other: Float64Array) -> float:
    """Return the distance between two boxes, (2, 3) each; 0 where they touch or overlap."""
    return float(np.linalg.norm(np.maximum(np.maximum(other[0] - box[1], box[0] - other[1]), 0)))


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

    def select(self, chosen: BoolArray) -> "SurfacePoints":
        """Return those of a mask, (k,) bool."""
        return SurfacePoints(self.faces[chosen], self.weights[chosen])

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
