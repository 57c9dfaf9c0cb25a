"""Silhouettes of meshes and spheres in orthographic views, and the optimisation of spheres towards them.

A silhouette is the set of pixels whose centres the projection covers. Rasterised by NumPy, without OpenGL.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoprecalc.raster.cpu_rasterizer import expand_counts, snap_to_grid, triangle_spans
from aoprecalc.raster.layout import CENTER
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO, fibonacci_hemisphere, orthonormal_basis

_SNAP_MARGIN = 1 / 256  # pixels: the largest movement of a corner when it is snapped to the rasteriser's grid


@dataclass(frozen=True, eq=False)
class Views:
    """Orthographic views of the square around the origin. d views.

    across, upward   (d, 3) float64: unit vectors of the image's column and row directions
    half_extent      half the side of the square, in the points' units, > 0
    resolution       pixels per side
    """

    across: Float64Array
    upward: Float64Array
    half_extent: float
    resolution: int

    def __len__(self) -> int:
        return len(self.across)

    def __getitem__(self, index: slice | NDArray[np.intp]) -> "Views":
        return Views(self.across[index], self.upward[index], self.half_extent, self.resolution)

    @property
    def pixels_per_unit(self) -> float:
        """Image scale."""
        return self.resolution / (2 * self.half_extent)

    def project(self, points: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the columns and the rows of points, (k, 3), in pixels, (d, k) float64 each."""
        columns, rows = (
            axes @ points.T * self.pixels_per_unit + self.resolution / 2 for axes in (self.across, self.upward)
        )
        return columns, rows


def fibonacci_views(count: int, half_extent: float, resolution: int, turn: float) -> Views:
    """Return `count` views with uniform directions of a hemisphere: opposite views mirror the silhouette.

    turn   rotation of the directions about z, as a fraction of a full turn: gives measurement other views than fitting
    """
    across, upward = orthonormal_basis(fibonacci_hemisphere(np.arange(count), count, turn))
    return Views(across, upward, half_extent, resolution)


def mesh_silhouettes(positions: Float64Array, faces: Int32Array, views: Views) -> BoolArray:
    """Return the pixels covered by (f, 3) faces over (v, 3) positions, (d, resolution, resolution) bool."""
    size = views.resolution
    masks = np.zeros((len(views), size, size), bool)
    corners = np.ascontiguousarray(faces.T)
    for index, mask in enumerate(masks):
        projected = [axis[0].astype(np.float32) for axis in views[np.array([index])].project(positions)]
        columns = [np.take(projected[0], corner) for corner in corners]
        rows = [np.take(projected[1], corner) for corner in corners]
        candidates = np.flatnonzero(_may_cover_center(columns) & _may_cover_center(rows))
        triangles = np.stack(
            [np.stack([side[candidates] for side in axis], axis=1) for axis in (columns, rows)], axis=2
        )
        spans = list(triangle_spans(snap_to_grid(triangles, CENTER), size, 0, size))
        if spans:
            first, length = (np.concatenate([span[k] for span in spans]) for k in (1, 2))
            changes = np.bincount(first, minlength=size * size + 1)
            changes -= np.bincount(first + length, minlength=size * size + 1)
            mask[:] = (np.cumsum(changes[:-1]) > 0).reshape(size, size)
    return masks


def spheres_per_pixel(centers: Float64Array, radii: Float64Array, views: Views) -> Int32Array:
    """Return how many of n spheres cover each pixel, (d, resolution, resolution) int32.

    centers (n, 3), radii (n,) >= 0
    """
    spans = disc_spans(*views.project(centers), radii * views.pixels_per_unit, views.resolution)
    return span_counts(spans, len(views), views.resolution)


@dataclass(frozen=True, eq=False)
class DiscSpans:
    """Horizontal spans of pixels covered by discs. m spans.

    disc          (m,) int64: index of the disc, view by view
    row           (m,) int64: index of the row, counted through all views
    start, stop   (m,) int64: columns, 0 <= start < stop <= resolution
    """

    disc: Int64Array
    row: Int64Array
    start: Int64Array
    stop: Int64Array


