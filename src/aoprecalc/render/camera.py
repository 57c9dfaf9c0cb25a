"""A perspective camera on an orbit around the mesh, and the frame in which it draws: the unit sphere, y up."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import bounding_sphere
from aoprecalc.types import Float32Array, Float64Array

# Of half the vertical angle of view: near enough for depth, hardly distorted.
_TANGENT = float(np.tan(np.radians(13.0)))
_MIN_DISTANCE = 0.3  # of the eye from the nearest point, in radii: for needles seen from their tip, and points
_CENTERINGS = 4  # steps of a fixed-point iteration

# Rows: the axes of the picture's frame in the mesh's coordinates, by the mesh's upward axis. Proper rotations.
_Y_UP: dict[str, list[list[int]]] = {
    "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
}


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """The transform of a mesh into the unit sphere, turned so that y points up.

    center     (3,) float64: of the mesh's bounding box
    radius     its greatest distance from there, in mesh units, > 0
    rotation   (3, 3) float64
    """

    center: Float64Array
    radius: float
    rotation: Float64Array

    @classmethod
    def from_positions(cls, positions: Float64Array, up: Literal["x", "y", "z"]) -> Self:
        """Build the frame of (v, 3) positions with this upward axis."""
        return cls(*bounding_sphere(positions), np.array(_Y_UP[up], np.float64))

    def points(self, positions: Float64Array) -> Float64Array:
        """Transform positions, (..., 3)."""
        moved: Float64Array = ((positions - self.center) / self.radius) @ self.rotation.T
        return moved

    def vectors(self, vectors: NDArray[np.floating]) -> Float32Array:
        """Turn unit vectors, (..., 3)."""
        return (vectors @ self.rotation.T).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera.

    axes              (3, 3) float64: unit vectors to the picture's right, to its top and towards the camera
    eye               (3,) float64
    tangent           of half the vertical angle of view
    width, height     of the whole picture, in pixels
    rows              the first and the end of its rows that are drawn, from the top
    """

    axes: Float64Array
    eye: Float64Array
    tangent: float
    width: int
    height: int
    rows: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that are drawn."""
        return self.rows[1] - self.rows[0], self.width

    @property
    def tangents(self) -> Float64Array:
        """The tangents of half the angles of view along the picture's width and height, (2,)."""
        return np.array([self.tangent * self.width / self.height, self.tangent])

    def bands(self, rows: int) -> Iterator["Camera"]:
        """Yield cameras that draw the picture in bands of at most this many rows, from the top."""
        for first in range(0, self.height, rows):
            yield replace(self, rows=(first, min(first + rows, self.height)))

    def rays(self, columns: NDArray[np.floating], rows: NDArray[np.floating]) -> Float32Array:
        """Return the rays through points of the picture, in pixels from its upper left corner, (..., 3) float32.

        Their component along the view is 1.
        """
        across, upward = self.tangents
        x = ((2 / self.width) * columns - 1) * across
        y = (1 - (2 / self.height) * rows) * upward
        right, top, towards = self.axes.astype(np.float32)
        rays: Float32Array = x.astype(np.float32)[..., None] * right + y.astype(np.float32)[..., None] * top - towards
        return rays

    def project(self, points: Float64Array) -> Float64Array:
        """Return the column and the row in pixels, and the depth along the view, of points, (..., 3) from (..., 3)."""
        seen: Float64Array = (points - self.eye) @ self.axes.T
        depth = -seen[..., 2]
        across, upward = self.tangents
        return np.stack(
            [
                (seen[..., 0] / (depth * across) + 1) * self.width / 2,
                (1 - seen[..., 1] / (depth * upward)) * self.height / 2,
                depth,
            ],
            axis=-1,
        )

    def clip_matrix(self, points: Float64Array) -> Float64Array:
        """Return the matrix from positions to OpenGL's clip space for the rows drawn, (4, 4); row 0 is at y = -1.

        points   (k, 3): what lies between the near and the far plane
        """
        depth = -(points - self.eye) @ self.axes[2]
        near, far = 0.95 * float(depth.min()), 1.05 * float(depth.max())
        right, top, towards = self.axes
        across, upward = self.tangents
        matrix = np.zeros((4, 4))
        matrix[0, :3], matrix[1, :3], matrix[3, :3] = right / across, -top / upward, -towards
        matrix[2, :3] = -towards * (far + near) / (far - near)
        matrix[:, 3] = -matrix[:, :3] @ self.eye
        matrix[2, 3] -= 2 * far * near / (far - near)
        # From the whole picture to the rows drawn: y, in [-1, 1], grows downwards.
        first, end = (2 * row / self.height - 1 for row in self.rows)
        matrix[1] = (2 * matrix[1] - (first + end) * matrix[3]) / (end - first)
        return matrix


def view_axes(azimuth: float, elevation: float) -> Float64Array:
    """Return the axes of a camera on the orbit, (3, 3); angles in degrees, azimuth 0 looks along -z."""
    turn, rise = np.radians([azimuth, elevation])
    right = np.array([np.cos(turn), 0.0, -np.sin(turn)])
    towards = np.array([np.sin(turn) * np.cos(rise), np.sin(rise), np.cos(turn) * np.cos(rise)])
    return np.stack([right, np.cross(towards, right), towards])


def frame_views(
    views: Sequence[tuple[Float64Array, Sequence[tuple[Float64Array, float]]]], width: int, height: int
) -> list[Camera]:
    """Place a camera for each view so that its points fill the picture, all at one distance and height.

    views   the axes of each, (3, 3), and its points, (k, 3), in groups that may fill a share of the width and height
    """
    # Each side of the picture is a plane through the eye, with all points on one side of it: the outermost decide.
    sides: list[tuple[Float64Array, Float64Array, Float64Array]] = []
    nearest = -np.inf
    for axes, groups in views:
        for points, share in groups:
            across, depth = points @ axes[:2].T, points @ axes[2]
            slope = share * _TANGENT * np.array([width / height, 1.0])
            low = (across - slope * depth[:, None]).argmin(axis=0)
            high = (across + slope * depth[:, None]).argmax(axis=0)
            sides.append((slope, across[[low, high], [0, 1]], depth[[low, high]]))
            nearest = max(nearest, float(depth.max()))
    slopes, ends, depths = (np.array(column) for column in zip(*sides, strict=True))
    # At offset o and distance d: -slope (d - depth) <= end - o at low ends, end - o <= slope (d - depth) at high.
    lowest, highest = ends[:, 0] - slopes * depths[:, 0], ends[:, 1] + slopes * depths[:, 1]
    distances = (highest - lowest[:, None]) / (slopes + slopes[:, None])
    distance = max(float(distances.max()), nearest + _MIN_DISTANCE)
    least = (highest - slopes * distance).max(axis=0)
    most = (lowest + slopes * distance).min(axis=0)
    offset = (least + most) / 2
    for _ in range(_CENTERINGS):  # what is left free is used to put the points into the middle
        seen = (ends - offset) / (distance - depths)
        offset = np.clip(offset + (seen[:, 0].min(axis=0) + seen[:, 1].max(axis=0)) / 2 * distance, least, most)
    eye = np.array([*offset, distance])
    return [Camera(axes, eye @ axes, _TANGENT, width, height, (0, height)) for axes, _ in views]
