"""How wide the gutters between charts are, and to which mip level they keep charts apart."""

import math

import numpy as np

from aoprecalc.mesh.topology import boundary_edges
from aoprecalc.types import Float64Array, Int32Array

MIN_GUTTER = 2  # texels: with fewer, bilinear filtering would mix charts at full resolution
_MAX_SHARE = 1.0 / 3.0  # of the atlas
_EFFICIENCY = 0.7  # share of the atlas that packers fill with charts and their gutters


def choose_gutter(area: float, perimeter: float, size: int, padding: int) -> int:
    """Return the gutter in texels: twice the padding, but less where gutters would take over a third of the atlas.

    area, perimeter   of all charts together, in any unit of length, squared for the area
    size              side of the square atlas in texels
    """
    gutter = max(MIN_GUTTER, 2 * padding)
    while gutter > MIN_GUTTER and _gutter_share(area, perimeter, size, gutter) > _MAX_SHARE:
        gutter -= 1
    return gutter


def first_unsafe_mip(gutter: int, padding: int) -> int:
    """Return the first mip level at which filtering may mix charts, or a chart with the fill beyond its padding.

    Level k needs about 1.5 * 2**k texels a side, both of half the gutter and of the padding; one is enough for level 0.
    """
    if padding == 0:
        return 0
    level = 1
    while 1.5 * 2**level <= min(gutter / 2, padding):
        level += 1
    return level


def area_and_perimeter(uvs: Float64Array, corners: Int32Array) -> tuple[float, float]:
    """Return the area and the outline length of all charts, for (f, 3, 2) UVs and (f, 3) vertex indices."""
    lengths = np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2)
    return float(0.5 * doubled_uv_areas(uvs).sum()), float(lengths[boundary_edges(corners)].sum())


def doubled_uv_areas(uvs: Float64Array) -> Float64Array:
    """Return twice the area of each of (f, 3, 2) triangles, (f,)."""
    side, other = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    areas: Float64Array = np.abs(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0])
    return areas


def fitting_scale(area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the factor t by which charts can grow: area t^2 + perimeter gutter t = efficiency size^2.

    Two charts share the gutter between them, but packers nest real outlines so loosely that each takes the whole of it
    (measured: 3,600 small charts lose 0.34 of a page to gutters of 4 texels where half the perimeter predicts 0.18).
    """
    strip = perimeter * gutter / 2
    return (math.sqrt(strip**2 + area * _EFFICIENCY * size**2) - strip) / area


def _gutter_share(area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the share of the atlas that gutters take when the charts are as large as they can be."""
    return fitting_scale(area, perimeter, size, gutter) * perimeter * gutter / size**2
