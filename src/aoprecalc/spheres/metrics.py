"""How far points are from the surface of a set of spheres."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.mesh.topology import topology
from aoprecalc.spheres.sampling import NormalizedFrame
from aoprecalc.spheres.silhouettes import fibonacci_views, mesh_silhouettes, spheres_per_pixel
from aoprecalc.spheres.voxels import VoxelGrid, inside_mesh, spheres_per_voxel
from aoprecalc.types import Float64Array, Scene

_FEW = (
    24  # spheres that are all measured at every point; more are looked up: at 40 in two thirds of the time (measured)
)
_LISTED = 24  # centres that are looked up first
_BLOCK = 1 << 14  # points at a time, so that what is measured stays in the processor's cache


def signed_distances(points: Float64Array, centers: Float64Array, radii: Float64Array) -> Float64Array:
    """Return the least of |p - c| - r over n spheres for each of k points, (k,) float64: negative inside any.

    Outside it is the distance to the union of the spheres.
    """
    nearest = np.empty(len(points))
    if len(radii) <= _FEW:
        _measure_all(points, centers, radii, nearest)
        return nearest
    tree, largest = cKDTree(centers), radii.max()
    for start in range(0, len(points), _BLOCK):
        some = points[start : start + _BLOCK]
        distances, listed = tree.query(some, _LISTED)
        found = (distances - radii[listed]).min(axis=1)
        unsure = np.flatnonzero(found > distances[:, -1] - largest)  # a centre that is not listed may be nearer by this
        if len(unsure):
            exact = np.empty(len(unsure))
            _measure_all(some[unsure], centers, radii, exact)
            found[unsure] = exact
        nearest[start : start + _BLOCK] = found
    return nearest


def _measure_all(points: Float64Array, centers: Float64Array, radii: Float64Array, nearest: Float64Array) -> None:
    block = max(1, (_BLOCK * _FEW) // len(radii))
    for start in range(0, len(points), block):
        some = points[start : start + block]
        squared = np.square(some[:, None] - centers).sum(axis=2) if len(radii) < 4 else _squared(some, centers)
        nearest[start : start + block] = (np.sqrt(squared) - radii).min(axis=1)


def _squared(points: Float64Array, centers: Float64Array) -> Float64Array:
    """(k, n) float64: squared distances, plainly, as the matrix product would lose half of the digits nearby."""
    squared: Float64Array = np.square(points[:, :1] - centers[:, 0])
    for axis in (1, 2):
        squared += np.square(points[:, axis : axis + 1] - centers[:, axis])
    return squared


# How well a set of spheres stands in for a mesh, however the spheres were made.

Quality = dict[str, float]

_VIEWS, _PIXELS = 32, 256
_TURN = 0.5  # of the views, which no fit uses
_WINDOW = 1.1  # half a picture's side, in the mesh's greatest distance from the middle of its box
_CUBES = 128  # along the longest side of the grid that measures volumes
_ROUNDING = 1e-9  # in the frame: a point as far beyond a sphere lies on it


def sphere_quality(
    scene: Scene, frame: NormalizedFrame, points: Float64Array, centers: Float64Array, radii: Float64Array
) -> Quality:
    """Measure spheres, in the frame: centers (n, 3), radii (n,) >= 0, on points, (s, 3), of the scene's surface.

    radius_min, radius_mean, radius_max, radius_deviation   of the radii, the last their standard deviation, in the
                        mesh's units
    inertia             sum over the points of the squared distance to the nearest centre, / diagonal of the box squared
    surface_error_mean, surface_error_p95, surface_error_max   of the points' distances from the surface of the nearest
                        sphere, |min over spheres of |p - c| - r|, / diagonal
    coverage            share of the points that lie in some sphere, 0 to 1
    and what `silhouette_quality` and `volume_quality` find.
    """
    away = signed_distances(points, centers, radii)
    error = np.abs(away) / frame.diagonal if frame.diagonal else np.abs(away)
    nearest = cKDTree(centers).query(points)[0]
    measured = {
        "radius_min": radii.min() * frame.scale,
        "radius_mean": radii.mean() * frame.scale,
        "radius_max": radii.max() * frame.scale,
        "radius_deviation": radii.std() * frame.scale,
        "inertia": np.square(nearest / (frame.diagonal or 1.0)).sum(),
        "surface_error_mean": error.mean(),
        "surface_error_p95": np.quantile(error, 0.95),
        "surface_error_max": error.max(),
        "coverage": (away <= _ROUNDING).mean(),
    }
    positions = frame.to_normalized(scene.positions)
    found = {name: float(value) for name, value in measured.items()}
    found |= silhouette_quality(scene, positions, centers, radii)
    return found | volume_quality(scene, positions, centers, radii)


def silhouette_quality(scene: Scene, positions: Float64Array, centers: Float64Array, radii: Float64Array) -> Quality:
    """Compare silhouettes over 32 directions that no fit uses, at 256 x 256 pixels by their centres.

    positions (v, 3) of the scene's vertices in the frame
    With the mesh's silhouette M and the spheres' S in each view, in the mean over the views unless said otherwise:
    silhouette_iou       area of M and S in common / area of either
    silhouette_iou_min   the same in the worst view
    leak                 area of M without S / area of M: light that should be blocked
    spill                area of S without M / area of M: shadow where there is none
    area_bias            area of S / area of M - 1
    The picture shows all spheres: those far from the mesh make both small in it. Views in which the mesh covers no
    pixel do not count; without any other the likeness is 0, and what is over the area of M is left out.
    """
    half = _WINDOW * float(np.linalg.norm(positions, axis=1).max())
    half = max(half, float((np.linalg.norm(centers, axis=1) + radii).max()))
    seen = fibonacci_views(_VIEWS, half, _PIXELS, _TURN)
    mesh = mesh_silhouettes(positions, scene.faces, seen)
    spheres = spheres_per_pixel(centers, radii, seen) > 0
    area = mesh.sum(axis=(1, 2))
    some = area > 0
    if not some.any():
        return {"silhouette_iou": 0.0, "silhouette_iou_min": 0.0}
    mesh, spheres, area = mesh[some], spheres[some], area[some]
    common, covered = (mesh & spheres).sum(axis=(1, 2)), spheres.sum(axis=(1, 2))
    likeness = common / (area + covered - common)
    return {
        "silhouette_iou": float(likeness.mean()),
        "silhouette_iou_min": float(likeness.min()),
        "leak": float((1 - common / area).mean()),
        "spill": float(((covered - common) / area).mean()),
        "area_bias": float((covered / area - 1).mean()),
    }


def volume_quality(scene: Scene, positions: Float64Array, centers: Float64Array, radii: Float64Array) -> Quality:
    """Compare volumes by the points of a grid, 128 along the longest side of the box around mesh and spheres.

    overlap           mean number of spheres that hold a point of their union: 1 is no overlap
    For watertight meshes, over the volume that the mesh winds around:
    inside_volume     share of it that the spheres hold, 0 to 1
    outside_volume    what they hold beside it, as a share of it, >= 0
    """
    low = np.minimum(positions.min(axis=0), (centers - radii[:, None]).min(axis=0))
    high = np.maximum(positions.max(axis=0), (centers + radii[:, None]).max(axis=0))
    grid = VoxelGrid.from_box(low, high, _CUBES)
    layers = spheres_per_voxel(centers, radii, grid)
    held = layers > 0
    found = {"overlap": float(layers[held].mean()) if held.any() else 1.0}
    if topology(scene.faces).watertight:
        inside = inside_mesh(positions, scene.faces, grid)
        volume = np.count_nonzero(inside)
        if volume:
            found["inside_volume"] = float(np.count_nonzero(inside & held) / volume)
            found["outside_volume"] = float(np.count_nonzero(held & ~inside) / volume)
    return found
