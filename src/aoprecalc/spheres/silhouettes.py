"""Silhouettes: the pixels that a mesh, or a set of spheres, covers when it is seen from far away. NumPy, no OpenGL."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.raster.samples import CENTER
from aoprecalc.raster.spans import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.visibility.directions import fibonacci_hemisphere, orthonormal_basis

_SNAPPED = 1 / 256  # pixels by which a corner moves at most when it is moved to the rasteriser's grid


@dataclass(frozen=True, eq=False)
class Views:
    """Directions of view, and the square around the origin that each picture shows.

    across, upward   (d, 3) float64: the unit vectors of a picture's columns and rows
    half             half the side of the square, in the points' units, > 0
    size             pixels a side
    """

    across: Float64Array
    upward: Float64Array
    half: float
    size: int

    def __len__(self) -> int:
        return len(self.across)

    def __getitem__(self, which: slice | NDArray[np.intp]) -> "Views":
        return Views(self.across[which], self.upward[which], self.half, self.size)

    @property
    def scale(self) -> float:
        """Pixels a unit."""
        return self.size / (2 * self.half)

    def project(self, points: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the columns and the rows, (d, k) float64 each, in pixels, at which (k, 3) points are seen."""
        columns, rows = (side @ points.T * self.scale + self.size / 2 for side in (self.across, self.upward))
        return columns, rows


def fibonacci_views(count: int, half: float, size: int, turn: float) -> Views:
    """Return `count` views spread evenly; a view and the one from behind have mirrored silhouettes, so half suffice.

    turn   of the directions about z, as a share of a whole one: keeps what measures apart from what was fitted
    """
    across, upward = orthonormal_basis(fibonacci_hemisphere(np.arange(count), count, turn))
    return Views(across, upward, half, size)


def mesh_silhouettes(positions: Float64Array, faces: Int32Array, seen: Views) -> BoolArray:
    """Return the pixels whose centres lie in any of (f, 3) faces over (v, 3) positions, (d, size, size) bool."""
    size = seen.size
    masks = np.zeros((len(seen), size, size), bool)
    corners = np.ascontiguousarray(faces.T)
    for number, mask in enumerate(masks):
        places = [side[0].astype(np.float32) for side in seen[np.array([number])].project(positions)]
        columns = [np.take(places[0], corner) for corner in corners]
        rows = [np.take(places[1], corner) for corner in corners]
        meets = _meets_a_centre(columns) & _meets_a_centre(rows)
        some = np.flatnonzero(meets)
        triangles = np.stack([np.stack([side[some] for side in kind], axis=1) for kind in (columns, rows)], axis=2)
        runs = list(triangle_spans(snap_to_grid(triangles, CENTER), size, 0, size))
        if runs:
            first, length = (np.concatenate([run[k] for run in runs]) for k in (1, 2))
            changes = np.bincount(first, minlength=size * size + 1) - np.bincount(
                first + length, minlength=size * size + 1
            )
            mask[:] = (np.cumsum(changes[:-1]) > 0).reshape(size, size)
    return masks


def spheres_per_pixel(centers: Float64Array, radii: Float64Array, seen: Views) -> Int32Array:
    """Return how many of n spheres lie over the centre of each pixel, (d, size, size) int32.

    centers (n, 3), radii (n,) >= 0
    """
    runs = disc_spans(*seen.project(centers), radii * seen.scale, seen.size)
    return span_counts(runs, len(seen), seen.size)


@dataclass(frozen=True, eq=False)
class DiscSpans:
    """Runs of pixels in pictures: those of the discs that are seen. m runs.

    owner        (m,) int64: the disc, counted view by view
    line         (m,) int64: the row, counted from the first view's first row
    first, stop  (m,) int64: columns, 0 <= first < stop <= size
    """

    owner: NDArray[np.int64]
    line: NDArray[np.int64]
    first: NDArray[np.int64]
    stop: NDArray[np.int64]


def disc_spans(columns: Float64Array, rows: Float64Array, radii: Float64Array, size: int) -> DiscSpans:
    """Return the pixels whose centres lie in discs: centres (d, n), radii (n,), all in pixels."""
    count = columns.shape[1]
    x, y = columns.ravel(), rows.ravel()
    low = np.clip(np.ceil(rows - radii - 0.5), 0, size).astype(np.int64).ravel()
    high = np.clip(np.floor(rows + radii - 0.5) + 1, 0, size).astype(np.int64).ravel()
    parts = [[np.zeros(0, np.int64)] * 4]
    for owner, step in expand_counts(np.maximum(high - low, 0)):
        row = low[owner] + step
        reach = np.sqrt(np.maximum(radii[owner % count] ** 2 - (row + 0.5 - y[owner]) ** 2, 0))
        first = np.clip(np.ceil(x[owner] - reach - 0.5), 0, size).astype(np.int64)
        stop = np.clip(np.floor(x[owner] + reach - 0.5) + 1, 0, size).astype(np.int64)
        some = np.flatnonzero(stop > first)
        parts.append([owner[some], (owner // count * size + row)[some], first[some], stop[some]])
    return DiscSpans(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def span_counts(runs: DiscSpans, pictures: int, size: int) -> Int32Array:
    """Return how many runs go over each pixel, (pictures, size, size) int32."""
    pitch = size + 1  # a run may stop beyond the last column
    total = pictures * size * pitch
    changes = np.bincount(runs.line * pitch + runs.first, minlength=total)
    changes -= np.bincount(runs.line * pitch + runs.stop, minlength=total)
    counts: Int32Array = np.cumsum(changes.reshape(pictures, size, pitch)[..., :size], axis=2, dtype=np.int32)
    return counts


def span_sums(runs: DiscSpans, pictures: Float32Array, discs: int) -> Float64Array:
    """Return the sum of pictures, (d, size, size), over each disc, (discs,) float64."""
    size = pictures.shape[-1]
    upto = np.zeros((len(pictures) * size, size + 1))
    np.cumsum(pictures.reshape(-1, size), axis=1, out=upto[:, 1:])
    sums = upto[runs.line, runs.stop] - upto[runs.line, runs.first]
    found: Float64Array = np.bincount(runs.owner, sums, discs).astype(np.float64, copy=False)
    return found


def _meets_a_centre(sides: list[Float32Array]) -> BoolArray:
    """Which triangles, by one coordinate of their corners, may reach the centre of a pixel."""
    a, b, c = sides
    low = np.minimum(np.minimum(a, b), c)
    high = np.maximum(np.maximum(a, b), c)
    meets: BoolArray = np.ceil(low - (0.5 + _SNAPPED)) <= np.floor(high - (0.5 - _SNAPPED))
    return meets
