"""Packing: charts made by any means are arranged in one square page, with gutters between them.

The greatest scale is looked for at which all charts, as images of the texels that they touch, find places (`page.py`).
"""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from aoprecalc.errors import counted
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.types import Float64Array, Int32Array
from aoprecalc.uv.chart_images import ChartBorders, chart_masks, in_least_boxes
from aoprecalc.uv.charts import Charts
from aoprecalc.uv.page import IntArray, Page, Tick, reach_of_gutter

MIN_GUTTER = 2  # texels: with fewer, bilinear filtering would mix charts at full resolution
MAX_SHARE = 0.12  # of the page for gutters

_MAX_CELLS = 1024  # a side of the page; larger textures have cells of several texels
# By how many texels a chart may reach into one without covering it: half of `INSET` in raster/layout.py, as positions
# are rounded after packing.
_INSET = 1.0 / 1024.0

# Search for the greatest scale.
_FILL = 0.82  # of the page with charts and their gutters, until the first try tells it
_QUICK_FILL = 0.7
_TARGET_HEIGHT = 0.987  # of the page's height: what the next try should reach
_ACCEPTED_HEIGHT = 0.975  # of the page's height: what ends the search
_ACCEPTED_RATIO = 1.006  # of the smallest scale that is too large to the greatest that fits: what ends it too
_MAX_TRIES = 5  # once one fits
_SMALLEST_STEP = 0.75  # after a scale that is far too large
_PAGE_HEIGHT = 1.5  # height of the page that tries may use, in sides


@dataclass(frozen=True, eq=False)
class Packed:
    """Charts in their places.

    uvs      (f, 3, 2) float64 in [0, 1]; (0, 0) for faces in no chart
    gutter   texels between two charts, at least; half of it is free at the sides of the page
    density  texels per unit of length
    """

    uvs: Float64Array
    gutter: int
    density: float


class NoRoomError(ValueError):
    """The charts do not fit the page."""


