"""The setup of a bake: its texels, its sides and its axes.

An axis is a pair of opposite light directions, given by one unit vector.
"""

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import baked_apart, in_poses
from aoprecalc.options import BakeOptions
from aoprecalc.raster.layout import CENTER, Samples, area_per_texel, build_layout, keep_faces
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene, Texels
from aoprecalc.visibility.backend import Backend
from aoprecalc.visibility.directions import GROUP_SIZE, DirectionPlan, axis_groups, light_axes, texel_offset
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.interleaving import GROUPS
from aoprecalc.visibility.projection import Projection


@dataclass(frozen=True, eq=False)
class BakeInputs:
    """The plain values that determine a bake: every process that has them computes the same texels and sums.

    scene     with the roles of its parts, and its detail if any; its document is not used
    atlas     the UVs of the texture
    normals   (f, 3, 3) float32: the shading normals at the corners
    options   of the bake
    directions   None: those that the options ask for
    """

    scene: Scene
    atlas: Atlas
    normals: Float32Array
    options: BakeOptions
    directions: DirectionPlan | None = None


@dataclass(frozen=True, eq=False)
class SurfaceSide:
    """One side of the surface, front or back, in one pass.

    scene     whose surface is measured, with the roles that its parts have on this side
    surfaces  in each pose in which light is measured, flipped so that this side is the front
    texels    those that have a value on this side
    faces     (f,) bool: samples on other faces do not count; None: all count
    """

    scene: Scene
    surfaces: tuple[NormalizedSurface, ...]
    texels: Texels
    faces: BoolArray | None

    @property
    def surface(self) -> NormalizedSurface:
        """The surface in the first pose."""
        return self.surfaces[0]


class BakeSetup:
    """The inputs of a bake, ready to run on a backend.

    directions   how many there are
    interleaved   neighbouring texels take different groups, see `interleaving`
    axes     (a, 3) float64 unit vectors
    groups   slices of the axes, in the order in which their sums are added
    integrand   what each direction counts for
    texels   all that the surface covers
    sides    the front, and the back where some faces are two-sided, in each pass: see `baked_apart`
    """

    def __init__(self, backend: Backend, inputs: BakeInputs) -> None:
        """Rasterize the atlas to find the texels."""
        self.backend, self.inputs = backend, inputs
        scene, options = inputs.scene, inputs.options
        self._rasterizer = backend.rasterizer(build_layout(scene, inputs.atlas, options.width, options.height))
        detail = detail_of(scene)
        self._projection = None if detail is None else Projection(scene, detail, options.threads)
        self._take_directions(inputs.directions or DirectionPlan.from_options(options))
        self.texels = self._rasterizer.coverage()
        passes = baked_apart(scene if detail is None else detail.scene)
        self.sides = [side for baked in passes for side in self._sides(baked, whole=len(passes) == 1)]

    def with_directions(self, directions: DirectionPlan) -> Self:
        """Return a setup with other directions, which shares all else with this one."""
        other = copy(self)
        other.inputs = replace(self.inputs, directions=directions)
        other._take_directions(directions)
        return other

    def _take_directions(self, directions: DirectionPlan) -> None:
        options = self.inputs.options
        self.directions = directions
        self.interleaved = directions.interleaved and self.backend.kind == "ray"
        size = math.ceil((directions.count + 1) // 2 / GROUPS) if self.interleaved else GROUP_SIZE
        self.axes: Float64Array = light_axes(directions.count, options.sampling, options.seed, size)
        self.groups = axis_groups(len(self.axes), size)
        integrand = replace(Integrand.from_options(options, self.inputs.scene), vectors=options.bent_normals)
        self.integrand = integrand.for_directions(np.concatenate([self.axes, -self.axes]))

    def _sides(self, scene: Scene, *, whole: bool) -> Iterator[SurfaceSide]:
        """Yield the front and, where some faces are two-sided, the back of a scene in a pass, perhaps the only one."""
        detail = detail_of(self.inputs.scene)
        normals = self.inputs.normals if detail is None else detail.normals
        poses, receives = in_poses(scene, normals), scene.receives
        surfaces = tuple(NormalizedSurface.from_scene(pose, shading) for pose, shading in poses)
        two_sided = scene.two_sided & receives
        yield SurfaceSide(scene, surfaces, self.texels, None) if whole else self._side(scene, surfaces, receives)
        if two_sided.any() and len(self.texels):
            yield self._side(scene, tuple(surface.flipped() for surface in surfaces), two_sided)

    def _side(self, scene: Scene, surfaces: tuple[NormalizedSurface, ...], faces: BoolArray) -> SurfaceSide:
        """Return a side of which only the faces in a mask, (f,) bool, have texels."""
        face = self.projected(self.center_samples(self.texels)).faces
        return SurfaceSide(scene, surfaces, self.texels.select((face < 0) | faces[face]), faces)

    def textured(self, side: SurfaceSide) -> Scene:
        """Return the scene that the texture is of; its own surface is measured unless it has a detail."""
        return side.scene if self._projection is None else self.inputs.scene

    def area_per_texel(self, texels: Texels) -> Float64Array:
        """Return the surface area of a texel on each face, (f,), in the mean of all poses; see `layout`."""
        inputs = self.inputs
        areas = [area_per_texel(pose, inputs.atlas, texels) for pose, _ in in_poses(inputs.scene, inputs.normals)]
        return np.asarray(np.mean(areas, axis=0), np.float64)

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        return self._rasterizer.overlap()

    def center_samples(self, texels: Texels) -> Samples:
        """Return the surface samples at the centres of any of the covered texels."""
        return self._rasterizer.samples(texels, CENTER)

    def directions_of(self, group: int) -> int:
        """Return the number of light directions of a group of axes."""
        return 2 * len(self.axes[self.groups[group]])

    def samples(self, side: SurfaceSide, rows: slice | Int32Array, group: int) -> Samples:
        """Return the points measured for some of a side's texels, at the texel offset of a group of axes."""
        return self.measured(side, self.texel_samples(side, rows, group))

    def texel_samples(self, side: SurfaceSide, rows: slice | Int32Array, group: int) -> Samples:
        """Return the points of the textured mesh for some of a side's texels, at the offset of a group of axes."""
        return self._rasterizer.samples(side.texels.select(rows), texel_offset(group))

    def measured(self, side: SurfaceSide, samples: Samples) -> Samples:
        """Return the points of a side that are measured for samples of the textured mesh: itself, or its detail."""
        samples = self.projected(samples)
        return samples if side.faces is None else keep_faces(samples, side.faces)

    def projected(self, samples: Samples) -> Samples:
        """Return the points of the measured surface, whatever its side, for samples of the textured mesh."""
        return samples if self._projection is None else self._projection.samples(samples)
