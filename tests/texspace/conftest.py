"""Both rasterisers behind one interface, so that the same tests hold them to the same rules."""

import numpy as np
import pytest

from aoprecalc.texspace.raster import Raster
from aoprecalc.texspace.samples import Samples
from aoprecalc.texspace.scanline import ScanlineRaster


class ReadBack:
    """`Raster` with the interface of `ScanlineRaster`; keeps weights on the face as receive.comp.glsl does."""

    def __init__(self, context, layout):
        self._raster = Raster(context, layout)
        self._covered, self._bands = self._raster.coverage()
        self.overlap = self._raster.overlap

    def coverage(self):
        return self._covered

    def samples(self, texels, sample_at):
        drawn = [
            np.frombuffer(self._raster.draw(band.row, sample_at).read(), "f4")[: band.rows * texels.width * 4]
            for band in self._bands
        ]
        surface = np.concatenate(drawn).reshape(-1, 4)[texels.index]
        weights = np.maximum(surface[:, 1:3], 0)
        weights /= np.maximum(1, weights.sum(axis=1, keepdims=True))
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        return Samples(surface[:, 0].astype(np.int32) - 1, weights)


@pytest.fixture
def on_gl(renderer):
    """Makes a rasteriser of a layout that draws with OpenGL."""
    return lambda layout: ReadBack(renderer.context, layout)


@pytest.fixture(params=["gl", "scanline"])
def rasteriser(request):
    """Makes a rasteriser of a layout: the test runs once with each kind."""
    return request.getfixturevalue("on_gl") if request.param == "gl" else ScanlineRaster
