"""A surface at the scale at which visibility is computed: what receives light, and the triangles that stop it."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.masked_triangles import cut_triangles
from aoprecalc.mesh.opaque_triangles import opaque_pieces, opaque_triangles
from aoprecalc.mesh.roles import with_parts
from aoprecalc.mesh.surface import area_vectors, bounding_sphere, geometric_normals, normalize, positions_of
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.types import REVERSED_WINDING, BoolArray, Float32Array, Float64Array, Ground, Int32Array, Scene

_MAX_FLOAT = 1e38  # of positions that nobody looks at
_NO_TRIANGLES = np.zeros((0, 3, 3))
ON_GROUND = 1e-5  # below the ground plane, over the bounding radius, up to which a point is on it


@dataclass(frozen=True, eq=False)
class NormalizedSurface:
    """What receives light within 1 of the origin, where 32-bit floats resolve 1e-7, and what stops it.

    positions          (v, 3) float32; those that do not receive may lie farther away
    faces              (f, 3) int32 into positions
    shading_normals    (f, 3, 3) float32: the unit shading normals n at the corners
    geometric_normals  (f, 3) float32: the unit geometric normals g, zero for faces without area
    occluders          (o, 3, 3) float32, o >= 1: the corners of the triangles that stop light, within 1 of the origin
                       too, or far from it: see `from_scene`
    one_sided          how many of them, the first ones, occlude only what is in front of them
    receiving_points   (r, 3) float32: the positions that receive
    has_outer_occluders   something occludes that does not receive, and so may reach beyond the receiving points
    ground_normal      the unit vector away from the infinite ground plane; None where there is none
    ground_height      of that plane along its normal, 0 without one
    buried             the plane may lie above some of what receives, which then is dark
    unit               the length of 1 in the units of the mesh
    groups             the surfaces of parts that the others do not occlude; None where all occlude each other
    """

    positions: Float32Array
    faces: Int32Array
    shading_normals: Float32Array
    geometric_normals: Float32Array
    occluders: Float32Array
    one_sided: int
    receiving_points: Float32Array
    has_outer_occluders: bool
    ground_normal: tuple[float, float, float] | None
    ground_height: float
    buried: bool
    unit: float
    groups: "SurfaceGroups | None"

    @classmethod
    def from_scene(cls, scene: Scene, shading: Float32Array) -> Self:
        """Normalize a scene with (f, 3, 3) shading normals.

        All that receives or occludes lies within 1 of the origin, unless what receives would be smaller than half of
        that: then it lies within 1/2 of the origin, and large occluders around it are cut, see `cut_by_distance`.
        """
        receiving = positions_of(scene, scene.receives)
        shown = positions_of(scene, scene.receives | scene.occludes)
        around = scene.around.occluders
        center, radius = bounding_sphere(np.concatenate([shown, around.reshape(-1, 3)]))
        own_center, own_radius = bounding_sphere(receiving)
        has_far_occluders = radius > 2 * own_radius
        if has_far_occluders:
            center, radius = own_center, 2 * own_radius

        def normalized(positions: Float64Array) -> Float64Array:
            scaled: Float64Array = (positions - center) / radius
            return scaled

        geometric = geometric_normals(scene, shading)
        stopping_sides = [normalized(triangles) for triangles in _occluders(scene, geometric)]
        if has_far_occluders:
            stopping_sides = [cut_by_distance(triangles) for triangles in stopping_sides]
        occluders = np.concatenate(stopping_sides)
        # Renderers and ray tracers need at least one triangle; this one has no area.
        stopping = occluders.astype(np.float32) if len(occluders) else np.zeros((1, 3, 3), np.float32)
        points = normalized(receiving).astype(np.float32)
        ground = scene.around.ground
        up, height = (np.zeros(3), None) if ground is None else (np.asarray(ground.normal), ground.height)
        lowest = float(min((points @ up).min(), (stopping @ up).min()))
        ground_height = lowest if height is None else (height - float(center @ up)) / radius
        return cls(
            positions=np.clip(normalized(scene.positions), -_MAX_FLOAT, _MAX_FLOAT).astype(np.float32),
            faces=scene.faces,
            shading_normals=shading,
            geometric_normals=geometric,
            occluders=stopping,
            one_sided=len(stopping_sides[0]),
            receiving_points=points,
            has_outer_occluders=bool((scene.occludes & ~scene.receives).any() or len(around)),
            ground_normal=None if ground is None else ground.normal,
            ground_height=ground_height,
            buried=lowest < ground_height,
            unit=radius,
            groups=_groups(scene, shading),
        )

    def is_below_ground(self, directions: NDArray[np.floating]) -> BoolArray:
        """Return which of (..., 3) directions point down to the ground plane; horizontal ones do not."""
        below: BoolArray = np.zeros(directions.shape[:-1], bool)
        return (
            below if self.ground_normal is None else directions @ np.asarray(self.ground_normal, directions.dtype) < 0
        )

    def is_under_ground(self, points: NDArray[np.floating]) -> BoolArray:
        """Return which of (..., 3) points lie below the ground plane; those on it do not, within rounding."""
        if not self.buried:
            return np.zeros(points.shape[:-1], bool)
        under: BoolArray = points @ np.asarray(self.ground_normal) < self.ground_height - ON_GROUND
        return under

    def points(self, faces: NDArray[np.integer], weights: NDArray[np.floating]) -> Float64Array:
        """Return the positions, (k, 3) float64, of k points: their faces and (k, 3) barycentric weights."""
        return _weighted(weights, (np.take(self.positions, of_corner[faces], axis=0) for of_corner in self.faces.T))

    def flipped(self) -> Self:
        """Return the surface with its other side in front."""
        groups = self.groups
        if groups is not None:
            groups = replace(groups, surfaces=tuple(surface.flipped() for surface in groups.surfaces))
        shading, geometric = -self.shading_normals, -self.geometric_normals
        return replace(self, shading_normals=shading, geometric_normals=geometric, groups=groups)

    def by_group(
        self, faces: NDArray[np.integer]
    ) -> "Iterator[tuple[NormalizedSurface, NDArray[np.intp], NDArray[np.integer]]]":
        """Yield the surfaces that occlude k points, where these are among them, and their faces there.

        faces   (k,) of the points; those that do not receive, and -1 for none, are on no surface
        As a rule it is one, this itself, for all points.
        """
        if self.groups is None:
            yield self, np.arange(len(faces)), faces
            return
        group = np.where(faces >= 0, self.groups.group[faces], -1)
        order = np.argsort(group, kind="stable")
        ends = np.searchsorted(group[order], np.arange(len(self.groups.surfaces) + 1))
        for surface, start, stop in zip(self.groups.surfaces, ends[:-1], ends[1:], strict=True):
            if start < stop:
                rows = order[start:stop]
                yield surface, rows, self.groups.face[faces[rows]]

    def interpolate(
        self, faces: NDArray[np.integer], weights: NDArray[np.floating]
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return positions, n and g, (k, 3) float64 each, at k points: their faces and (k, 3) barycentric weights.

        Where n would be on the other side of the surface (n.g <= 0) it is g.
        """
        positions = self.points(faces, weights)
        geometric = self.geometric_normals[faces].astype(np.float64)
        shading = _weighted(
            weights, (np.take(normals, faces, axis=0) for normals in self.shading_normals.swapaxes(0, 1))
        )
        opposed = np.einsum("kx,kx->k", shading, geometric) <= 0
        shading[opposed] = geometric[opposed]
        return positions, normalize(shading), geometric