def pack_charts(
    charts: Charts,
    size: int,
    padding: int,
    density: float | None = None,
    *,
    quick: bool = False,
    tick: Tick | None = None,
) -> Packed:
    """Pack charts into exactly one page of size x size texels, all at one scale, turned at will.

    padding  texels around each chart that should stay free; see `choose_gutter` for charts without room for that
    density  texels per unit of length; None: about as many as the page has room for
    quick    take the first scale that fits
    tick     is called often; may raise to stop
    Any two texels that two charts cover are more than the gutter apart, along a diagonal too.
    Raises NoRoomError where they do not fit.
    """
    chart = charts.chart[charts.placed]
    borders = ChartBorders.of(charts.uvs[charts.placed], chart)
    flat = in_least_boxes(charts.uvs[charts.placed], chart, borders)
    outlines = Outlines.of(flat, chart, size, borders)
    gutter = choose_gutter(outlines, size, padding, density)
    while True:
        cell, border = -(-size // _MAX_CELLS), -(-gutter // 2)  # free at the sides of the page, as textures repeat
        cells = (size - 2 * border) // cell
        packing = _Packing(flat, chart, borders, cells, reach_of_gutter(gutter, cell), _INSET / cell, tick)
        if density is None:
            layout = packing.at_greatest_scale(outlines, gutter / cell, quick=quick)
        else:
            layout = packing.at_scale(density / cell) if packing.may_fit(density / cell) else None
        if layout is not None and layout.height <= cells:
            break
        if gutter == MIN_GUTTER:
            raise NoRoomError(
                f"{counted(charts.count, 'chart')} with gutters of {gutter} texels do not fit {size} x {size} texels"
            )
        gutter = max(MIN_GUTTER, gutter // 2)
    uvs: Float64Array = np.zeros_like(charts.uvs)
    uvs[charts.placed] = (_moved(flat * layout.scale, chart, layout) * cell + border) / size
    return Packed(uvs, gutter, layout.scale * cell)


# Gutters: how wide they are, and to which mip level they keep charts apart.


@dataclass(frozen=True)
class Outlines:
    """What charts need of a page: at t cells per unit, and gutters of g cells, `covered` t^2 + `length` t g / 2 cells.

    covered  the area of the cells that charts touch, in squared units
    length   of the sides of their bounding boxes, in units, as gutters follow outlines about as tightly
    longest  side of a bounding box, in units: no page holds more than its own side of it
    """

    covered: float
    length: float
    longest: float

    @classmethod
    def of(cls, flat: Float64Array, chart: Int32Array, size: int, borders: ChartBorders) -> Self:
        """Measure charts, see `chart_masks`, at a scale that suits a page of size x size texels."""
        longest, cells = float(flat.max()), min(size, _MAX_CELLS)
        scale = min(math.sqrt(cells**2 / float(doubled_uv_areas(flat).sum())), cells / longest)
        masks = chart_masks(flat * scale, chart, 0.0, borders)
        covered = sum(int(np.count_nonzero(mask)) for mask in masks) / scale**2
        return cls(covered, 2 * sum(sum(mask.shape) for mask in masks) / scale, longest)

    def scale(self, cells: float, gap: float) -> float:
        """Return the scale t at which charts and gaps need this many cells."""
        strip = self.length * gap / 4
        return (math.sqrt(strip**2 + self.covered * cells) - strip) / self.covered

    def needed(self, scale: float, gap: float) -> float:
        """Return the cells that charts and gaps need."""
        return scale * (self.covered * scale + self.length * gap / 2)


def choose_gutter(outlines: Outlines, size: int, padding: int, density: float | None = None) -> int:
    """Return the gutter in texels: twice the padding, but less where gutters would take more than MAX_SHARE of a page.

    density   texels per unit of length; None: as many as the page has room for

    A wider one keeps charts apart in more mip levels, but leaves them fewer texels. The share is the one at which the
    error as rendered, in the mean over mip levels 0 to 2, was least on several meshes (benchmarks/atlas_quality.py).
    """
    gutter = max(MIN_GUTTER, 2 * padding)
    while gutter > MIN_GUTTER:
        scale = outlines.scale(_FILL * size**2, gutter) if density is None else density
        if outlines.length * scale * gutter / 2 <= MAX_SHARE * size**2:
            break
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


# The scale.


class _Layout(NamedTuple):
    """Charts in a page, in cells.

    scale    cells per unit of length
    shapes   (n, 2): rows and columns of each chart's mask, before it is turned
    places   (n, 3): the first row and column of each chart, and by how many quarter turns it is turned
    height   rows that are used
    """

    scale: float
    shapes: IntArray
    places: IntArray
    height: int


class _Packing(NamedTuple):
    """What is packed, and into what.

    flat     (f, 3, 2) charts, each at the origin, in units of length
    chart    (f,) the chart of each face
    borders  of these charts
    cells    side of the page
    reach    see `reach_of_gutter`
    inset    see `chart_masks`
    tick     see `pack_charts`
    """

    flat: Float64Array
    chart: Int32Array
    borders: ChartBorders
    cells: int
    reach: list[int]
    inset: float
    tick: Tick | None

    def may_fit(self, scale: float) -> bool:
        """Tell whether charts without gaps are small enough for the page."""
        area = float(doubled_uv_areas(self.flat).sum()) / 2
        return self.flat.max() * scale < self.cells + 1 and area * scale**2 <= self.cells**2

    def at_scale(self, scale: float) -> _Layout | None:
        """Return the layout in a page that may become higher than wide; None where they do not fit that either."""
        masks = chart_masks(self.flat * scale, self.chart, self.inset, self.borders)
        places = Page(self.cells, int(_PAGE_HEIGHT * self.cells), self.reach).place(masks, self.tick)
        if places is None:
            return None
        shapes = np.array([mask.shape for mask in masks])
        turned = np.where(places[:, 2] % 2 == 0, shapes[:, 0], shapes[:, 1])
        return _Layout(scale, shapes, places, int((places[:, 0] + turned).max()))

    def at_greatest_scale(self, outlines: Outlines, gap: float, *, quick: bool) -> _Layout | None:
        """Return the layout at about the greatest scale that fits the page; None where none does.

        gap     the gutter in cells
        quick   take the first scale that fits
        Each try tells how much of a row charts and gaps fill, which gives the scale of the next.
        """
        if self.cells < 1:
            return None
        widest = self.cells / outlines.longest
        best, too_large = None, widest * _ACCEPTED_RATIO
        scale = min(outlines.scale((_QUICK_FILL if quick else _FILL) * self.cells**2, gap), widest)
        for attempt in itertools.count(1):
            layout = self.at_scale(scale)
            if layout is not None and layout.height <= self.cells:
                best = layout
            else:
                too_large = scale
            if best is not None and (
                quick
                or attempt >= _MAX_TRIES
                or best.height >= _ACCEPTED_HEIGHT * self.cells
                or too_large < best.scale * _ACCEPTED_RATIO
            ):
                break
            if scale * outlines.longest <= 1:  # each chart is one cell
                break
            if layout is None:
                scale *= _SMALLEST_STEP
            else:
                scale = outlines.scale(outlines.needed(scale, gap) / layout.height * self.cells * _TARGET_HEIGHT, gap)
            if best is None:
                scale = min(scale, too_large * (1.0 - 0.005 * attempt))
            else:
                room = min(too_large, best.scale * 1.2) - best.scale
                scale = min(max(scale, best.scale + 0.2 * room), best.scale + 0.8 * room)
        return best


def _moved(flat: Float64Array, chart: Int32Array, layout: _Layout) -> Float64Array:
    """Return charts, (f, 3, 2) in cells from their origins, turned and moved to their places."""
    rows, columns = layout.shapes[chart].T[:, :, None]
    row, column, turns = layout.places[chart].T[:, :, None]
    x, y = flat[..., 0], flat[..., 1]
    turned = turns == np.arange(4)[:, None, None]
    right = np.select(list(turned), [x, y, columns - x, rows - y])
    down = np.select(list(turned), [y, columns - x, rows - y, x])
    return np.stack([right + column, down + row], axis=-1)
