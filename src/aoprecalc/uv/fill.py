"""How charts fill their page: in the scales that they need, as large as there is room for, or at a given density."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from aoprecalc.errors import ArgumentError
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.mesh.topology import face_components
from aoprecalc.raster.layout import corner_ids, doubled_uv_areas
from aoprecalc.subprocesses import ChildTimeoutError
from aoprecalc.types import Atlas, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.uv.charts import Charts, sum_over_charts
from aoprecalc.uv.pack import NoRoomError, Packed, pack_charts
from aoprecalc.uv.page import Tick

# Measures an atlas coarsely: (h, w) int32, the face at each texel or -1, and (h, w) float32, its ambient occlusion.
FirstLook = Callable[[Atlas], tuple[Int32Array, Float32Array]]

LARGEST_PAGE = 32768  # texels

_SCALES = 0.25, 2.5  # of charts by need
_PRIOR = 0.5  # pairs of texels of average difference, added to those of each chart
_NOISE = 0.006  # difference of neighbouring texels that does not matter


@dataclass(frozen=True)
class PageSpec:
    """What charts are packed into, and how.

    size      texels of a side
    padding   texels around each chart that should stay free; see `pack.choose_gutter` for meshes without such room
    density   texels per unit of length, of each chart; None: as many as there is room for, more where they are needed
    """

    size: int
    padding: int
    density: float | None = None


def fill_page(
    scene: Scene, atlas: Atlas, page: PageSpec, first_look: FirstLook | None, tick: Tick | None = None
) -> Atlas:
    """Return an atlas of new UVs with its charts packed anew: at the page's density, or by need.

    first_look   tells the need; None: it is the same everywhere
    tick         see `pack_charts`
    Raises TooDenseError where the page has no room for charts of its density.
    """
    chart = face_components(corner_ids(scene.faces[atlas.mapped], atlas.uvs[atlas.mapped]))
    if page.density is None:
        packed = _by_need(atlas, chart, page, first_look, tick)
    else:
        packed = _at_density(scene, atlas, chart, page, page.density, tick)
    if packed is None:
        return atlas
    uvs = np.zeros_like(atlas.uvs)
    uvs[atlas.mapped] = packed.uvs
    return replace(atlas, uvs=uvs, gutter=packed.gutter)


def _by_need(
    atlas: Atlas, chart: Int32Array, page: PageSpec, first_look: FirstLook | None, tick: Tick | None
) -> Packed | None:
    """Pack charts as large as the page has room for; None where it has hardly a texel for each.

    Charts that hold one value, as hidden ones do, are smaller. If neighbouring texels of a chart differ by d, its error
    is in proportion to d; charts of area A at t texels a unit take A t^2 texels, and leave a squared error of
    A (d / t)^2. The sum of the errors is least, for as many texels, where t is in proportion to the square root of d.
    """
    scales = np.ones(atlas.charts)
    if first_look is not None:
        faces, values = first_look(atlas)
        of_face: Int32Array = np.full(len(atlas.mapped) + 1, -1, np.int32)  # face -1 reads the last one
        of_face[:-1][atlas.mapped] = chart
        scales = scales_by_need(of_face[faces], values, atlas.charts)
    charts = Charts(atlas.uvs[atlas.mapped] * scales[chart, None, None], chart)  # they keep their shapes in the page
    try:
        return pack_charts(charts, page.size, page.padding, tick=tick)
    except NoRoomError:
        return None


def scales_by_need(charts: Int32Array, values: Float32Array, count: int) -> Float64Array:
    """Return the scales of `count` charts, (count,), from an image of charts, -1 for none, and one of their values."""
    squared, pairs = np.zeros(count), np.zeros(count)
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        same = (charts[one] == charts[other]) & (charts[one] >= 0)
        difference = values[one][same].astype(np.float64) - values[other][same]
        squared += np.bincount(charts[one][same], difference**2, count)
        pairs += np.bincount(charts[one][same], minlength=count)
    mean = squared.sum() / max(pairs.sum(), 1)
    differences = (squared + _PRIOR * mean) / (pairs + _PRIOR) + _NOISE**2
    scales: Float64Array = np.clip((differences / (mean + _NOISE**2)) ** 0.25, *_SCALES)
    return scales


def _at_density(
    scene: Scene, atlas: Atlas, chart: Int32Array, page: PageSpec, density: float, tick: Tick | None
) -> Packed:
    """Pack charts with as many texels per unit of length each."""
    uvs = atlas.uvs[atlas.mapped]
    surface = sum_over_charts(chart, np.linalg.norm(area_vectors(scene.corners[atlas.mapped]), axis=1))
    to_units = np.sqrt(surface / sum_over_charts(chart, doubled_uv_areas(uvs)))
    charts = Charts(uvs * to_units[chart, None, None], chart)
    try:
        return pack_charts(charts, page.size, page.padding, density, tick=tick)
    except NoRoomError as error:
        raise TooDenseError(charts, page, tick) from error


class TooDenseError(Exception):
    """A page has no room for charts, in units of length, of its density."""

    def __init__(self, charts: Charts, page: PageSpec, tick: Tick | None) -> None:
        """Keep what does not fit; for `tick` see `pack_charts`."""
        super().__init__(charts, page)
        self._charts, self._page, self._tick = charts, page, tick

    def advice(self) -> ArgumentError:
        """Return the error that names the density that fits the page, and the size of a page that this one fits.

        What is not found before the time to unwrap ends is left out.
        """
        page, advice = self._page, list[str]()
        with suppress(ChildTimeoutError):
            for line in self._possible():
                advice.append(line)
        found = f"is {page.density:g}, for which {page.size} x {page.size} texels have no room"
        return ArgumentError("texel_density", f"{found}; {', or '.join(advice) or 'use a lower one'}", "size")

    def _possible(self) -> Iterator[str]:
        """Find the density that fits the page, then the size; raises what `tick` raises."""
        charts, page, tick = self._charts, self._page, self._tick
        assert page.density is not None
        fits = page.density / 2
        with suppress(NoRoomError):
            fits = pack_charts(charts, page.size, page.padding, tick=tick).density
            yield f"use {rounded_down(fits)}"
        size = next_power_of_two(max(page.size + 1, page.size * min(page.density / fits, LARGEST_PAGE)))
        while size <= LARGEST_PAGE:
            with suppress(NoRoomError):
                pack_charts(charts, size, page.padding, page.density, tick=tick)
                yield f"a {{size}} of {size}"
                return
            size *= 2


def next_power_of_two(number: float) -> int:
    """Return the smallest power of two that is at least as great as a number."""
    return 1 << max(0, int(np.ceil(np.log2(number))))


def rounded_down(number: float) -> str:
    """Return a positive number to three digits that is at most as great, such as 63.2."""
    step = 10.0 ** (np.floor(np.log10(number)) - 2)
    return f"{np.floor(number / step) * step:.3g}"
