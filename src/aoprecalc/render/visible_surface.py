"""What the samples of a picture see: the triangle of each, by OpenGL or rays, and the fragments that are shaded."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aoprecalc.raster.cpu_rasterizer import expand_counts
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from aoprecalc.visibility.rays import RayCaster

_RAYS = 1 << 20  # made at a time
_FAR = 4.0  # radii: shadow rays start as high above the ground, outside the mesh


class SurfaceDrawer(Protocol):
    """Draws the triangles of one mesh; both their sides are visible and cast shadows.

    max_size   samples along the longest side of what is drawn at once
    """

    max_size: int

    def visible(self, matrix: Float64Array, width: int, height: int) -> Int32Array:
        """Return the index of the triangle that each sample sees, (height, width) int32; -1 where there is none.

        matrix   (4, 4): from positions to OpenGL's clip space; row 0 is at y = -1
        """
        ...

    def count_shadows(self, directions: Float64Array, ground: float, window: Float64Array, size: int) -> Float32Array:
        """Return how many of the directions towards light are blocked at points of the ground, (size, size) float32.

        directions   (d, 3) unit vectors, y > 0
        ground       the height y of the ground
        window       x and z of the first corner of the square, and its side, (3,); rows along z, columns along x
        """
        ...


class RayDrawer:
    """A SurfaceDrawer that casts rays."""

    max_size = 1 << 30

    def __init__(self, corners: Float32Array, casters: Float32Array, threads: int = 0) -> None:
        """Build over the triangles that are seen, (o, 3, 3) corners, and those that cast shadows, (s, 3, 3)."""
        self._seen = RayCaster(corners, threads)
        self._casters = self._seen if casters is corners else RayCaster(casters, threads)
        self._box, self._caster_box = _box(corners), _box(casters)

    def visible(self, matrix: Float64Array, width: int, height: int) -> Int32Array:
        """Return the index of the triangle that each sample sees, see SurfaceDrawer."""
        indices = np.full((height, width), -1, np.int32)
        box = np.column_stack([self._box, np.ones(8)]) @ matrix.T
        (left, right), (top, bottom) = (
            _span((box[:, axis] / box[:, 3] + 1) * (size / 2), size) for axis, size in ((0, width), (1, height))
        )
        eye, middle, across, down = (vector.astype(np.float32) for vector in _perspective(matrix))
        by_column = _clip_coordinates(left, right, width).astype(np.float32)[:, None] * across
        rows = max(_RAYS // max(len(by_column), 1), 1)
        for first in range(top, bottom, rows):
            end = min(first + rows, bottom)
            by_row = _clip_coordinates(first, end, height).astype(np.float32)[:, None] * down + middle
            rays = (by_row[:, None] + by_column).reshape(-1, 3)
            indices[first:end, left:right] = self._seen.first_hits(eye, rays).reshape(-1, len(by_column))
        return indices

    def count_shadows(self, directions: Float64Array, ground: float, window: Float64Array, size: int) -> Float32Array:
        """Return how many directions are blocked, see SurfaceDrawer."""
        step = window[2] / size
        counts = np.zeros((size, size), np.float32)
        for direction in directions:
            along = direction / direction[1]
            shadow = self._caster_box - (self._caster_box[:, 1:2] - ground) * along
            columns, rows = (_span((shadow[:, k] - at) / step, size) for k, at in ((0, window[0]), (2, window[1])))
            # From afar back to the ground: what touches the ground itself counts as well.
            origins = np.empty((rows[1] - rows[0], columns[1] - columns[0], 3), np.float32)
            origins[..., 0] = window[0] + (np.arange(*columns) + 0.5) * step + _FAR * along[0]
            origins[..., 1] = ground + _FAR
            origins[..., 2] = (window[1] + (np.arange(*rows) + 0.5) * step + _FAR * along[2])[:, None]
            hits = self._casters.occluded(origins.reshape(-1, 3), -direction[None].astype(np.float32))
            counts[slice(*rows), slice(*columns)] += hits.reshape(origins.shape[:2])
        return counts


class SphereDrawer:
    """A SurfaceDrawer of n spheres: what is seen and what casts shadows are spheres, not triangles."""

    max_size = 1 << 30

    def __init__(self, centers: Float64Array, radii: Float64Array) -> None:
        """Take (n, 3) centres and (n,) radii >= 0."""
        self._centers, self._radii = centers, radii

    def visible(self, matrix: Float64Array, width: int, height: int) -> Int32Array:
        """Return the index of the sphere that each sample sees, see SurfaceDrawer."""
        indices = np.full((height, width), -1, np.int32)
        nearest = np.full((height, width), np.inf, np.float32)
        eye, middle, across, down = _perspective(matrix)
        columns, rows = _sphere_bounds(self._centers, self._radii, matrix, width, height)
        for number, (center, radius) in enumerate(zip(self._centers, self._radii, strict=True)):
            (left, right), (top, bottom) = columns[number], rows[number]
            box = slice(top, bottom), slice(left, right)
            x, y = _clip_coordinates(left, right, width), _clip_coordinates(top, bottom, height)
            # The quadratic equation of a ray and a sphere: its terms are sums of one of x and one of y.
            away = eye - center
            a = (x * x * (across @ across) + 2 * x * (middle @ across)) + (
                y * y * (down @ down) + 2 * y * (middle @ down) + middle @ middle
            )[:, None]
            b = x * (away @ across) + (y * (away @ down) + away @ middle)[:, None]
            root = b * b - a * (away @ away - radius**2)
            np.sqrt(root, out=root, where=root > 0)
            in_front = (root > 0) & (-b > root)  # not behind the eye, nor around it
            along = np.where(in_front, (-b - root) / a, np.inf).astype(np.float32)
            closer = along < nearest[box]
            np.copyto(nearest[box], along, where=closer)
            np.copyto(indices[box], number, where=closer)
        return indices

    def count_shadows(self, directions: Float64Array, ground: float, window: Float64Array, size: int) -> Float32Array:
        """Return how many directions are blocked, see SurfaceDrawer."""
        above = self._centers[:, 1] + self._radii > ground
        scale = size / window[2]
        centers = (self._centers[above] - [window[0], ground, window[1]]) * scale
        radii = self._radii[above] * scale
        counts = np.zeros(size * size, np.float32)
        for light in directions:
            counts += _shadowed_by_spheres(centers, radii, light, size)
        return counts.reshape(size, size)


def _box(corners: Float32Array) -> Float64Array:
    """Return the corners of the bounding box of (o, 3, 3) corners, (8, 3)."""
    points = corners.reshape(-1, 3)
    ends = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


def _span(places: Float64Array, size: int) -> tuple[int, int]:
    """Return the first and the end of `size` samples, with centres at halves, that places lie among."""
    low, high = np.clip([np.floor(places.min() - 0.5), np.ceil(places.max() + 0.5)], 0, size)
    return int(low), int(high)


def _clip_coordinates(begin: int, end: int, size: int) -> Float64Array:
    """Return where samples begin to end of `size` lie between -1 and 1."""
    return np.asarray((np.arange(begin, end) + 0.5) * (2 / size) - 1, np.float64)


def _perspective(matrix: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return the eye of a camera and its rays: through (x, y) of clip space goes middle + x across + y down.

    across and down are perpendicular; the rays end at the far plane.
    """
    back = np.linalg.inv(matrix)
    eye = back[:3, 2] / back[3, 2]
    depth = back[3, 2] + back[3, 3]
    return eye, (back[:3, 2] + back[:3, 3]) / depth - eye, back[:3, 0] / depth, back[:3, 1] / depth


