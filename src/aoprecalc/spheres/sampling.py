"""Samples of a mesh in normalised coordinates: points on its surface, voxels inside it, and what spheres fail to fit.

Points are sampled uniformly by area: a face with a probability proportional to its area, then a point uniformly in the
face (*Précalcul*, section 1.2.1). Voxels are filled column by column. Against them, and in silhouettes, is measured how
well a sphere set approximates the mesh, whatever made the spheres.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.errors import InputError, counted
from aoprecalc.mesh.surface import face_normals, fold_to_triangle, pick_faces
from aoprecalc.mesh.topology import topology
from aoprecalc.raster.cpu_rasterizer import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.raster.layout import CENTER
from aoprecalc.spheres.silhouettes import disc_spans, fibonacci_views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.types import BoolArray, Float64Array, Int32Array, Scene

_CHUNK_SIZE = 1 << 17  # points sampled at once, to bound temporary memory
_MAX_INCONSISTENT = 0.01  # fraction of the columns through the mesh: more open columns mean faces of mixed orientation


@dataclass(frozen=True, eq=False)
class NormalizedFrame:
    """The transform of a mesh's bounding box to [-1, 1]^3, centred, with its aspect ratio kept.

    center     (3,) float64: centre of the bounding box, in mesh units
    scale      half the longest side of the box, in mesh units, > 0
    diagonal   of the box, in normalised units: 2 to 2 sqrt(3); 0 for a single point
    """

    center: Float64Array
    scale: float
    diagonal: float

    @classmethod
    def from_positions(cls, positions: Float64Array) -> Self:
        """Build the frame of the bounding box of finite positions, (v, 3) float64, v >= 1."""
        low, high = positions.min(axis=0) / 2, positions.max(axis=0) / 2  # halved first, so that no sum overflows
        half = high - low
        scale = float(half.max()) or 1.0
        return cls(low + high, scale, 2 * float(np.linalg.norm(half / scale)))

    def to_normalized(self, positions: Float64Array) -> Float64Array:
        """Transform positions, (..., 3) float64, from mesh to normalised coordinates."""
        return (positions - self.center) / self.scale

    def from_normalized(self, positions: Float64Array) -> Float64Array:
        """Transform positions, (..., 3) float64, from normalised to mesh coordinates."""
        return positions * self.scale + self.center


@dataclass(frozen=True, eq=False)
class SphereFit:
    """The result of a fitting method: n spheres in normalised coordinates.

    centers      (n, 3) float64
    radii        (n,) float64 >= 0
    iterations   assignments of all samples to spheres, or optimiser steps
    converged    the last iteration reassigned no sample; always true for optimisers with a fixed number of steps
    guarded      how often a guard replaced a least-squares solution (algebraic only)
    """

    centers: Float64Array
    radii: Float64Array
    iterations: int
    converged: bool
    guarded: int = 0


def sample_points(
    scene: Scene, frame: NormalizedFrame, count: int, min_distinct: int, rng: np.random.Generator
) -> Float64Array:
    """Sample `count` points uniformly on the surface, at least `min_distinct` of them distinct.

    The first points do not depend on `count`, except for the rounding by `round_to_grid`.

    Returns (count, 3) float64 in normalised coordinates, in [-1, 1] and rounded by `round_to_grid`.
    Raises InputError if the surface has no area, or yields fewer than `min_distinct` distinct points.
    """
    corners, cumulative_areas = _faces_with_areas(scene, frame)
    points = np.empty((count, 3))
    for start in range(0, count, _CHUNK_SIZE):
        chunk = points[start : start + _CHUNK_SIZE]
        chunk[:] = _sample_faces(corners, cumulative_areas, len(chunk), rng)[0]
    points = round_to_grid(points)
    if (distinct := _count_distinct(points, min_distinct)) < min_distinct:
        raise InputError(
            f"{scene.path}: {counted(count, 'sample')} on {counted(distinct, 'distinct point')}, fewer than the "
            f"{min_distinct} spheres that start there; ask for fewer spheres or more samples"
        )
    return points


def sample_points_with_normals(
    scene: Scene, frame: NormalizedFrame, count: int, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Sample points uniformly on the surface, with the unit normals of their faces.

    Returns points in normalised coordinates and normals, (count, 3) float64 each.
    Raises InputError if the surface has no area.
    """
    points, triangles = _sample_faces(*_faces_with_areas(scene, frame), count, rng)
    return points, face_normals(triangles)[0]