def _weighted(weights: NDArray[np.floating], corners: Iterable[Float32Array]) -> Float64Array:
    """Return the sum of vectors at the corners of k faces, (k, 3) each, by (k, 3) weights; einsum takes longer."""
    total: Float64Array = np.zeros(weights.shape)
    for weight, vectors in zip(weights.astype(np.float64).T, corners, strict=True):
        total += weight[:, None] * vectors
    return total


# Parts that others do not occlude.


@dataclass(frozen=True, eq=False)
class SurfaceGroups:
    """The surfaces of parts that others do not occlude, each with its own occluders, at its own scale.

    surfaces   of the faces of one group, and of what occludes every group
    group      (f,) int32: the surface on which a face receives; -1 for none
    face       (f,) int32: its index there
    """

    surfaces: tuple[NormalizedSurface, ...]
    group: Int32Array
    face: Int32Array


def _groups(scene: Scene, shading: Float32Array) -> SurfaceGroups | None:
    """Return the groups of parts that alone occlude each other; None where all do. See `Part.self_occluded`."""
    numbers = [part.self_occluded for part in scene.parts]
    groups = sorted({number for number in numbers if number is not None})
    if not groups:
        return None
    receives = scene.receives
    grounded = replace(scene, around=replace(scene.around, ground=_fixed_ground(scene)))
    surfaces: list[NormalizedSurface] = []
    group, face = np.full(len(scene.faces), -1, np.int32), np.zeros(len(scene.faces), np.int32)
    for number in groups:
        own = scene.per_face(other == number for other in numbers)
        if not (own & receives).any():
            continue
        kept = [other in (None, number) for other in numbers]
        chosen = scene.per_face(kept)
        alone = with_parts(grounded, kept)
        alone = replace(alone, parts=tuple(replace(part, self_occluded=None) for part in alone.parts))
        group[own], face[own] = len(surfaces), (np.cumsum(chosen) - 1)[own]
        surfaces.append(NormalizedSurface.from_scene(alone, shading[chosen]))
    return SurfaceGroups(tuple(surfaces), group, face)