def _sphere_bounds(
    centers: Float64Array, radii: Float64Array, matrix: Float64Array, width: int, height: int
) -> tuple[Int64Array, Int64Array]:
    """Return the columns and the rows, (n, 2) begin and end each, of the samples that spheres may cover.

    (C. Sigg et al., "GPU-Based Ray-Casting of Quadratic Surfaces", Point-Based Graphics 2006.)
    """
    x, y, _, w = (row[:3] for row in matrix)
    at = np.column_stack([centers, np.ones(len(centers))]) @ matrix.T
    squared = radii**2
    a = at[:, 3] ** 2 - squared * (w @ w)
    ahead = at[:, 3] > radii * np.sqrt(w @ w)  # others may be anywhere in the picture
    bounds = []
    for axis, row, size in ((0, x, width), (1, y, height)):
        b = at[:, axis] * at[:, 3] - squared * (row @ w)
        c = at[:, axis] ** 2 - squared * (row @ row)
        half = np.sqrt(np.maximum(b * b - a * c, 0))
        ends = (np.stack([b - half, b + half], axis=1) / np.where(ahead, a, 1)[:, None] + 1) * size / 2
        ends = np.stack([np.floor(ends[:, 0] - 0.5), np.ceil(ends[:, 1] + 0.5)], axis=1)
        ends = np.where(ahead[:, None], np.clip(ends, 0, size), (0, size))
        bounds.append(ends.astype(np.int64))
    return bounds[0], bounds[1]


