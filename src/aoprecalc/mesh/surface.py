"""A surface: its normals, its occluders at the scale at which visibility is computed, and random points on it."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.mesh.masked_triangles import cut_triangles
from aoprecalc.mesh.opaque_triangles import opaque_triangles
from aoprecalc.mesh.topology import adjacent_half_edges, joined_faces
from aoprecalc.options import Normals
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene

_SMOOTH_ANGLE = 180.0  # degrees: no edge is hard
_STL_ANGLE = 40.0  # STL stores no smooth normals: sharper edges were probably meant to be hard
_FOLDED = 175.0  # degrees
# Twice the area of a face over its longest edge squared, below which doubles cannot tell its direction.
_MIN_FLATNESS = 1e-12
_FAR = 8  # extents of a mesh between it and the origin, beyond which positions are stored about an origin of their own
_MAX_FLOAT = 1e38  # of positions that nobody looks at
_NO_TRIANGLES = np.zeros((0, 3, 3))
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
    first, second = first[gentle], second[gentle]
    joined_from, joined_to = [], []
    for end in (0, 1):
        corner = first // 3 * 3 + (first % 3 + end) % 3
        for other_end in (0, 1):
            other = second // 3 * 3 + (second % 3 + other_end) % 3
            same = faces.ravel()[corner] == faces.ravel()[other]
            joined_from.append(corner[same])
            joined_to.append(other[same])
    return joined_faces(faces.size, np.concatenate(joined_from), np.concatenate(joined_to)).reshape(faces.shape)


def _unit(vectors: Float64Array, empty: tuple[float, float, float] = _Z_AXIS) -> Float64Array:
    """Normalize (m, 3) vectors of any scale; zero vectors become `empty`."""
    # Scaled first: the squared length of a tiny vector would underflow.
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    return np.where(largest > 0, normalize(vectors / np.where(largest > 0, largest, 1.0)), empty)


@dataclass(frozen=True, eq=False)
class NormalizedSurface:
    """What receives light within 1 of the origin, where 32-bit floats resolve 1e-7, and what stops it.

    positions          (v, 3) float32; those that do not receive may lie farther away
    faces              (f, 3) int32 into positions
    shading_normals    (f, 3, 3) float32: the unit shading normals n at the corners
    geometric_normals  (f, 3) float32: the unit geometric normals g, zero for faces without area
    occluders          (o, 3, 3) float32, o >= 1: the corners of the triangles that stop light, within 1 of the origin
                       too, or far from it: see `from_scene`
    receiving_points   (r, 3) float32: the positions that receive
    has_outer_occluders   something occludes that does not receive, and so may reach beyond the receiving points
    ground_normal      the unit vector away from the infinite ground plane; None where there is none
    unit               the length of 1 in the units of the mesh
    """

    positions: Float32Array
    faces: Int32Array
    shading_normals: Float32Array
    geometric_normals: Float32Array
    occluders: Float32Array
    receiving_points: Float32Array
    has_outer_occluders: bool
    ground_normal: tuple[float, float, float] | None
    unit: float

    @classmethod
    def from_scene(cls, scene: Scene, shading: Float32Array) -> Self:
        """Normalize a scene with (f, 3, 3) shading normals.

        All that receives or occludes lies within 1 of the origin, unless what receives would be smaller than half of
        that: then it lies within 1/2 of the origin, and large occluders around it are cut, see `cut_by_distance`.
        """
        receiving = positions_of(scene, scene.receives)
        around = _NO_TRIANGLES if scene.surroundings is None else scene.surroundings
        shown = positions_of(scene, scene.receives | scene.occludes)
        center, radius = bounding_sphere(np.concatenate([shown, around.reshape(-1, 3)]))
        own_center, own_radius = bounding_sphere(receiving)
        has_far_occluders = radius > 2 * own_radius
        if has_far_occluders:
            center, radius = own_center, 2 * own_radius

        def normalized(positions: Float64Array) -> Float64Array:
            scaled: Float64Array = (positions - center) / radius
            return scaled

        occluders = normalized(np.concatenate([opaque_triangles(scene), around]))
        if has_far_occluders:
            occluders = cut_by_distance(occluders)
        return cls(
            positions=np.clip(normalized(scene.positions), -_MAX_FLOAT, _MAX_FLOAT).astype(np.float32),
            faces=scene.faces,
            shading_normals=shading,
            geometric_normals=geometric_normals(scene, shading),
            # Renderers and ray tracers need at least one triangle; this one has no area.
            occluders=occluders.astype(np.float32) if len(occluders) else np.zeros((1, 3, 3), np.float32),
            receiving_points=normalized(receiving).astype(np.float32),
            has_outer_occluders=bool((scene.occludes & ~scene.receives).any() or len(around)),
            ground_normal=scene.ground_normal,
            unit=radius,
        )

    def is_below_ground(self, directions: NDArray[np.floating]) -> BoolArray:
        """Return which of (..., 3) directions point down to the ground plane; horizontal ones do not."""
        below: BoolArray = np.zeros(directions.shape[:-1], bool)
        return (
            below if self.ground_normal is None else directions @ np.asarray(self.ground_normal, directions.dtype) < 0
        )

    @property
    def ground_height(self) -> float:
        """The height of the ground plane along its normal, in normalized units: the lowest point is on it."""
        up = np.asarray(self.ground_normal)
        return float(min((self.receiving_points @ up).min(), (self.occluders @ up).min()))

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


def positions_of(scene: Scene, chosen: BoolArray) -> Float64Array:
    """Return the positions, (r, 3), of the faces in `chosen`, (f,) bool."""
    return scene.positions if chosen.all() else scene.positions[np.unique(scene.faces[chosen])]


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


# Occluders around what receives.

_NEST = 4.0  # sides of a box over those of the next smaller one
# Of triangles along each axis: seen from there, what receives is a point, and 32-bit floats resolve a map texel.
_MAX_REACH = 4096.0


def cut_by_distance(triangles: Float64Array) -> Float64Array:
    """Cut triangles, (o, 3, 3), so that each is near the origin or not much larger than its distance from it.

    32-bit floats resolve a triangle to 1e-7 of its size: of a floor of 10,000 units that is more than the gap between
    it and what stands on it. So it is cut at the faces of nested boxes about the origin, of which the smallest reaches
    to 1 along the axes; what touches a box and reaches beyond the next one is cut. Corners beyond 4096 are moved
    straight towards the origin, from where everything looks the same.
    """
    near = np.maximum(triangles.min(axis=1), -triangles.max(axis=1)).max(axis=1)  # of the bounding box, at most
    far = np.abs(triangles).max(axis=(1, 2))
    large = far > _NEST * np.maximum(near, 1)
    kept, large_ones = [triangles[~large]], triangles[large]
    boxes = math.ceil(math.log(far[large].max(initial=1.0), _NEST))
    for size in _NEST ** np.arange(boxes)[::-1]:
        touching = (large_ones.min(axis=1) < size).all(axis=1) & (large_ones.max(axis=1) > -size).all(axis=1)
        cut = touching & (np.abs(large_ones).max(axis=(1, 2)) > _NEST * size)
        kept.append(large_ones[~touching])
        waiting, inside = large_ones[touching & ~cut], large_ones[cut]
        for axis in range(3):
            for sign in (1, -1):
                inside, outside = _split(inside, sign * inside[:, :, axis] - size)
                kept.append(outside)
        large_ones = np.concatenate([waiting, inside])
    pieces = np.concatenate([*kept, large_ones])
    reach = np.abs(pieces).max(axis=2, keepdims=True)
    nearer: Float64Array = pieces * (_MAX_REACH / np.maximum(reach, _MAX_REACH))
    return nearer


def _split(triangles: Float64Array, values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Cut (m, 3, 3) triangles where linear values at their corners, (m, 3), are zero; return negative and positive."""
    negative, positive = (values <= 0).all(axis=1), (values >= 0).all(axis=1)
    crossed = ~negative & ~positive
    order, shares = cut_triangles(values[crossed])
    one, *others = np.take_along_axis(triangles[crossed], order[:, :, None], axis=1).transpose(1, 0, 2)
    first, second = (one + share[:, None] * (other - one) for share, other in zip(shares.T, others, strict=True))
    single = np.stack([one, first, second], axis=1)
    rest = np.stack([first, others[0], others[1], first, others[1], second], axis=1).reshape(-1, 3, 3)
    above = values[crossed, order[:, 0]] >= 0
    below_twice = np.repeat(~above, 2)
    return (
        np.concatenate([triangles[negative], single[~above], rest[~below_twice]]),
        np.concatenate([triangles[positive & ~negative], single[above], rest[below_twice]]),
    )


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
