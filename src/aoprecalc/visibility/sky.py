"""The light of a sky: how much comes from each direction, by which directions are weighed.

Radiance is in any unit, as ambient occlusion is a quotient.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.roles import up_axis
from aoprecalc.mesh.surface import normalize
from aoprecalc.options import ValueOptions
from aoprecalc.texture_lookup import LUMINANCE
from aoprecalc.types import Float32Array, Float64Array, Int64Array, Scene

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_GROUND_ALBEDO = 0.2  # of what reflects an overcast sky; that of grass and soil
_HORIZONTAL_IRRADIANCE = 7 / 9  # / (pi times the radiance of the zenith), of the CIE overcast sky
_POINTS_PER_CELL = 64  # of an image around each direction, at least, to average over
_MAX_CELLS = 1 << 15
_SHIFTS = 8  # of the place where the brightest direction is looked for

_MAX_HEIGHT, _MAX_WIDTH = 512, 1024  # of a sky's image in pixels, finer than any number of directions resolves
_FLOOR = 1e-3  # of the mean radiance, that comes from everywhere: no point of a surface is without any light

# The frame of an image by the axis that points up. For Y it is that of three.js, for Z that of Blender, which is the
# same after export to glTF.
_FRAMES = {
    "x": ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    "y": ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "z": ((1, 0, 0), (0, -1, 0), (0, 0, 1)),
}


class Sky(Protocol):
    """Light that comes from every direction."""

    def radiance(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return the radiance, (k,) >= 0, from (k, 3) unit vectors towards the sky."""
        ...

    def averaged(self, directions: Float64Array) -> "Sky":
        """Return a sky for these (n, 3) unit vectors, uniform on the sphere, that leaves none of its light out."""
        ...