def _shadowed_by_spheres(centers: Float64Array, radii: Float64Array, light: Float64Array, size: int) -> BoolArray:
    """Return which points of a square grid lie in the shadow of any of n spheres in one direction, (size * size,).

    centers   (n, 3), in steps of the grid on the ground y = 0, whose points are at halves
    radii     (n,), in the same steps
    """
    x, z = (centers[:, axis] - light[axis] / light[1] * centers[:, 1] for axis in (0, 2))
    sunk = centers[:, 1] < radii
    # A point e from the shadow of the centre is in shadow where |e|^2 - (e.l)^2 <= r^2: an ellipse.
    a = 1 - light[0] ** 2
    reach = radii * np.sqrt(a) / light[1]
    first = np.clip(np.ceil(z - reach - 0.5), 0, size).astype(np.int64)
    end = np.clip(np.floor(z + reach - 0.5) + 1, 0, size).astype(np.int64)
    pitch = size + 1
    changes = np.zeros(size * pitch, np.int64)
    for sphere, step in expand_counts(np.maximum(end - first, 0)):
        row = first[sphere] + step
        away = row + 0.5 - z[sphere]
        b = light[0] * light[2] * away
        half = np.sqrt(np.maximum(b * b - a * (away**2 * (1 - light[2] ** 2) - radii[sphere] ** 2), 0))
        ends = x[sphere] + np.stack([b - half, b + half]) / a
        if (index := np.flatnonzero(sunk[sphere])).size:
            chosen = sphere[index]
            ends[:, index] = _above_ground(ends[:, index], row[index] + 0.5, centers[chosen], radii[chosen], light)
        begin, stop = np.clip(np.ceil(ends - 0.5), 0, size).astype(np.int64)
        changes += np.bincount(row * pitch + begin, minlength=len(changes))
        changes -= np.bincount(row * pitch + stop, minlength=len(changes))
    covered: BoolArray = np.cumsum(changes.reshape(size, pitch)[:, :size], axis=1) > 0
    return covered.ravel()


def _above_ground(
    ends: Float64Array, row: Float64Array, centers: Float64Array, radii: Float64Array, light: Float64Array
) -> Float64Array:
    """Return what is left of k rows of the shadows of spheres, (2, k) ends, without what only their lower parts cast.

    row   (k,): z of each

    That is the points inside the sphere, and those from which its centre is not behind, seen along the light.
    """
    away = centers[:, 2] - row
    squared = radii**2 - centers[:, 1] ** 2 - away**2
    inside = np.where(squared > 0, np.sqrt(np.maximum(squared, 0)), -np.inf)
    bound = centers @ light - light[2] * row  # of x times the light's x
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.nan_to_num(bound / abs(light[0]), nan=np.inf)
    low, high = (ends[0], np.minimum(ends[1], bound)) if light[0] >= 0 else (np.maximum(ends[0], -bound), ends[1])
    empty = low > high
    low, high = np.where(empty, np.inf, low), np.where(empty, -np.inf, high)
    both = np.minimum(low, centers[:, 0] - inside), np.maximum(high, centers[:, 0] + inside)
    return np.where(both[0] > both[1], ends[:1], np.stack(both))


