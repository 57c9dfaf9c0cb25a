"""Ambient occlusion of texels: visibility sums of one group of axes after the other, and the image fitted to them.

An axis is a pair of opposite light directions, given by one unit vector.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from aoprecalc.mesh.roles import in_poses
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples, area_per_texel, keep_faces, texel_positions
from aoprecalc.raster.resolve import LeastSquaresImage, ResolvedTexture
from aoprecalc.types import (
    BoolArray,
    Float32Array,
    Float64Array,
    Texels,
)
from aoprecalc.visibility.backend import VisibilityTester
from aoprecalc.visibility.directions import texel_offset
from aoprecalc.visibility.instances import SharedInstances, mean_over_poses, turns_to_rest
from aoprecalc.visibility.integrand import sampling_error
from aoprecalc.visibility.plan import FIT_CHUNK, chunks
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide


class VisibilitySource(Protocol):
    """Returns the visibility sums of one side's texels, computed in this process or elsewhere, with equal results."""

    def visibility_sums(self, samples: Samples, chunk: slice, group: int) -> Float32Array:
        """Return the sums of a chunk of the side's texels along one group of axes, (k, columns) float32.

        samples   of the texels in `chunk`, at the texel offset of the group
        Called for the groups in order, and for each group for the chunks in order. See VisibilityTester.
        """
        ...


class LocalVisibility:
    """Computes visibility in this process, with the backend of the setup."""

    def __init__(
        self, setup: BakeSetup, side: SurfaceSide, shadow_size: int, chunk_size: int, progress: Progress
    ) -> None:
        """Prepare for up to `chunk_size` texels at a time; directions done are counted on `progress`."""
        self._make_tester = partial(
            setup.backend.tester, integrand=setup.integrand, max_samples=chunk_size, shadow_size=shadow_size
        )
        self._only = self._make_tester(side.surface) if len(side.surfaces) == 1 else None
        self._instances = SharedInstances.from_scene(side.scene, vectors=setup.integrand.vectors)
        self._setup, self._side, self._progress = setup, side, progress
        turned = side.scene.poses and setup.integrand.vectors
        self._turns = turns_to_rest(side.scene, setup.inputs.normals) if turned else None

    def visibility_sums(self, samples: Samples, chunk: slice, group: int) -> Float32Array:
        """Return the sums of a chunk of texels; see VisibilitySource. Several poses take the memory of one."""
        axes = self._setup.axes[self._setup.groups[group]]
        return mean_over_poses(self._sums_in_poses(samples, axes, group))

    def _sums_in_poses(self, samples: Samples, axes: Float64Array, group: int) -> Iterator[Float32Array]:
        """Yield the sums in each pose, their vectors turned to the rest pose."""
        for pose, surface in enumerate(self._side.surfaces):
            tester = self._only or self._make_tester(surface)
            if self._turns is not None:
                tester = _TurnedTester(tester, self._turns[pose])
            sums = self._instances.accumulate(tester, samples, axes, group, self._progress)
            del tester  # before the next one is made
            yield sums