@dataclass(frozen=True)
class OvercastSky:
    """The overcast sky of the CIE: three times as bright at the zenith as at the horizon.

    L(w) = (1 + 2 sin e) / 3 at the elevation e > 0 (P. Moon, D. E. Spencer, "Illumination from a nonuniform sky", 1942;
    CIE S 011/E:2003, sky 16). From below comes what a ground of albedo 0.2 reflects of it, 0.2 * 7 / 9.
    up   the unit vector to the zenith
    """

    up: tuple[float, float, float]

    def radiance(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return the radiance over that of the zenith, see Sky."""
        sine = directions.astype(np.float64) @ np.array(self.up)
        return np.where(sine > 0, (1 + 2 * sine) / 3, _GROUND_ALBEDO * _HORIZONTAL_IRRADIANCE)

    def averaged(self, directions: Float64Array) -> "OvercastSky":
        """Return itself: it is smooth."""
        return self


@dataclass(frozen=True, eq=False)
class ImageSky:
    """A sky from an equirectangular image.

    image   (h, w) float32 > 0; row 0 is at the zenith
    frame   (3, 3) float64, unit vectors in rows: towards the middle of the image, towards the middle of its right half,
            and to the zenith
    """

    image: Float32Array
    frame: Float64Array

    def radiance(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return the values of the pixels in which the directions lie, see Sky."""
        return self.image.ravel()[self._pixels(directions)].astype(np.float64)

    def averaged(self, directions: Float64Array) -> Sky:
        """Return the mean light around each direction: of all pixels to which it is the nearest.

        So a sun of one pixel is not missed. With more directions than _MAX_CELLS the sky is taken as it is.
        """
        if len(directions) > _MAX_CELLS:
            return self
        from scipy.spatial import KDTree  # in functions: slow to import

        parts = math.ceil(
            math.sqrt(_POINTS_PER_CELL * len(directions) / self.image.size)
        )  # of a pixel, along each side
        fine = replace(self, image=np.repeat(np.repeat(self.image, parts, axis=0), parts, axis=1))
        centers, areas = fine._pixel_centers()
        nearest = KDTree(directions).query(centers)[1]
        light, area = (
            np.bincount(nearest, weights, minlength=len(directions)) for weights in (areas * fine.image.ravel(), areas)
        )
        return SkyCells(directions, np.where(area > 0, light / np.where(area > 0, area, 1), self.radiance(directions)))

    def share_in_one(self, directions: int) -> float:
        """Return the share of the light that one of so many directions stands for: the one of the brightest place.

        The search begins at the brightest pixel, the first of equal ones, and moves to the middle of the light there.
        """
        (centers, areas), light, brightest = self._pixel_centers(), self._light(), np.argmax(self.image)
        towards = centers[brightest]
        for _ in range(_SHIFTS):
            near = centers @ towards >= 1 - 2 / directions  # a cap of 1 / directions of the sphere
            towards = normalize(light[near] @ centers[near])
        held = min(1, 1 / (directions * areas[brightest]))  # of the light of a pixel larger than that
        return float(held * light[near].sum() / light.sum())

    def density(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return the probability density of `sample`, (k,), per unit of solid angle."""
        density: Float64Array = self.radiance(directions) / (self._light().sum() * 4 * np.pi)
        return density

    def sample(self, u: Float64Array, v: NDArray[np.floating]) -> Float64Array:
        """Return directions, (k, 3), in proportion to their radiance, for (k,) numbers u and (k, 2) v in [0, 1)."""
        cumulative = np.cumsum(self._light())
        pixels = np.minimum(np.searchsorted(cumulative, u * cumulative[-1], "right"), len(cumulative) - 1)
        rows, columns = np.divmod(pixels, self.image.shape[1])
        edges = np.cos(np.pi * np.arange(len(self.image) + 1) / len(self.image))  # heights: areas are in proportion
        height = edges[rows] + (edges[rows + 1] - edges[rows]) * v[:, 0]
        return self._directions((columns + v[:, 1]) / self.image.shape[1], height)

    def _light(self) -> Float64Array:
        """Return the light of each pixel, (h w,), over 4 pi times the unit of radiance."""
        light: Float64Array = self._pixel_centers()[1] * self.image.ravel()
        return light

    def _pixel_centers(self) -> tuple[Float64Array, Float64Array]:
        """Return the directions of all pixels, (h w, 3), and their shares of the sphere, (h w,)."""
        height, width = self.image.shape
        edges = np.cos(np.pi * np.arange(height + 1) / height)
        rows, columns = np.divmod(np.arange(height * width), width)
        middle = np.cos(np.pi * (rows + 0.5) / height)
        areas: Float64Array = -np.diff(edges)[rows] / (2 * width)
        return self._directions((columns + 0.5) / width, middle), areas

    def _directions(self, u: Float64Array, height: Float64Array) -> Float64Array:
        """Return the unit vectors at u, (k,), in [0, 1] from the left of the image, and heights above the horizon."""
        azimuth = 2 * np.pi * (u - 0.5)
        radius = np.sqrt(np.maximum(1 - height**2, 0))
        directions: Float64Array = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
        return directions @ self.frame

    def _pixels(self, directions: NDArray[np.floating]) -> Int64Array:
        """Return the pixel of each direction, (k,): row * width + column."""
        height, width = self.image.shape
        right, across, up = self.frame @ directions.T.astype(np.float64)
        columns = np.floor((np.arctan2(across, right) / (2 * np.pi) + 0.5) * width).astype(np.int64) % width
        rows = np.floor(np.arccos(np.clip(up, -1, 1)) / np.pi * height).astype(np.int64)
        pixels: Int64Array = np.minimum(rows, height - 1) * width + columns
        return pixels


@dataclass(frozen=True, eq=False)
class SkyCells:
    """A sky of as many values as there are light directions; each holds around its direction.

    directions   (n, 3) float64 unit vectors
    values       (n,) float64: the mean radiance around each
    """

    directions: Float64Array
    values: Float64Array

    def radiance(self, directions: NDArray[np.floating]) -> Float64Array:
        """Return the value of the nearest direction, see Sky."""
        found: Float64Array = self.values[self._tree.query(directions)[1]]
        return found

    @cached_property
    def _tree(self) -> "KDTree":
        from scipy.spatial import KDTree

        return KDTree(self.directions)

    def averaged(self, directions: Float64Array) -> "SkyCells":
        """Return itself: that has been done."""
        return self


def sky_image(pixels: Float32Array) -> Float32Array:
    """Return the image of a sky, see ImageSky, from linear (height, width, channels) pixels.

    The luminance of larger ones is averaged over blocks, at most 512 x 1024 of them. A thousandth of the mean radiance
    is added, so that ambient occlusion is defined on every side of a mesh.
    """
    values = pixels[:, :, :3] @ LUMINANCE if pixels.shape[2] > 2 else pixels[:, :, 0]
    values = _block_means(_block_means(np.maximum(values, 0).astype(np.float64), _MAX_HEIGHT).T, _MAX_WIDTH).T
    areas = np.sin(np.pi * (np.arange(len(values)) + 0.5) / len(values))
    image: Float32Array = (values + _FLOOR * np.average(values.mean(axis=1), weights=areas)).astype(np.float32)
    return image


def _block_means(rows: Float64Array, count: int) -> Float64Array:
    """Return the means of consecutive rows, in `count` blocks of about equal size; the rows where there are fewer."""
    if len(rows) <= count:
        return rows
    edges = np.arange(count + 1) * len(rows) // count
    means: Float64Array = np.add.reduceat(rows, edges[:-1], axis=0) / np.diff(edges)[:, None]
    return means


def sky_of(scene: Scene, options: ValueOptions) -> Sky | None:
    """Return the sky that lights a scene; None where it is uniform."""
    if options.sky == "uniform":
        return None
    frame = np.array(_FRAMES[up_axis(scene, options)], np.float64)
    if options.sky == "overcast":
        return OvercastSky(tuple(frame[2].tolist()))
    assert scene.around.sky is not None  # read with the file of the options
    return ImageSky(scene.around.sky, frame)
