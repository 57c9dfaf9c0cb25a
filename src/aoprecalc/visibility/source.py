"""Where the visibility of texels comes from: what is asked for, and the answers that this process computes itself.

An axis is a pair of opposite light directions, given by one unit vector.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples, keep_faces
from aoprecalc.raster.resolve import ResolvedTexture
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.visibility.backend import VisibilityTester
from aoprecalc.visibility.instances import SharedInstances, mean_over_poses, turns_to_rest
from aoprecalc.visibility.plan import chunks
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide


@dataclass(frozen=True, eq=False)
class TexelRequest:
    """Texels whose visibility is asked for along one group of axes.

    group   of the axes, an index into the groups of the BakeSetup
    rows    which of the side's texels: a slice, or (k,) int32
    """

    group: int
    rows: slice | Int32Array


class VisibilitySource(Protocol):
    """Returns the visibility sums of one side's texels, computed in this process or elsewhere, with equal results."""

    def expect(self, requests: Iterable[TexelRequest]) -> None:
        """Be ready for these requests, which come in this order, unless the gather ends early."""
        ...

    def visibility_sums(self, samples: Samples, request: TexelRequest) -> Float32Array:
        """Return the sums of texels along one group of axes, (k, columns) float32; see VisibilityTester.

        samples   the measured points of these texels, at the texel offset of the group
        """
        ...


class LocalVisibility:
    """Computes visibility in this process, with the backend of the setup."""

    def __init__(
        self, setup: BakeSetup, side: SurfaceSide, shadow_size: int, chunk_size: int, progress: Progress
    ) -> None:
        """Prepare for up to `chunk_size` texels at a time; directions done are counted on `progress`."""
        self._make_tester = partial(
            setup.backend.tester,
            integrand=setup.integrand,
            max_samples=chunk_size,
            shadow_size=shadow_size,
            texels=len(side.texels),
        )
        self._only = self._make_tester(side.surface) if len(side.surfaces) == 1 else None
        self._instances = SharedInstances.from_scene(side.scene, vectors=setup.integrand.vectors)
        self._setup, self._side, self._progress = setup, side, progress
        turned = side.scene.poses and setup.integrand.vectors
        self._turns = turns_to_rest(side.scene, setup.inputs.normals) if turned else None

    def expect(self, requests: Iterable[TexelRequest]) -> None:
        """Do nothing: sums are computed when they are asked for."""

    def visibility_sums(self, samples: Samples, request: TexelRequest) -> Float32Array:
        """Return the sums of texels; see VisibilitySource. Several poses take the memory of one."""
        axes = self._setup.axes[self._setup.groups[request.group]]
        return mean_over_poses(self._sums_in_poses(samples, axes, request.group))

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
