"""Voxel grids: which voxels lie inside a closed mesh, and how many spheres contain each. Filled column by column."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.raster.layout import CENTER
from aoprecalc.raster.spans import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.spheres.silhouettes import disc_spans
from aoprecalc.types import BoolArray, Float64Array, Int32Array

_MAX_INCONSISTENT = 0.01  # fraction of the columns through the mesh: more open columns mean faces of mixed orientation


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
