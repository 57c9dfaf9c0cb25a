"""How well a sphere set approximates a mesh, whatever made the spheres: distances, silhouettes and volumes."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.mesh.topology import topology
from aoprecalc.spheres.sampling import NormalizedFrame, VoxelGrid, inside_mesh, spheres_per_voxel
from aoprecalc.spheres.silhouettes import fibonacci_views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.types import Float64Array, Scene

Quality = dict[str, float]  # by the keys of the JSON document

_BRUTE_FORCE_UP_TO = 24  # spheres; a k-d tree is slower for so few (at 40 it takes two thirds of the time)
_NEIGHBOURS = 24  # nearest centres that are tried first
_CHUNK_SIZE = 1 << 14  # points processed at once, so that the distances stay in the processor's cache
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
    for start in range(0, len(points), _CHUNK_SIZE):
        chunk = points[start : start + _CHUNK_SIZE]
        distances, neighbours = tree.query(chunk, _NEIGHBOURS)
        nearest = (distances - radii[neighbours]).min(axis=1)
        # A sphere that is not among the neighbours may be nearer by its radius.
        unsure = np.flatnonzero(nearest > distances[:, -1] - max_radius)
        if len(unsure):
            exact = np.empty(len(unsure))
            _brute_force_distances(chunk[unsure], centers, radii, exact)
            nearest[unsure] = exact
        signed[start : start + _CHUNK_SIZE] = nearest
    return signed


def _brute_force_distances(points: Float64Array, centers: Float64Array, radii: Float64Array, out: Float64Array) -> None:
    chunk_size = max(1, (_CHUNK_SIZE * _BRUTE_FORCE_UP_TO) // len(radii))
    for start in range(0, len(points), chunk_size):
        chunk = points[start : start + chunk_size]
        if len(radii) < 4:
            squared = np.square(chunk[:, None] - centers).sum(axis=2)
        else:  # axis by axis, (k, n); |p|^2 - 2 p.c + |c|^2 would lose half of the digits
            squared = np.square(chunk[:, :1] - centers[:, 0])
            for axis in (1, 2):
                squared += np.square(chunk[:, axis : axis + 1] - centers[:, axis])
        out[start : start + chunk_size] = (np.sqrt(squared) - radii).min(axis=1)