def disc_spans(columns: Float64Array, rows: Float64Array, radii: Float64Array, resolution: int) -> DiscSpans:
    """Rasterise discs with centres (d, n), the same in each view, and radii (n,), all in pixels."""
    count = columns.shape[1]
    x, y = columns.ravel(), rows.ravel()
    bottom = np.clip(np.ceil(rows - radii - 0.5), 0, resolution).astype(np.int64).ravel()
    top = np.clip(np.floor(rows + radii - 0.5) + 1, 0, resolution).astype(np.int64).ravel()
    chunks = [[np.zeros(0, np.int64)] * 4]
    for disc, step in expand_counts(np.maximum(top - bottom, 0)):
        row = bottom[disc] + step
        half_width = np.sqrt(np.maximum(radii[disc % count] ** 2 - (row + 0.5 - y[disc]) ** 2, 0))
        start = np.clip(np.ceil(x[disc] - half_width - 0.5), 0, resolution).astype(np.int64)
        stop = np.clip(np.floor(x[disc] + half_width - 0.5) + 1, 0, resolution).astype(np.int64)
        kept = np.flatnonzero(stop > start)
        chunks.append([disc[kept], (disc // count * resolution + row)[kept], start[kept], stop[kept]])
    return DiscSpans(*(np.concatenate(column) for column in zip(*chunks, strict=True)))


def span_counts(spans: DiscSpans, views: int, resolution: int) -> Int32Array:
    """Return how many spans cover each pixel, (views, resolution, resolution) int32."""
    return _counts_by_column(spans, views, resolution).transpose(1, 2, 0)


def _counts_by_column(spans: DiscSpans, views: int, resolution: int) -> Int32Array:
    """Return what `span_counts` does, with the columns first, (resolution, views, resolution) int32.

    So the sums along rows add whole columns, which NumPy does in a third of the time of a sum along memory.
    """
    rows = views * resolution
    counts: Int32Array = np.zeros((resolution + 1, rows), np.int32)  # a span may stop after the last column
    flat = counts.reshape(-1)
    np.add.at(flat, spans.start * rows + spans.row, np.int32(1))
    np.subtract.at(flat, spans.stop * rows + spans.row, np.int32(1))
    for column in range(1, resolution):
        np.add(counts[column - 1], counts[column], out=counts[column])
    return counts[:resolution].reshape(resolution, views, resolution)


def span_sums(spans: DiscSpans, images: Float32Array, discs: int) -> Float64Array:
    """Return the sum of the pixels of images, (d, resolution, resolution), over each disc, (discs,) float64."""
    size = images.shape[-1]
    prefix_sums = np.zeros((len(images) * size, size + 1))
    np.cumsum(images.reshape(-1, size), axis=1, out=prefix_sums[:, 1:])
    sums = prefix_sums[spans.row, spans.stop] - prefix_sums[spans.row, spans.start]
    disc_sums: Float64Array = np.bincount(spans.disc, sums, discs).astype(np.float64, copy=False)
    return disc_sums


def _may_cover_center(corners: list[Float32Array]) -> BoolArray:
    """Return which triangles may contain the centre of a pixel, judged by one coordinate of their three corners."""
    a, b, c = corners
    low = np.minimum(np.minimum(a, b), c)
    high = np.maximum(np.maximum(a, b), c)
    may_cover: BoolArray = np.ceil(low - (0.5 + _SNAP_MARGIN)) <= np.floor(high - (0.5 - _SNAP_MARGIN))
    return may_cover


# Gradient descent on silhouettes.

_EDGE_BLUR = 0.7  # pixels: turns the step at a silhouette's edge into a slope on which outlines come to rest
_SAMPLES_PER_VIEW = 3200  # on the outlines of all spheres
_MIN_OUTLINE_SAMPLES, _MAX_OUTLINE_SAMPLES = 12, 160  # on the outline of one sphere
_MAX_SAMPLES_PER_STEP = 1 << 22  # in all views of a step, to bound memory
_BETA_1, _BETA_2, _EPSILON = 0.8, 0.95, 1e-12  # Adam's decay rates, and what keeps its quotient finite
_MIN_RADIUS = 0.25  # pixels


class SilhouetteDescent:
    """Moves and resizes spheres so that their silhouettes approach a mesh's, by stochastic gradient descent.

    The objective is the area of the symmetric difference of the silhouettes, averaged over views. Its derivative is
    concentrated on the outline of the union of discs: outside the mesh's silhouette an outline should retreat, inside
    it should advance, and outlines covered by other discs do not count. Each step uses the next few views.
    (Shape derivatives: J. Sokolowski, J.-P. Zolesio, Introduction to Shape Optimization, 1992; the optimiser: D. P.
    Kingma, J. Ba, Adam, 2015.)

    centers   (n, 3) float64, updated by `step`
    radii     (n,) float64, updated by `step`
    """

    def __init__(
        self, centers: Float64Array, radii: Float64Array, masks: BoolArray, views: Views, views_per_step: int
    ) -> None:
        """Start from spheres and the mesh's silhouettes, (d, resolution, resolution), in `views`.

        views_per_step   upper limit; fewer are used if there are very many spheres
        """
        self.centers, self.radii = centers.copy(), radii.copy()
        self._samples = int(np.clip(_SAMPLES_PER_VIEW // len(radii), _MIN_OUTLINE_SAMPLES, _MAX_OUTLINE_SAMPLES))
        self._views = views
        self._views_per_step = max(
            1, min(views_per_step, len(views), _MAX_SAMPLES_PER_STEP // (self._samples * len(radii)))
        )
        # +1 outside the silhouettes, -1 inside, with a border for what lies outside the image.
        signs = np.pad(np.where(masks, -1.0, 1.0).astype(np.float32), ((0, 0), (1, 1), (1, 1)), constant_values=1.0)
        self._signs: Float32Array = ndimage.gaussian_filter(signs, (0, _EDGE_BLUR, _EDGE_BLUR), mode="nearest")
        self._steps = 0
        self._first_moment = np.zeros((len(radii), 4))
        self._second_moment = np.zeros((len(radii), 4))

    def step(self, step_size: float, extra_gradient: Float64Array | None = None) -> None:
        """Take one optimiser step, which moves the outlines by about `step_size` pixels.

        extra_gradient   (n, 4): gradient of another objective term with respect to (x, y, z, r), all in pixels
        """
        views = self._views
        start = self._steps * self._views_per_step
        index = np.arange(start, start + self._views_per_step) % len(views)
        gradient = self._gradient(index) if extra_gradient is None else self._gradient(index) + extra_gradient
        self._steps += 1
        self._first_moment += (1 - _BETA_1) * (gradient - self._first_moment)
        self._second_moment += (1 - _BETA_2) * (gradient**2 - self._second_moment)
        mean = self._first_moment / (1 - _BETA_1**self._steps)
        square = self._second_moment / (1 - _BETA_2**self._steps)
        move = step_size / views.pixels_per_unit * mean / (np.sqrt(square) + _EPSILON)
        self.centers -= move[:, :3]
        self.radii = np.maximum(self.radii - move[:, 3], _MIN_RADIUS / views.pixels_per_unit)

    def _gradient(self, index: NDArray[np.intp]) -> Float64Array:
        """Return the objective's gradient with respect to (x, y, z, r) in pixels, (n, 4): the mean over some views."""
        views = self._views[index]
        size = views.resolution
        columns, rows = views.project(self.centers)
        radii = self.radii * views.pixels_per_unit
        spans = disc_spans(columns, rows, radii, size)
        counts = _counts_by_column(spans, len(index), size)

        samples = self._samples
        angles = 2 * np.pi * (np.arange(samples) + self._steps * INV_GOLDEN_RATIO % 1.0) / samples
        cos, sin = np.cos(angles), np.sin(angles)
        x = columns[..., None] + cos * radii[:, None]  # (d, n, samples)
        y = rows[..., None] + sin * radii[:, None]
        column, row = (np.clip(np.floor(each), -1, size).astype(np.int64) for each in (x, y))
        outside = (column < 0) | (column >= size) | (row < 0) | (row >= size)
        view = np.arange(len(index))[:, None, None]
        in_counts = (column * len(index) + view) * size + row  # any pixel, if it is outside
        in_signs = (index[:, None, None] * (size + 2) + (row + 1)) * (size + 2) + (column + 1)
        # A sample counts if no other disc covers its pixel: all that do, minus its own.
        own = (column + 0.5 - columns[..., None]) ** 2 + (row + 0.5 - rows[..., None]) ** 2 <= radii[:, None] ** 2
        exposed = (np.take(counts.reshape(-1), in_counts, mode="clip") == own) | outside
        signs = np.where(exposed, np.take(self._signs.reshape(-1), in_signs), 0)
        arc = 2 * np.pi * radii / samples  # length of outline per sample
        across, upward, outward = (signs @ cos) * arc, (signs @ sin) * arc, signs.sum(axis=2) * arc
        gradient = np.empty((len(radii), 4))
        gradient[:, :3] = (across.T @ views.across + upward.T @ views.upward) / len(index)
        gradient[:, 3] = outward.mean(axis=0)
        return gradient