def round_to_grid(points: Float64Array) -> Float64Array:
    """Round (s, 3) coordinates in [-1, 1] to a grid so coarse that the sum of any of them is exact in float64.

    A sum then does not depend on the order of its terms, and rounding noise that depends on the mesh's position and
    scale vanishes. The grid step is a power of two, 2^-35 for 100,000 samples.
    """
    step = 2.0 ** (int(len(points) - 1).bit_length() - 52)
    return np.asarray(np.rint(points / step) * step + 0.0, np.float64)  # + 0.0 turns -0.0 into 0.0: equal = same bytes


def _faces_with_areas(scene: Scene, frame: NormalizedFrame) -> tuple[Float64Array, Float64Array]:
    """Return the faces' corners in normalised coordinates, (f, 3, 3), and cumulative doubled areas, (f,)."""
    corners = frame.to_normalized(scene.corners)
    cumulative_areas = np.cumsum(_doubled_areas(corners, scene, frame))
    if cumulative_areas[-1] == 0:
        raise InputError(
            f"{scene.path}: the surface has no area ({counted(len(corners), 'face')}, all points or lines), "
            "but spheres are fitted to points on it; repair the mesh"
        )
    return corners, cumulative_areas


def _doubled_areas(corners: Float64Array, scene: Scene, frame: NormalizedFrame) -> Float64Array:
    """Return twice the faces' areas, (f,), normalised; 0 for an area within the rounding error of the positions."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.linalg.norm(np.cross(first, second), axis=1)
    longest = np.sqrt(np.maximum((first**2).sum(axis=1), (second**2).sum(axis=1)))
    rounding = np.finfo(np.float64).eps * max(1.0, float(np.abs(scene.positions).max() / frame.scale))
    return np.where(areas > 4 * rounding * longest, areas, 0.0)


def _sample_faces(
    corners: Float64Array, cumulative_areas: Float64Array, count: int, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Sample points on faces; return them, (count, 3), and the corners of the face of each, (count, 3, 3)."""
    face, first, second = rng.random((count, 3)).T
    triangles = corners[pick_faces(cumulative_areas, face)]
    first, second = fold_to_triangle(first, second)
    origin = triangles[:, 0]
    points = origin + first[:, None] * (triangles[:, 1] - origin) + second[:, None] * (triangles[:, 2] - origin)
    return points, triangles


def _count_distinct(points: Float64Array, enough: int) -> int:
    """Count distinct points, exactly if there are fewer than `enough`."""
    head = len(np.unique(points[: 2 * enough], axis=0))  # nearly always enough, and much faster than sorting all
    return head if head >= enough else len(np.unique(points, axis=0))


# Voxels: which lie inside a closed mesh, and how many spheres contain each.


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """A grid of cubes, represented by their centres.

    low     (3,) float64: the corner of least coordinates
    pitch   side of a cube
    shape   number of cubes along x, y, z
    """

    low: Float64Array
    pitch: float
    shape: tuple[int, int, int]

    @classmethod
    def from_box(cls, low: Float64Array, high: Float64Array, resolution: int) -> "VoxelGrid":
        """Cover the box from low to high, (3,) each, with `resolution` cubes along its longest side."""
        pitch = float((high - low).max()) / resolution
        x, y, z = (int(count) for count in np.maximum(1, np.ceil((high - low) / pitch)))
        return cls(low, pitch, (x, y, z))

    def centers(self, mask: BoolArray) -> Float64Array:
        """Return the centres of the voxels where `mask`, of the grid's shape, is true, (k, 3) float64."""
        return self.low + (np.argwhere(mask) + 0.5) * self.pitch


