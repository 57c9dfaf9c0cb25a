"""Ambient occlusion from visibility sums."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aoprecalc.options import Estimator, Sampling
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import area_per_texel, texel_positions
from aoprecalc.raster.least_squares import LeastSquaresImage
from aoprecalc.raster.samples import Samples
from aoprecalc.types import BoolArray, Float32Array, Texels
from aoprecalc.visibility.directions import texel_offset
from aoprecalc.visibility.setup import FIT_CHUNK, BakeSetup, SurfaceSide, chunks
from aoprecalc.visibility.shared_instances import SharedInstances


def estimate(sums: Float32Array, directions: int, estimator: Estimator) -> tuple[Float32Array, BoolArray]:
    """Return the values of texels, (k,) float32 >= 0, and which of them were measured at all, (k,) bool.

    sums   (k, 2): the weight of visible directions, and of all in front of the surface
    ratio  their quotient: self-normalised, exactly 1 on an open point
    mean   4/N times the first (equation 1.1.1.1 by uniform directions), which sampling can make greater than 1
    """
    visible, whole = sums[:, 0], sums[:, 1]
    measured = whole > 0
    if estimator == "mean":
        return visible * np.float32(4.0 / directions), measured
    return np.divide(visible, whole, out=np.zeros_like(visible), where=measured), measured


def sampling_error(
    halves: Float32Array, directions: list[int], estimator: Estimator, sampling: Sampling
) -> float | None:
    """Return the error to expect of the two halves together, RMS over the texels that both measured; None without any.

    halves       (2, k, 2): visibility sums of the halves
    directions   how many each has used
    Let p and q be the halves' shares of the directions. If they erred independently their difference would be
    1 / sqrt(pq) times the error of the whole. But the halves of an even set complete each other: its error falls as
    N^-3/4, which makes the difference greater by sqrt(p^-1/2 + q^-1/2 - 1), 1.35 for equal halves. Random directions
    have no such bond.
    """
    if not all(directions):
        return None
    (first, in_first), (second, in_second) = (
        estimate(sums, count, estimator) for sums, count in zip(halves, directions, strict=True)
    )
    both = in_first & in_second
    if not both.any():
        return None
    difference = np.sqrt(((first[both] - second[both]) ** 2).mean(dtype=np.float64))
    p, q = np.divide(directions, sum(directions))
    bond = 1.0 if sampling == "random" else p**-0.5 + q**-0.5 - 1.0
    return float(difference * np.sqrt(p * q / bond))


# What tells how much the texels of a side see along one group of axes after the other.


class VisibilitySource(Protocol):
    """Tells visibility sums; whoever tells them, they are the same."""

    def visibility_sums(self, samples: Samples, held: slice, group: int) -> Float32Array:
        """Return what a run of the side's texels sees along a group of axes, (k, 2) float32; see VisibilityTester.

        samples   of the texels `held`, at the spot of the group
        Groups come in order, and for each the runs in order.
        """
        ...


class LocalVisibility:
    """Looks by itself, with the observer of the site's backend."""

    def __init__(self, site: BakeSetup, side: SurfaceSide, shadow_size: int, most: int, progress: Progress) -> None:
        """Make an observer of up to `most` texels at a time; directions done are counted on `progress`."""
        self._tester = site.backend.tester(side.surface, most, shadow_size)
        self._instances = SharedInstances.from_scene(site.inputs.scene)
        self._site, self._progress = site, progress

    def visibility_sums(self, samples: Samples, held: slice, group: int) -> Float32Array:
        """See Sight."""
        axes = self._site.axes[self._site.groups[group]]
        return self._instances.accumulate(self._tester, samples, axes, group, self._progress)


VisibilityFactory = Callable[[BakeSetup, SurfaceSide, int, int, Progress], VisibilitySource]  # see LocalVisibility


# From samples to the ambient occlusion of texels: the visibility of one group of axes after the other, summed.


@dataclass(frozen=True, eq=False)
class TexelOcclusion:
    """What texels see.

    texels           k of them
    values           (k,) float32 in [0, 1]: the mean over the part of each texel that the surface covers
    measured         (k,) bool: texels that have a value
    reconstruction   holds every sample's value at its place, for the picture of darkness (1 - value) that fits best
    directions       how many were used
    error            the estimated sampling error of `values`, RMS; None where one group of axes was used
    """

    texels: Texels
    values: Float32Array
    measured: BoolArray
    reconstruction: LeastSquaresImage
    directions: int
    error: float | None


def gather(site: BakeSetup, side: SurfaceSide, sight: VisibilitySource, most: int) -> TexelOcclusion:
    """Gather what a side's texels see along all axes, or fewer where the bake's `target_error` is reached before.

    Every group of axes samples the texels at a spot of its own. Even and odd groups are summed apart, as their
    difference tells the error. At most `most` texels are looked at at a time.
    """
    scene, atlas, options, texels = site.inputs.scene, site.inputs.atlas, site.inputs.options, side.texels
    reconstruction = LeastSquaresImage(texels.width, texels.height, repeats=atlas.repeats)
    stands_for = area_per_texel(scene, atlas, texels)
    halves = np.zeros((2, len(texels), 2), np.float32)
    used = [0, 0]  # directions of each half
    error = None
    for number, group in enumerate(site.groups):
        count = 2 * (group.stop - group.start)
        for held in chunks(len(texels), most):
            samples = site.samples(side, held, number)
            sums = sight.visibility_sums(samples, held, number)
            halves[number % 2, held] += sums
            for start in range(0, len(sums), FIT_CHUNK):
                part = slice(start, start + FIT_CHUNK)
                some = Samples(samples.faces[part], samples.weights[part])
                values, measured = estimate(sums[part], count, options.estimator)
                counts_for = sums[part, 1] if options.estimator == "ratio" else count  # as in the sum of all groups
                weights = np.where(measured, counts_for * stands_for[some.faces], 0.0)
                reconstruction.add_samples(
                    texel_positions(atlas, texels, some), 1.0 - values, weights, texel_offset(number)
                )
        used[number % 2] += count
        if number % 2 or group is site.groups[-1]:
            error = sampling_error(halves, used, options.estimator, options.sampling)
        if error is not None and options.target_error is not None and error <= options.target_error:
            break
    values, measured = estimate(halves.sum(axis=0), sum(used), options.estimator)
    return TexelOcclusion(texels, np.clip(values, 0.0, 1.0), measured, reconstruction, sum(used), error)
