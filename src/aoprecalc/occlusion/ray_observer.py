"""Visibility by tracing rays: slower than maps, exact, and without OpenGL."""

import numpy as np

from aoprecalc.model import Doubles, Floats
from aoprecalc.progress import Progress
from aoprecalc.rays.occluders import LIFT, Occluders
from aoprecalc.surface.unit import UnitSurface
from aoprecalc.texspace.samples import Samples


class RayObserver:
    """An Observer that casts a ray from every sample along every direction in front of it."""

    def __init__(self, surface: UnitSurface, threads: int = 0) -> None:
        """Build the occluders. Raises RendererError where embreex is not installed."""
        self._surface = surface
        self._occluders = Occluders(surface.occluders, threads)

    def look(self, samples: Samples, axes: Doubles, progress: Progress) -> Floats:
        """Return the visibility sums of the samples, see Observer."""
        there = np.flatnonzero(samples.faces >= 0)
        places, normals, geometric = self._surface.at(samples.faces[there], samples.weights[there])
        origins = (places + LIFT * geometric).astype(np.float32)
        visible, whole = np.zeros(len(there)), np.zeros(len(there))
        for axis in axes:
            g_along, n_along = geometric @ axis, normals @ axis
            for towards in (1.0, -1.0):  # the end of the axis from which light comes
                facing = np.flatnonzero((towards * g_along > 0) & (towards * n_along > 0))
                weights = np.abs(n_along[facing])
                direction = towards * axis
                if self._surface.is_below(direction):
                    hidden = np.ones(len(facing), bool)
                else:
                    hidden = self._occluders.hidden(origins[facing], direction[None].astype(np.float32))
                whole[facing] += weights
                visible[facing] += np.where(hidden, 0, weights)
                progress.advance()
        sums = np.zeros((len(samples.faces), 2), np.float32)
        sums[there] = np.column_stack([visible, whole])
        return sums