def inside_mesh(positions: Float64Array, faces: Int32Array, grid: VoxelGrid) -> BoolArray:
    """Return which voxels have their centres inside a closed mesh, bool of the grid's shape.

    A voxel is inside if its winding number, from the signed crossings of a ray along z, is not zero. Faces may be
    oriented outwards or inwards. A column whose crossings do not sum to zero, for example along an edge seen end-on, is
    empty. If there are many such columns, the faces are not consistently oriented, and a voxel is inside if the number
    of crossings below it is odd.
    """
    nx, ny, nz = grid.shape
    corners = ((positions - grid.low) / grid.pitch)[faces]
    triangles = corners[..., :2].astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = -normals[:, :2] / np.where(normals[:, 2] == 0, 1.0, normals[:, 2])[:, None]
    min_z, max_z = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    counts = np.zeros(nx * ny * (nz + 1), np.int32)
    for triangle, first, length in triangle_spans(snap_to_grid(triangles, CENTER), nx, 0, ny):
        for span, step in expand_counts(length):
            face, column = triangle[span], first[span] + step
            y, x = np.divmod(column, nx)
            offset = np.stack([x + 0.5, y + 0.5], axis=1) - corners[face, 0, :2]
            z = np.clip(corners[face, 0, 2] + (slope[face] * offset).sum(axis=1), min_z[face], max_z[face])
            first_above = np.clip(np.ceil(z - 0.5), 0, nz).astype(np.int64)  # voxel centre
            np.add.at(counts, column * (nz + 1) + first_above, np.sign(normals[face, 2]).astype(np.int32))
    crossings = counts.reshape(ny, nx, nz + 1)
    winding = np.cumsum(crossings, axis=2)
    crossed = crossings.any(axis=2)
    inconsistent = winding[..., -1] != 0
    inside: BoolArray
    if np.count_nonzero(inconsistent) > _MAX_INCONSISTENT * np.count_nonzero(crossed):
        inside = (winding[..., :nz] % 2 != 0) & (winding[..., -1:] % 2 == 0)
    else:
        inside = (winding[..., :nz] != 0) & ~inconsistent[..., None]
    return inside.transpose(1, 0, 2)


def spheres_per_voxel(centers: Float64Array, radii: Float64Array, grid: VoxelGrid) -> Int32Array:
    """Return how many of n spheres contain each voxel's centre, int32 of the grid's shape."""
    nx, ny, nz = grid.shape
    center_x, center_y, center_z = ((centers - grid.low) / grid.pitch).T
    sizes = radii / grid.pitch
    spans = disc_spans(center_x[None], center_y[None], sizes, max(nx, ny))
    changes = np.zeros((ny * nx, nz + 1), np.int32)
    for span, step in expand_counts(spans.stop - spans.start):
        sphere, x, y = spans.disc[span], spans.start[span] + step, spans.row[span]
        squared_offset = (x + 0.5 - center_x[sphere]) ** 2 + (y + 0.5 - center_y[sphere]) ** 2
        half_height = np.sqrt(np.maximum(sizes[sphere] ** 2 - squared_offset, 0))
        start = np.clip(np.ceil(center_z[sphere] - half_height - 0.5), 0, nz).astype(np.int64)
        stop = np.clip(np.floor(center_z[sphere] + half_height - 0.5) + 1, 0, nz).astype(np.int64)
        kept = (stop > start) & (y < ny) & (x < nx)
        column = (y * nx + x)[kept]
        np.add.at(changes, (column, start[kept]), np.int32(1))
        np.subtract.at(changes, (column, stop[kept]), np.int32(1))
    counts: Int32Array = np.cumsum(changes[:, :nz], axis=1, dtype=np.int32)
    return counts.reshape(ny, nx, nz).transpose(1, 0, 2)


# How well spheres approximate a mesh: distances, silhouettes and volumes.