@dataclass(frozen=True, eq=False)
class Fragments:
    """What is shaded: each triangle in each pixel once, where the mean of its samples is. m fragments, pixel by pixel.

    As multisampling does, but for the place (K. Akeley, "RealityEngine Graphics", SIGGRAPH 1993).

    pixel    (m,) int32: row * columns + column, ascending
    index    (m,) int32: of the triangle
    x, y     (m,) float32: the place in pixels, from the upper left corner of the rows drawn
    weight   (m,) float32: its share of the pixel
    """

    pixel: Int32Array
    index: Int32Array
    x: Float32Array
    y: Float32Array
    weight: Float32Array


def fragments(indices: Int32Array, samples: int) -> Fragments:
    """Join the samples of each pixel that see the same triangle.

    indices   (rows * samples, columns * samples) int32, -1 where nothing is seen
    samples   along each side of a pixel
    """
    rows, columns = (side // samples for side in indices.shape)
    blocks = indices.reshape(rows, samples, columns, samples)
    low, high = (
        extreme.reduce([extreme.reduce([blocks[:, j, :, i] for j in range(samples)]) for i in range(samples)])
        for extreme in (np.minimum, np.maximum)
    )
    whole: BoolArray = (low == high) & (low >= 0)
    mixed = np.flatnonzero(low != high)
    pixel, index, weight, place = _split(blocks, mixed, samples)
    # Whole pixels are shaded at their centres.
    all_pixels = np.concatenate([np.flatnonzero(whole), pixel])
    order = np.argsort(all_pixels, kind="stable")
    count = len(all_pixels) - len(pixel)
    centres = np.full((count, 2), 0.5, np.float32)
    offsets = np.concatenate([centres, place])[order]
    pixels = all_pixels[order].astype(np.int32)
    return Fragments(
        pixel=pixels,
        index=np.concatenate([low[whole], index])[order],
        x=(pixels % columns + offsets[:, 0]).astype(np.float32),
        y=(pixels // columns + offsets[:, 1]).astype(np.float32),
        weight=np.concatenate([np.ones(count, np.float32), weight])[order],
    )


def _split(
    blocks: Int32Array, mixed: Int64Array, samples: int
) -> tuple[Int64Array, Int32Array, Float32Array, Float32Array]:
    """Return pixel, index, weight and mean place, (m, 2), of the fragments of mixed pixels."""
    row, column = np.divmod(mixed, blocks.shape[2])
    count = samples * samples
    keys = blocks[row, :, column].reshape(-1, count).astype(np.int64) * count + np.arange(count)
    keys.sort(axis=1)
    index, sample = np.divmod(keys, count)
    begins = np.ones(index.shape, bool)
    begins[:, 1:] = index[:, 1:] != index[:, :-1]
    first = np.flatnonzero(begins)
    if not len(first):
        return mixed, np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros((0, 2), np.float32)
    sizes = np.diff(first, append=index.size)
    sums = np.add.reduceat(np.stack([sample % samples, sample // samples], axis=-1).reshape(-1, 2), first)
    seen = index.ravel()[first] >= 0
    place = (sums / sizes[:, None] + 0.5) / samples
    return (
        mixed[first // count][seen],
        index.ravel()[first][seen].astype(np.int32),
        (sizes[seen] / count).astype(np.float32),
        place[seen].astype(np.float32),
    )
