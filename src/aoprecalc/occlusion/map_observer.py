"""Visibility by near/far maps in OpenGL.

The method is the source's (a shadow map for each direction, compared in texture space), with one pass for a direction
and its opposite, and a comparison of planes instead of depths.
"""

import numpy as np

from aoprecalc.gl.context import Renderer
from aoprecalc.model import Doubles, Floats
from aoprecalc.occlusion.near_far import NearFarMaps
from aoprecalc.occlusion.projection import extreme_points, project
from aoprecalc.occlusion.receivers import Receivers
from aoprecalc.progress import Progress
from aoprecalc.surface.unit import UnitSurface
from aoprecalc.texspace.samples import Samples


class MapObserver:
    """An Observer that draws maps and reads them at the samples; see gather.comp.glsl."""

    def __init__(self, renderer: Renderer, surface: UnitSurface, most: int, shadow_size: int) -> None:
        """Make room for `most` samples at a time and for maps of `shadow_size` texels a side."""
        self._outline = extreme_points(surface.reach.astype(np.float64))
        self._size, self._floor = shadow_size, surface.floor
        self._maps = NearFarMaps(renderer.context, surface.occluders, shadow_size)
        self._receivers = Receivers(renderer.context, surface, most, self._maps)

    def look(self, samples: Samples, axes: Doubles, progress: Progress) -> Floats:
        """Return the visibility sums of the samples, see Observer."""
        self._receivers.place(samples)
        projections = project(axes, self._outline, self._size, self._floor)
        small = self._maps.small(projections)
        for start in range(0, len(axes), self._maps.capacity):
            batch = projections.some(slice(start, start + self._maps.capacity))
            self._maps.draw(batch, small)
            self._receivers.gather()
            progress.advance(2 * len(batch.rows))
        return self._receivers.sums()