Quality = dict[str, float]  # by the keys of the JSON document

_BRUTE_FORCE_UP_TO = 24  # spheres; a k-d tree is slower for so few (at 40 it takes two thirds of the time)
_NEIGHBOURS = 24  # nearest centres that are tried first
_DISTANCE_CHUNK = 1 << 14  # points processed at once, so that the distances stay in the processor's cache
_VIEWS, _RESOLUTION = 32, 256  # of the silhouettes
_VIEW_TURN = 0.5  # of the views, as no fit uses it
_WINDOW = 1.1  # half the side of a view / the greatest distance of the mesh from the centre of its box
_VOXEL_RESOLUTION = 128  # along the longest side of the grid that measures volumes
_COVERAGE_ROUNDING = 1e-9  # normalised: a point this far outside a sphere counts as covered


def sphere_quality(
    scene: Scene, frame: NormalizedFrame, points: Float64Array, centers: Float64Array, radii: Float64Array
) -> Quality:
    """Compute the quality of spheres in normalised coordinates.

    points    (s, 3): samples of the scene's surface
    centers   (n, 3)
    radii     (n,) >= 0

    Returns, by key:
    radius_min, radius_mean, radius_max, radius_deviation   of the radii, in mesh units; the last is the standard
                        deviation
    inertia             sum over the points of the squared distance to the nearest centre, / squared box diagonal
    surface_error_mean, surface_error_p95, surface_error_max   of the distances from the points to the surface of the
                        nearest sphere, |min over spheres of |p - c| - r|, / box diagonal
    coverage            fraction of the points inside some sphere, 0 to 1
    and the keys of `silhouette_quality` and `volume_quality`.
    """
    signed = signed_distances(points, centers, radii)
    error = np.abs(signed) / frame.diagonal if frame.diagonal else np.abs(signed)
    nearest = cKDTree(centers).query(points)[0]
    metrics = {
        "radius_min": radii.min() * frame.scale,
        "radius_mean": radii.mean() * frame.scale,
        "radius_max": radii.max() * frame.scale,
        "radius_deviation": radii.std() * frame.scale,
        "inertia": np.square(nearest / (frame.diagonal or 1.0)).sum(),
        "surface_error_mean": error.mean(),
        "surface_error_p95": np.quantile(error, 0.95),
        "surface_error_max": error.max(),
        "coverage": (signed <= _COVERAGE_ROUNDING).mean(),
    }
    positions = frame.to_normalized(scene.positions)
    quality = {name: float(value) for name, value in metrics.items()}
    quality |= silhouette_quality(scene, positions, centers, radii)
    return quality | volume_quality(scene, positions, centers, radii)


def silhouette_quality(scene: Scene, positions: Float64Array, centers: Float64Array, radii: Float64Array) -> Quality:
    """Compare the silhouettes of a mesh, M, and of spheres, S, in 32 views of 256 x 256 pixels that no fit uses.

    positions   (v, 3): the scene's vertices in normalised coordinates

    Returns, by key, means over the views unless stated otherwise:
    silhouette_iou       intersection over union, area(M and S) / area(M or S)
    silhouette_iou_min   its minimum over the views
    leak                 area(M without S) / area(M): light that the spheres fail to block
    spill                area(S without M) / area(M): shadow where the mesh casts none
    area_bias            area(S) / area(M) - 1
    The views are large enough for all spheres, so spheres far from the mesh reduce the resolution. Views in which the
    mesh covers no pixel are skipped; if there are no others, both IoU are 0 and the other keys are missing.
    """
    half_extent = _WINDOW * float(np.linalg.norm(positions, axis=1).max())
    half_extent = max(half_extent, float((np.linalg.norm(centers, axis=1) + radii).max()))
    views = fibonacci_views(_VIEWS, half_extent, _RESOLUTION, _VIEW_TURN)
    mesh = mesh_silhouettes(positions, scene.faces, views)
    spheres = spheres_per_pixel(centers, radii, views) > 0
    area = mesh.sum(axis=(1, 2))
    visible = area > 0
    if not visible.any():
        return {"silhouette_iou": 0.0, "silhouette_iou_min": 0.0}
    mesh, spheres, area = mesh[visible], spheres[visible], area[visible]
    common, covered = (mesh & spheres).sum(axis=(1, 2)), spheres.sum(axis=(1, 2))
    iou = common / (area + covered - common)
    return {
        "silhouette_iou": float(iou.mean()),
        "silhouette_iou_min": float(iou.min()),
        "leak": float((1 - common / area).mean()),
        "spill": float(((covered - common) / area).mean()),
        "area_bias": float((covered / area - 1).mean()),
    }


