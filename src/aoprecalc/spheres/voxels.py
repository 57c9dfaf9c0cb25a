"""Which points of a grid lie inside a closed mesh, and which inside spheres: columns of points, filled in one go."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.raster.samples import CENTER
from aoprecalc.raster.spans import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.spheres.silhouettes import disc_spans
from aoprecalc.types import BoolArray, Float64Array, Int32Array

_ASTRAY = 0.01  # share of the columns that meet the mesh: more crossings that do not add up are no accident


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Cubes of side `pitch` from the corner `low`, (3,) float64, as many as `shape` says; points are their centres."""

    low: Float64Array
    pitch: float
    shape: tuple[int, int, int]

    @classmethod
    def from_box(cls, low: Float64Array, high: Float64Array, most: int) -> "VoxelGrid":
        """Fit a grid of `most` cubes along its longest side to the box from low to high, (3,) each."""
        pitch = float((high - low).max()) / most
        across, upward, along = (int(count) for count in np.maximum(1, np.ceil((high - low) / pitch)))
        return cls(low, pitch, (across, upward, along))

    def points(self, inside: BoolArray) -> Float64Array:
        """Return the points where `inside`, of the grid's shape, is true, (k, 3) float64."""
        return self.low + (np.argwhere(inside) + 0.5) * self.pitch


def inside_mesh(positions: Float64Array, faces: Int32Array, grid: VoxelGrid) -> BoolArray:
    """Return which points lie inside a closed mesh: those that it winds around. bool, of the grid's shape.

    (The winding number by the signed crossings of a ray; here of all rays of a column at once.) Either winding will do.
    A column whose crossings do not add up, as beside an edge seen end-on, holds nothing. Where that is so for many, the
    winding is not one, and a point is inside if an odd number of surfaces lies below it.
    """
    across, upward, along = grid.shape
    corners = ((positions - grid.low) / grid.pitch)[faces]
    triangles = corners[..., :2].astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upright = np.where(normals[:, 2] == 0, 1.0, normals[:, 2])
    slope = -normals[:, :2] / upright[:, None]
    least, most = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    winding = np.zeros(across * upward * (along + 1), np.int32)
    for triangle, first, length in triangle_spans(snap_to_grid(triangles, CENTER), across, 0, upward):
        for span, step in expand_counts(length):
            face, cell = triangle[span], first[span] + step
            row, column = np.divmod(cell, across)
            aside = np.stack([column + 0.5, row + 0.5], axis=1) - corners[face, 0, :2]
            depth = np.clip(corners[face, 0, 2] + (slope[face] * aside).sum(axis=1), least[face], most[face])
            level = np.clip(np.ceil(depth - 0.5), 0, along).astype(np.int64)  # the first point above the crossing
            np.add.at(winding, cell * (along + 1) + level, np.sign(normals[face, 2]).astype(np.int32))
    crossings = winding.reshape(upward, across, along + 1)
    upto = np.cumsum(crossings, axis=2)
    met = crossings.any(axis=2)
    astray = upto[..., -1] != 0
    inside: BoolArray
    if np.count_nonzero(astray) > _ASTRAY * np.count_nonzero(met):  # some faces are turned round: count surfaces
        inside = (upto[..., :along] % 2 != 0) & (upto[..., -1:] % 2 == 0)
    else:
        inside = (upto[..., :along] != 0) & ~astray[..., None]
    return inside.transpose(1, 0, 2)


def spheres_per_voxel(centers: Float64Array, radii: Float64Array, grid: VoxelGrid) -> Int32Array:
    """Return in how many of n spheres each point lies, int32 of the grid's shape."""
    across, upward, along = grid.shape
    columns, rows, depths = ((centers - grid.low) / grid.pitch).T
    sizes = radii / grid.pitch
    side = max(across, upward)
    runs = disc_spans(columns[None], rows[None], sizes, side)
    changes = np.zeros((upward * across, along + 1), np.int32)
    for run, step in expand_counts(runs.stop - runs.first):
        owner, column, row = runs.owner[run], runs.first[run] + step, runs.line[run]
        aside = (column + 0.5 - columns[owner]) ** 2 + (row + 0.5 - rows[owner]) ** 2
        reach = np.sqrt(np.maximum(sizes[owner] ** 2 - aside, 0))
        first = np.clip(np.ceil(depths[owner] - reach - 0.5), 0, along).astype(np.int64)
        stop = np.clip(np.floor(depths[owner] + reach - 0.5) + 1, 0, along).astype(np.int64)
        some = (stop > first) & (row < upward) & (column < across)
        cell = (row * across + column)[some]
        np.add.at(changes, (cell, first[some]), np.int32(1))
        np.subtract.at(changes, (cell, stop[some]), np.int32(1))
    layers: Int32Array = np.cumsum(changes[:, :along], axis=1, dtype=np.int32)
    return layers.reshape(upward, across, along).transpose(1, 0, 2)