@dataclass(frozen=True, eq=False)
class _TurnedTester:
    """A VisibilityTester in a pose, whose vectors are turned to the rest pose with the faces.

    turns   (f, 3, 3) float32: see `turns_to_rest`
    """

    tester: VisibilityTester
    turns: Float32Array

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the sums of the samples, see VisibilityTester."""
        sums = self.tester.accumulate(samples, axes, progress)
        sums[:, 2:] = np.einsum("kx,kxy->ky", sums[:, 2:], self.turns[samples.faces])
        return sums


def gather_one_direction(
    setup: BakeSetup, side: SurfaceSide, tester: VisibilityTester, direction: Float64Array, chunk_size: int
) -> ResolvedTexture:
    """Return the integrand of Précalcul's equation 1.1.1.1 for one direction w: max(0, n.w) [g.w > 0] visible(w).

    direction   (3,) float64, the unit vector w towards the light

    A tester adds up both directions of an axis. A point faces one of them, so only samples on faces that face w are
    tested; the others are in their own shadow, 0. Each texel has one sample, at its centre where the surface covers
    that. Of instances that share texels the first one counts.
    """
    texels = side.texels
    faces_light = side.surface.geometric_normals @ direction > 0
    values: Float32Array = np.zeros((texels.height, texels.width), np.float32)
    valid: BoolArray = np.zeros(values.shape, bool)
    for chunk in chunks(len(texels), chunk_size):
        samples, index = setup.samples(side, chunk, 0), texels.index[chunk]
        sums = tester.accumulate(keep_faces(samples, faces_light), direction[None], Progress())
        values.ravel()[index], valid.ravel()[index] = sums[:, 0], samples.faces >= 0
    return ResolvedTexture(values, valid, valid)


VisibilityFactory = Callable[[BakeSetup, SurfaceSide, int, int, Progress], VisibilitySource]  # see LocalVisibility


@dataclass(frozen=True, eq=False)
class TexelOcclusion:
    """The ambient occlusion of one side's texels.

    texels           k of them
    values           (k,) float32 in [0, 1]: the mean over the part of each texel that the surface covers
    measured         (k,) bool: texels that have a value
    reconstruction   every sample at its position in the texture, as occlusion (1 - AO value) and, where it is wanted,
                     visibility vector, to fit an image to
    directions       number of light directions used
    error            the estimated sampling error of `values`, RMS; None where one group of axes was used
    vectors          (k, 3) float32: the mean visibility vectors; None where they are not wanted
    """

    texels: Texels
    values: Float32Array
    measured: BoolArray
    reconstruction: LeastSquaresImage
    directions: int
    error: float | None
    vectors: Float32Array | None


def gather(setup: BakeSetup, side: SurfaceSide, source: VisibilitySource, chunk_size: int) -> TexelOcclusion:
    """Sum the visibility of a side's texels over all axes (Précalcul, sections 1.1.2 and 1.1.3).

    Stops after fewer axes where the bake's `target_error` is reached. Each group of axes samples the texels at an
    offset of its own. Even and odd groups are summed separately: their difference tells the error. At most
    `chunk_size` texels are processed at a time.
    """
    scene, atlas, options, texels = setup.inputs.scene, setup.inputs.atlas, setup.inputs.options, side.texels
    normals = setup.inputs.normals
    integrand = setup.integrand
    channels = integrand.columns - 1
    reconstruction = LeastSquaresImage(texels.width, texels.height, repeats=atlas.repeats, channels=channels)
    face_areas = np.mean([area_per_texel(pose, atlas, texels) for pose, _ in in_poses(scene, normals)], axis=0)
    halves = np.zeros((2, len(texels), integrand.columns), np.float32)
    used = [0, 0]  # directions of each half
    error = None
    for number, group in enumerate(setup.groups):
        count = 2 * (group.stop - group.start)
        for chunk in chunks(len(texels), chunk_size):
            samples = setup.texel_samples(side, chunk, number)
            sums = source.visibility_sums(setup.measured(side, samples), chunk, number)
            halves[number % 2, chunk] += sums
            for start in range(0, len(sums), FIT_CHUNK):
                rows = slice(start, start + FIT_CHUNK)
                part = Samples(samples.faces[rows], samples.weights[rows])
                values, measured = integrand.estimates(sums[rows], count)
                values[:, 0] = 1.0 - values[:, 0]
                # Weight each group as the estimator weights it in the total.
                total = sums[rows, 1] if integrand.estimator == "ratio" else count
                weights = np.where(measured, total * face_areas[part.faces], 0.0)
                positions = texel_positions(atlas, texels, part)
                reconstruction.add_samples(positions, values, weights, texel_offset(number))
        used[number % 2] += count
        if number % 2 or group is setup.groups[-1]:
            error = sampling_error(halves, used, integrand, options.sampling)
        if error is not None and options.target_error is not None and error <= options.target_error:
            break
    halves[0] += halves[1]
    found, measured = integrand.estimates(halves[0], sum(used))
    values, vectors = np.clip(found[:, 0], 0.0, 1.0), found[:, 1:] if integrand.vectors else None
    return TexelOcclusion(texels, values, measured, reconstruction, sum(used), error, vectors)
