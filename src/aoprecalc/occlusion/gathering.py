"""From samples to the ambient occlusion of texels: the visibility of one group of axes after the other, summed."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.model import Floats, Mask, Texels
from aoprecalc.occlusion.axes import texel_offset
from aoprecalc.occlusion.estimate import estimate, sampling_error
from aoprecalc.occlusion.portion import PART, runs
from aoprecalc.occlusion.sight import Sight
from aoprecalc.occlusion.site import Side, Site
from aoprecalc.texspace.places import places, surface_of_texel
from aoprecalc.texspace.reconstruct import Reconstruction
from aoprecalc.texspace.samples import Samples


@dataclass(frozen=True, eq=False)
class Gathered:
    """What texels see.

    texels           k of them
    values           (k,) float32 in [0, 1]: the mean over the part of each texel that the surface covers
    measured         (k,) bool: texels that have a value
    reconstruction   holds every sample's value at its place, for the picture of darkness (1 - value) that fits best
    directions       how many were used
    error            the estimated sampling error of `values`, RMS; None where one group of axes was used
    """

    texels: Texels
    values: Floats
    measured: Mask
    reconstruction: Reconstruction
    directions: int
    error: float | None


def gather(site: Site, side: Side, sight: Sight, most: int) -> Gathered:
    """Gather what a side's texels see along all axes, or fewer where the bake's `target_error` is reached before.

    Every group of axes samples the texels at a spot of its own. Even and odd groups are summed apart, as their
    difference tells the error. At most `most` texels are looked at at a time.
    """
    scene, atlas, options, texels = site.subject.scene, site.subject.atlas, site.subject.options, side.texels
    reconstruction = Reconstruction(texels.width, texels.height, wraps=atlas.wraps)
    stands_for = surface_of_texel(scene, atlas, texels)
    halves = np.zeros((2, len(texels), 2), np.float32)
    used = [0, 0]  # directions of each half
    error = None
    for number, group in enumerate(site.groups):
        count = 2 * (group.stop - group.start)
        for held in runs(len(texels), most):
            samples = site.samples(side, held, number)
            sums = sight.sums(samples, held, number)
            halves[number % 2, held] += sums
            for start in range(0, len(sums), PART):
                part = slice(start, start + PART)
                some = Samples(samples.faces[part], samples.weights[part])
                values, measured = estimate(sums[part], count, options.estimator)
                counts_for = sums[part, 1] if options.estimator == "ratio" else count  # as in the sum of all groups
                weights = np.where(measured, counts_for * stands_for[some.faces], 0.0)
                reconstruction.add(places(atlas, texels, some), 1.0 - values, weights, texel_offset(number))
        used[number % 2] += count
        if number % 2 or group is site.groups[-1]:
            error = sampling_error(halves, used, options.estimator, options.sampling)
        if error is not None and options.target_error is not None and error <= options.target_error:
            break
    values, measured = estimate(halves.sum(axis=0), sum(used), options.estimator)
    return Gathered(texels, np.clip(values, 0.0, 1.0), measured, reconstruction, sum(used), error)
