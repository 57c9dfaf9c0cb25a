"""Packing: charts made by any means are arranged in one square page, with gutters between them."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from aoprecalc.mesh.topology import boundary_edges
from aoprecalc.subprocesses import report_step
from aoprecalc.types import Float64Array, Int32Array
from aoprecalc.uv.charts import Charts, Unwrapper, doubled_uv_areas, new_xatlas, run_uvunwrap

MIN_GUTTER = 2  # texels: with fewer, bilinear filtering would mix charts at full resolution
_MAX_SHARE = 1.0 / 3.0  # of the atlas
_EFFICIENCY = 0.7  # share of the atlas that packers fill with charts and their gutters

# xatlas: search for the greatest scale at which the charts fit one page.
_MAX_PACKINGS = 12
_SCALE_STEP = 1.08  # between the first two tries; squared after each that is too large
_CLOSE = 1.005  # ratio of the smallest scale that is too large to the greatest that fits, at which the search ends
# It leaves out triangles below FLT_EPSILON square texels; it is given charts this much larger, to be scaled by itself.
_ENLARGED = 2.0**10

# uvunwrap: lower the density until its own packer needs one page only.
_MANY_CHARTS = 1500  # above this its fast packer: the better one would take longer than the bake
_MAX_DENSITIES = 8
_DENSITY_STEP = 0.85  # of the density that needed more pages

_MIN_WIDTH = 2.0**-7  # of a chart's length, for packers

_Places = tuple[float, Int32Array, Float64Array]  # texels per unit of length, vertices, their positions in texels


class NoRoomError(ValueError):
    """The charts do not fit the page with gutters of that width, at any scale."""


@dataclass(frozen=True, eq=False)
class Packed:
    """Charts in their places.

    uvs     (f, 3, 2) float64 in [0, 1]; (0, 0) for faces in no chart
    gutter  texels between two charts, at least; half of it is free at the sides of the page
    """

    uvs: Float64Array
    gutter: int


def pack_charts(charts: Charts, size: int, padding: int, packer: Unwrapper) -> Packed:
    """Pack charts into exactly one page of size x size texels, all at one scale; they are turned, and may be mirrored.

    padding   texels around each chart that should stay free; see `choose_gutter` for charts without room for that
    Raises ValueError where they do not fit.
    """
    flat, chart, corners = charts.vertices()
    outlines = charts.count, *area_and_perimeter(flat[corners], corners)
    gutter, wide = choose_gutter(*outlines, size, padding), _widen(flat, chart)
    while True:
        scale = fitting_scale(*outlines, size, gutter)
        try:
            scale, placed, positions = _PACKERS[packer](wide, chart, corners, scale, size, gutter)
            break
        except NoRoomError:
            if gutter == MIN_GUTTER:
                raise
            gutter = max(MIN_GUTTER, gutter // 2)
    places = _move(flat * scale, wide * scale, chart, placed, positions)
    uvs: Float64Array = np.zeros_like(charts.uvs)
    uvs[charts.placed] = places[corners] / size
    return Packed(uvs, gutter)


def _widen(flat: Float64Array, chart: Int32Array) -> Float64Array:
    """Return vertices, (v, 2), with thin charts made wider, as packers leave out what is too thin for them.

    Those less than _MIN_WIDTH of their length wide are stretched across it.
    """
    count = int(chart.max()) + 1
    number = np.bincount(chart, minlength=count)
    means = _sums(flat, chart, count) / number[:, None]
    local = flat - means[chart]
    moments = _sums((local[:, :, None] * local[:, None, :]).reshape(-1, 4), chart, count).reshape(-1, 2, 2)
    axes = np.linalg.eigh(moments)[1]  # columns: across, along
    local = np.einsum("vx,vxa->va", local, axes[chart])
    reach: Float64Array = np.zeros((count, 2))
    np.maximum.at(reach, chart, np.abs(local))
    across, along = np.maximum(reach, np.finfo(float).tiny).T
    local[:, 0] *= np.maximum(_MIN_WIDTH * along / across, 1.0)[chart]
    widened: Float64Array = np.einsum("va,vxa->vx", local, axes[chart]) + means[chart]
    return widened


def _sums(values: Float64Array, chart: Int32Array, count: int) -> Float64Array:
    """Sum the rows of (v, c) values over each chart, (count, c)."""
    return np.stack([np.bincount(chart, column, count) for column in values.T], axis=1)


def _pack_with_xatlas(
    flat: Float64Array, chart: Int32Array, corners: Int32Array, scale: float, size: int, gutter: int
) -> _Places:
    """Pack flat vertices, (v, 2), at about the greatest scale that fits one page.

    chart    (v,) the chart of each vertex
    corners  (p, 3) the vertices of each face
    scale    texels per unit of length to try first
    """
    import xatlas

    border = gutter // 2  # kept free at the sides of the page, as textures repeat
    given = (flat * (scale * _ENLARGED)).astype(np.float32), corners.astype(np.uint32)
    options = xatlas.PackOptions()
    options.resolution = size - 2 * border
    options.padding, options.bilinear = gutter, False
    fits, too_large, relative, step = 0.0, np.inf, 1.0, _SCALE_STEP
    best = None
    for attempt in range(1, _MAX_PACKINGS + 1):
        report_step(f"packing, try {attempt} of at most {_MAX_PACKINGS}")
        options.texels_per_unit = relative / _ENLARGED
        page = new_xatlas()
        page.add_uv_mesh(*given, chart[corners[:, :1]].astype(np.uint32))
        page.generate(pack_options=options)
        mapping, _, uvs = page.get_mesh(0)
        found = mapping, uvs.astype(np.float64) * (page.width, page.height) + border
        large = flat * (scale * relative)
        moved = _move(large, large, chart, *found)  # a chart that is larger than the page was shrunk
        inside = moved.min() >= border - 1 and moved.max() <= size - border + 1
        if page.atlas_count == 1 and max(page.width, page.height) <= size - 2 * border and inside:
            fits, best = relative, found
        else:
            too_large = relative
            step = step if fits else step * step
        if too_large < fits * _CLOSE:
            break
        relative = too_large / step if not fits else fits * step if np.isinf(too_large) else (fits + too_large) / 2
    if best is None:
        raise NoRoomError(
            f"its charts did not fit {size} x {size} texels with gutters of {gutter}; use a larger --size"
        )
    return scale * fits, *best


def _pack_with_uvunwrap(
    flat: Float64Array, chart: Int32Array, corners: Int32Array, scale: float, size: int, gutter: int
) -> _Places:
    """Do as `_pack_with_xatlas` does."""
    import uvunwrap

    packing: Literal["shape", "fast"] = "fast" if int(chart.max()) >= _MANY_CHARTS else "shape"
    # Charts that exist are scaled so that their area is that of their faces: those of flat surfaces keep theirs. One
    # lies above the other, as edges in the same place would be joined.
    unit = float(np.ptp(flat, axis=0).max())
    surface = np.column_stack([flat / unit, chart / (chart.max() + 1)])
    mesh = uvunwrap.Mesh(
        surface.astype(np.float32),
        corners.astype(np.uint32),
        face_materials=chart[corners[:, 0]].astype(np.uint32),
        existing_uvs=(flat / unit).astype(np.float32),
    )
    density = None
    for _ in range(_MAX_DENSITIES):
        atlas = run_uvunwrap(mesh, page_size=size, padding=gutter, packing=packing, texels_per_unit=density)
        if atlas.page_count == 1:
            break
        density = _DENSITY_STEP * atlas.texels_per_unit
    else:
        raise NoRoomError(f"its charts need {atlas.page_count} pages of {size} x {size} texels; use a larger --size")
    page = atlas.meshes[0]
    uvs = np.array(page.uv, np.float64).reshape(-1, 2) * (atlas.width, atlas.height)
    used = np.array(page.page) == 0
    return atlas.texels_per_unit / unit, np.array(page.xref)[used], uvs[used]


def _move(
    flat: Float64Array, wide: Float64Array, chart: Int32Array, placed: Int32Array, positions: Float64Array
) -> Float64Array:
    """Return (v, 2) positions of all vertices, each chart turned or mirrored to where the packer put it.

    flat, wide   (v, 2) in texels: as they are, and as the packer had them; chart: (v,) their charts
    placed       (p,) the vertices that the packer placed, and where: positions (p, 2)
    xatlas stretches charts to whole texels, which makes thin ones much wider, and leaves out vertices of faces without
    area. So only the nearest rotation or mirroring (Procrustes) is used, about the mean of the vertices.
    """
    count = int(chart.max()) + 1
    of_placed = chart[placed]
    number = np.maximum(np.bincount(of_placed, minlength=count), 1)[:, None]
    before, after = (_sums(points, of_placed, count) / number for points in (wide[placed], positions))
    source, target = wide[placed] - before[of_placed], positions - after[of_placed]
    products = _sums((source[:, :, None] * target[:, None, :]).reshape(-1, 4), of_placed, count)
    left, _, right = np.linalg.svd(products.reshape(-1, 2, 2))
    moved: Float64Array = np.einsum("vx,vxy->vy", flat - before[chart], (left @ right)[chart]) + after[chart]
    return moved


_PACKERS = {"xatlas": _pack_with_xatlas, "uvunwrap": _pack_with_uvunwrap}


# Gutters: how wide they are, and to which mip level they keep charts apart.


def choose_gutter(charts: int, area: float, perimeter: float, size: int, padding: int) -> int:
    """Return the gutter in texels: twice the padding, but less where gutters would take over a third of the atlas.

    charts            how many there are
    area, perimeter   of all charts together, in any unit of length, squared for the area
    size              side of the square atlas in texels
    """
    gutter = max(MIN_GUTTER, 2 * padding)
    while gutter > MIN_GUTTER and _gutter_share(charts, area, perimeter, size, gutter) > _MAX_SHARE:
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


def fitting_scale(charts: int, area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the factor t by which charts can grow: area t^2 + perimeter gutter t + corners = efficiency size^2.

    Two charts share the gutter between them, but packers nest real outlines so loosely that each takes the whole of it
    (measured: 3,600 small charts lose 0.34 of a page to gutters of 4 texels where half the perimeter predicts 0.18).
    The corners of a chart take a square of the gutter's width; where they alone take the page, t fits half of it.
    """
    strip, room = perimeter * gutter / 2, max(_EFFICIENCY * size**2 - charts * gutter**2, _EFFICIENCY * size**2 / 2)
    return (math.sqrt(strip**2 + area * room) - strip) / area


def _gutter_share(charts: int, area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the share of the atlas that gutters take when the charts are as large as they can be."""
    strips = fitting_scale(charts, area, perimeter, size, gutter) * perimeter * gutter
    return (strips + charts * gutter**2) / size**2
