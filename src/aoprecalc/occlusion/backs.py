"""The backs of faces that are shown from both sides."""

import numpy as np

from aoprecalc.model import Doubles, Mask, Scene, Texels
from aoprecalc.occlusion.axes import GROUP
from aoprecalc.occlusion.observer import Observer
from aoprecalc.occlusion.portion import runs
from aoprecalc.progress import Progress
from aoprecalc.texspace.samples import CENTER, TexelSampler

_DARK = 0.03  # maps let through a little at silhouettes


def lit_backs(
    observer: Observer,
    sampler: TexelSampler,
    scene: Scene,
    texels: Texels,
    axes: Doubles,
    most: int,
    progress: Progress,
) -> Mask:
    """Return the two-sided faces whose back may be lighter than their front, (f,) bool.

    observer   of the turned surface

    Left out are faces whose samples are dark, as far as the first group of axes tells: of closed meshes, which many
    exporters call double-sided, all. Their backs would be of account only where their fronts are as dark.
    """
    some, two_sided = axes[:GROUP], scene.two_sided & scene.receives
    seen, lit = np.zeros(len(two_sided), bool), np.zeros(len(two_sided), bool)
    for part in scene.parts:
        if part.shares is not None:
            lit[scene.parts[part.shares].faces] = True  # or another instance's back may be
    for held in runs(len(texels), most):
        samples = sampler.samples(texels.some(held), CENTER)
        sums = observer.look(samples, some, progress)
        there = samples.faces >= 0
        seen[samples.faces[there]] = True
        lit[samples.faces[there & (sums[:, 0] > _DARK * sums[:, 1])]] = True
    return two_sided & (lit | ~seen)