def volume_quality(scene: Scene, positions: Float64Array, centers: Float64Array, radii: Float64Array) -> Quality:
    """Compare volumes on a voxel grid, 128 along the longest side of the bounding box of mesh and spheres.

    Returns, by key:
    overlap          mean number of spheres per voxel of their union: 1 means no overlap
    inside_volume    watertight meshes only: volume(mesh and spheres) / volume(mesh), 0 to 1
    outside_volume   watertight meshes only: volume(spheres without mesh) / volume(mesh), >= 0
    """
    low = np.minimum(positions.min(axis=0), (centers - radii[:, None]).min(axis=0))
    high = np.maximum(positions.max(axis=0), (centers + radii[:, None]).max(axis=0))
    grid = VoxelGrid.from_box(low, high, _VOXEL_RESOLUTION)
    counts = spheres_per_voxel(centers, radii, grid)
    covered = counts > 0
    quality = {"overlap": float(counts[covered].mean()) if covered.any() else 1.0}
    if topology(scene.faces).watertight:
        inside = inside_mesh(positions, scene.faces, grid)
        volume = np.count_nonzero(inside)
        if volume:
            quality["inside_volume"] = float(np.count_nonzero(inside & covered) / volume)
            quality["outside_volume"] = float(np.count_nonzero(covered & ~inside) / volume)
    return quality


def signed_distances(points: Float64Array, centers: Float64Array, radii: Float64Array) -> Float64Array:
    """Return the minimum over n spheres of |p - c| - r for each of k points, (k,) float64: negative inside any sphere.

    Outside the spheres it is the distance to their union.
    """
    signed = np.empty(len(points))
    if len(radii) <= _BRUTE_FORCE_UP_TO:
        _brute_force_distances(points, centers, radii, signed)
        return signed
    tree, max_radius = cKDTree(centers), radii.max()
    for start in range(0, len(points), _DISTANCE_CHUNK):
        chunk = points[start : start + _DISTANCE_CHUNK]
        distances, neighbours = tree.query(chunk, _NEIGHBOURS)
        nearest = (distances - radii[neighbours]).min(axis=1)
        # A sphere that is not among the neighbours may be nearer by its radius.
        unsure = np.flatnonzero(nearest > distances[:, -1] - max_radius)
        if len(unsure):
            exact = np.empty(len(unsure))
            _brute_force_distances(chunk[unsure], centers, radii, exact)
            nearest[unsure] = exact
        signed[start : start + _DISTANCE_CHUNK] = nearest
    return signed


def _brute_force_distances(points: Float64Array, centers: Float64Array, radii: Float64Array, out: Float64Array) -> None:
    chunk_size = max(1, (_DISTANCE_CHUNK * _BRUTE_FORCE_UP_TO) // len(radii))
    for start in range(0, len(points), chunk_size):
        chunk = points[start : start + chunk_size]
        if len(radii) < 4:
            squared = np.square(chunk[:, None] - centers).sum(axis=2)
        else:  # axis by axis, (k, n); |p|^2 - 2 p.c + |c|^2 would lose half of the digits
            squared = np.square(chunk[:, :1] - centers[:, 0])
            for axis in (1, 2):
                squared += np.square(chunk[:, axis : axis + 1] - centers[:, axis])
        out[start : start + chunk_size] = (np.sqrt(squared) - radii).min(axis=1)
