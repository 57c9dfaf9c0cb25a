"""Visibility sums: for every covered texel, the weight of the directions that it sees and of all that it could see.

The method is the source's (a shadow map for each direction, compared in texture space), with one pass for a direction
and its opposite, and the comparison made on the receiver's plane.
"""

import numpy as np

from aoprecalc.gl.context import Renderer
from aoprecalc.model import Doubles, Floats, Scene, Texels
from aoprecalc.occlusion.axes import groups, texel_offset
from aoprecalc.occlusion.near_far import NearFarMaps
from aoprecalc.occlusion.projection import Projections, extreme_points, project
from aoprecalc.occlusion.receivers import Receivers
from aoprecalc.progress import Progress
from aoprecalc.surface.frame import centred
from aoprecalc.surface.normals import geometric_normals
from aoprecalc.texspace.raster import Band, Raster


def visibility_sums(
    renderer: Renderer,
    scene: Scene,
    shading: Floats,
    raster: Raster,
    texels: Texels,
    bands: list[Band],
    axes: Doubles,
    shadow_size: int,
    progress: Progress,
) -> Doubles:
    """Return (k, 2) float64 sums over both directions of every axis.

    The first is of max(0, n.w) [g.w > 0] visible(w), the second is the same without visible(w).

    shading      (f, 3, 3) float32, unit normals at the corners
    axes         (a, 3) unit vectors
    shadow_size  side of a near/far map in texels
    Directions done are counted on `progress`, two an axis.
    """
    positions = centred(scene.positions)
    outline = extreme_points(positions)
    context = renderer.context
    maps = NearFarMaps(context, positions.astype(np.float32), scene.faces, shadow_size)
    receivers = Receivers(
        context, raster, texels, bands,
        positions.astype(np.float32), scene.faces, shading, geometric_normals(scene, shading),
    )  # fmt: skip
    sums = np.zeros((len(texels), 2))
    for number, group in enumerate(groups(len(axes))):
        receivers.place(texel_offset(number))
        projections = project(axes[group], outline, shadow_size)
        for start in range(0, len(projections.rows), maps.capacity):
            batch = slice(start, start + maps.capacity)
            maps.draw(Projections(projections.rows[batch], projections.pitch[batch]))
            count = len(projections.rows[batch])
            receivers.gather(maps, count)
            progress.advance(2 * count)
        sums += receivers.sums()
    return sums