def _fixed_ground(scene: Scene) -> Ground | None:
    """Return the ground of a scene at its height, which is that of all its groups; None without a ground."""
    ground, around = scene.around.ground, scene.around.occluders
    if ground is None or ground.height is not None:
        return ground
    points = np.concatenate([positions_of(scene, scene.receives | scene.occludes), around.reshape(-1, 3)])
    return replace(ground, height=float((points @ np.asarray(ground.normal)).min()))


# Occluders that count from one side, and from both.


def _occluders(scene: Scene, geometric: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Return the triangles that occlude what is in front of them, by winding, and those that do so on both sides.

    geometric   (f, 3): the unit geometric normals, on the fronts
    Two triangles that are each other's back make a sheet with two sides.
    """
    around = scene.around.occluders
    if scene.backs_occlude:
        return _NO_TRIANGLES, np.concatenate([opaque_triangles(scene), around])
    pieces, faces = opaque_pieces(scene)
    turned = np.einsum("ox,ox->o", area_vectors(pieces), geometric[faces]) < 0
    pieces = np.where(turned[:, None, None], pieces[:, REVERSED_WINDING], pieces)
    double = scene.per_face(part.material.foliage or part.material.double_sided for part in scene.parts)[faces]
    triangles = np.concatenate([pieces, around])
    both = np.concatenate([double, np.zeros(len(around), bool)]) | _have_backs(triangles)
    return triangles[~both], triangles[both]


def _have_backs(triangles: Float64Array) -> BoolArray:
    """Return which of (o, 3, 3) triangles are there in the opposite winding, too, (o,) bool."""
    corners = unique_rows(triangles.reshape(-1, 3))[1].reshape(-1, 3)
    order = np.argsort(corners, axis=1)
    same = unique_rows(np.take_along_axis(corners, order, axis=1))[1]
    forwards = (order[:, 1] - order[:, 0]) % 3 == 1
    count = int(same.max(initial=-1)) + 1
    has_both = (np.bincount(same[forwards], minlength=count) > 0) & (np.bincount(same[~forwards], minlength=count) > 0)
    backed: BoolArray = has_both[same]
    return backed


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
