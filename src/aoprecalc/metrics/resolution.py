"""The error that the resolution of a texture adds, estimated before the bake, at any size in the same time.

At points of the surface the texture is compared with ray tracing, as in `errors.py`. Of the texture only the texels
around each point are baked, as tiles of a small image, so that neither time nor memory depend on its size.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.mesh.surface import SurfacePoints, sample_surface
from aoprecalc.metrics.reference import MeasuredSurface, RayReference
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Layout, area_per_texel, build_layout, clamp_barycentric
from aoprecalc.raster.padding import pad
from aoprecalc.raster.resolve import LeastSquaresImage, resolve_texels
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Atlas, Float32Array, Float64Array, Int64Array, Scene, Texels
from aoprecalc.visibility.directions import texel_offset
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.rays import RayCaster

POINTS = 4000
_REFERENCE_RAYS, _RAYS = 256, 16  # from a point; from each sample in a texel
_SAMPLES = 6  # in a texel
_TRIES = 64  # places in a texel at which samples are looked for: some of those at borders are hardly covered
_MARGIN = 2  # texels of a tile beyond the two that a look-up reads along each axis; the outermost have no samples
_TILE = 2 + 2 * _MARGIN


def resolution_error(
    scene: Scene,
    normals: Float32Array,
    atlas: Atlas,
    size: tuple[int, int],
    integrand: Integrand,
    threads: int,
) -> float:
    """Return the estimated RMS error, as rendered, of a texture without sampling errors.

    scene     with the roles of its parts; see `assign_roles`
    normals   (f, 3, 3) float32: the shading normals at the corners
    size      of the texture: its width and height in texels

    Both the texels and the values at the points are measured twice, by independent rays. The mean product of the two
    differences is the mean squared error of resolution alone: the noise of the rays has no part in it. Its standard
    error is added, so that what is estimated is seldom too small.
    Raises RendererError where rays cannot be cast.
    """
    points = sample_surface(scene, atlas.mapped, POINTS, seed=0)
    tiles = _Tiles.around(scene, atlas, points, size, threads)
    products, surface = np.ones(POINTS), MeasuredSurface(scene, normals, threads)
    reference = RayReference(surface.scene, surface.normals, integrand, threads)
    for half in range(2):
        values, expected = (
            _measured(surface, reference, of, rays, seed=2 * half + number)
            for number, (of, rays) in enumerate(((tiles.samples, _RAYS), (points, _REFERENCE_RAYS)))
        )
        products *= tiles.looked_up(values) - expected
    return math.sqrt(max(float(products.mean()), 0.0) + float(products.std()) / math.sqrt(POINTS))


def _measured(
    surface: MeasuredSurface, reference: RayReference, points: SurfacePoints, rays: int, seed: int
) -> Float64Array:
    """Return the ambient occlusion at points, (k,); those that are not on the detailed surface have the mean."""
    hit, on_surface = surface.points(points)
    found = reference.values(on_surface, rays, seed, Progress())
    values = np.full(len(points), found.mean() if len(found) else 1.0)
    values[hit] = found
    return values


@dataclass(frozen=True, eq=False)
class _Tiles:
    """The texels of a texture around points, as an image of tiles side by side: one for each point.

    side        of the image, in texels
    samples     k surface points in the texels
    positions   (k, 2) float32: theirs in the image, in texels right and down
    weights     (k,) float64: the surface area that each stands for, but for a factor
    uvs         (n, 2) float64: those of the points in the image, v upwards
    """

    side: int
    samples: SurfacePoints
    positions: Float32Array
    weights: Float64Array
    uvs: Float64Array

    @classmethod
    def around(cls, scene: Scene, atlas: Atlas, points: SurfacePoints, size: tuple[int, int], threads: int) -> Self:
        """Find samples in the texels of a texture around n points."""
        width, height = size
        position = points.interpolate(atlas.uvs) * (width, -height) + (0.0, height)
        if atlas.repeats:
            position %= size
        first = np.floor(position - 0.5) - _MARGIN
        columns = math.isqrt(len(points) - 1) + 1
        shift = np.stack(np.divmod(np.arange(len(points)), columns)[::-1], axis=1) * _TILE - first
        inner = np.stack(np.meshgrid(range(1, _TILE - 1), range(1, _TILE - 1)), axis=-1).reshape(-1, 2)
        texels = (first[:, None] + inner).reshape(-1, 2)
        texel, at, samples = _FlatSurface(build_layout(scene, atlas, width, height), threads).samples(
            texels, repeats=atlas.repeats
        )
        # A texel that holds a point has a sample in the bake, however little of it is covered.
        own = np.arange(len(points)) * len(inner) + (np.floor(position) - first - 1).astype(np.int64) @ (1, _TILE - 2)
        bare = np.flatnonzero(~np.isin(own, texel))
        texel, at = np.concatenate([texel, own[bare]]), np.concatenate([at, position[bare]])
        samples = SurfacePoints(
            np.concatenate([samples.faces, points.faces[bare]]),
            np.concatenate([samples.weights, points.weights[bare]]),
        )
        areas = area_per_texel(scene, atlas, Texels(width, height, np.zeros(0, np.int32)))
        positions = (at + shift[texel // len(inner)]).astype(np.float32)
        side = columns * _TILE
        uvs = (position + shift) * (1 / side, -1 / side) + (0.0, 1.0)
        return cls(side, samples, positions, areas[samples.faces], uvs)

    def looked_up(self, values: Float64Array) -> Float64Array:
        """Return what a renderer reads at the points, (n,), in a texture baked from the values of the samples, (k,)."""
        image = LeastSquaresImage(self.side, self.side, repeats=False)
        image.add_samples(self.positions, (1 - values).astype(np.float32), self.weights)
        texel = np.floor(self.positions).astype(np.int64) @ (1, self.side)
        count = np.bincount(texel, minlength=self.side**2)
        index = np.flatnonzero(count).astype(np.int32)
        means = (np.bincount(texel, values, self.side**2)[index] / count[index]).astype(np.float32)
        resolved = resolve_texels(Texels(self.side, self.side, index), means, np.ones(len(index), bool), image)
        padded = pad(resolved.values, resolved.known, _MARGIN)
        return bilinear(padded, self.uvs, repeats=False)


class _FlatSurface:
    """The triangles of a layout, laid flat, and met by rays from above."""

    def __init__(self, layout: Layout, threads: int) -> None:
        """Build over the triangles; `threads` cast rays, 0 is one for each core."""
        self._layout = layout
        flat = np.zeros((*layout.triangles.shape[:2], 3), np.float32)
        flat[..., :2] = layout.triangles
        self._caster = RayCaster(flat, threads)

    def samples(self, texels: Float64Array, *, repeats: bool) -> tuple[Int64Array, Float64Array, SurfacePoints]:
        """Return up to _SAMPLES samples in each of (t, 2) texels, columns and rows: k altogether.

        The index of the texel of each, (k,), its position in texels, (k, 2), and the point on the surface.
        """
        found: list[tuple[Int64Array, Float64Array, SurfacePoints]] = []
        count, open_ones = np.zeros(len(texels), np.intp), np.arange(len(texels))
        for group in range(_TRIES):
            at = texels[open_ones] + texel_offset(group)
            on, points = self._points(at % (self._layout.width, self._layout.height) if repeats else at)
            found.append((open_ones[on], at[on], points))
            count[open_ones[on]] += 1
            open_ones = open_ones[count[open_ones] < _SAMPLES]
        texel, at = (np.concatenate([entry[column] for entry in found]) for column in (0, 1))
        faces = np.concatenate([points.faces for _, _, points in found])
        return texel, at, SurfacePoints(faces, np.concatenate([points.weights for _, _, points in found]))

    def _points(self, positions: Float64Array) -> tuple[Int64Array, SurfacePoints]:
        """Return which of (k, 2) positions lie on a triangle, their indices, and the points there."""
        layout = self._layout
        hits = self._caster.below(positions.astype(np.float32))
        on = np.flatnonzero(hits >= 0)
        first, second, third = layout.triangles[hits[on]].astype(np.float64).transpose(1, 2, 0)
        along, across, to = second - first, third - first, positions[on].T - first
        doubled = along[0] * across[1] - along[1] * across[0]
        weights = np.stack([to[0] * across[1] - to[1] * across[0], along[0] * to[1] - along[1] * to[0]])
        weights = clamp_barycentric((weights / np.where(doubled == 0, 1.0, doubled)).astype(np.float32))
        return on, SurfacePoints(layout.faces[hits[on]].astype(np.intp), weights.astype(np.float64))
