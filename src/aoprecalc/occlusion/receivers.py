"""The points that receive light, one under each covered texel, and the sums of what each of them sees."""

from dataclasses import dataclass

import moderngl
import numpy as np

from aoprecalc.gl.programs import compute_program
from aoprecalc.model import Floats, Ints, Texels
from aoprecalc.occlusion.near_far import MOST_AXES, NearFarMaps
from aoprecalc.texspace.raster import Band, Raster

_LOCAL_SIZE = 128
_NO_FACE = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class _Store:
    """A band's texels on the renderer: storage buffers, each with one entry a texel."""

    band: Band
    count: int
    index: moderngl.Buffer
    points: moderngl.Buffer
    faces: moderngl.Buffer
    sums: moderngl.Buffer


class Receivers:
    """Places one receiver under each texel, gathers visibility for all of them, and hands back the sums."""

    def __init__(
        self,
        context: moderngl.Context,
        raster: Raster,
        texels: Texels,
        bands: list[Band],
        positions: Floats,
        faces: Ints,
        shading: Floats,
        geometric: Floats,
    ) -> None:
        """Upload the surface: (v, 3) positions, (f, 3) faces, (f, 3, 3) shading and (f, 3) geometric normals."""
        constants = {"LOCAL_SIZE": _LOCAL_SIZE, "NO_FACE": _NO_FACE, "MOST_AXES": MOST_AXES}
        self._context = context
        self._raster = raster
        self._receive = compute_program(context, __package__, "receive.comp.glsl", **constants)
        self._gather = compute_program(context, __package__, "gather.comp.glsl", **constants)
        self._positions = context.buffer(np.ascontiguousarray(positions, np.float32))
        self._corners = context.buffer(np.ascontiguousarray(faces, np.uint32))
        self._shading = context.buffer(np.ascontiguousarray(shading, np.float32))
        self._geometric = context.buffer(np.ascontiguousarray(geometric, np.float32))
        self._stores = [
            self._store(band, texels.index[band.texels]) for band in bands if band.texels.stop > band.texels.start
        ]
        self._receive["width"] = texels.width

    def place(self, sample_at: tuple[float, float]) -> None:
        """Put the receivers at `sample_at` in the squares of their texels, and their sums to zero."""
        for binding, buffer in enumerate((self._positions, self._corners, self._shading, self._geometric)):
            buffer.bind_to_storage_buffer(binding)
        for store in self._stores:
            self._raster.draw(store.band.row, sample_at).use(0)
            for binding, buffer in enumerate((store.index, store.points, store.faces, store.sums), 4):
                buffer.bind_to_storage_buffer(binding)
            self._receive["first_row"], self._receive["texel_count"] = store.band.row, store.count
            self._receive.run(-(-store.count // _LOCAL_SIZE))
            self._context.memory_barrier()

    def gather(self, maps: NearFarMaps, axes: int) -> None:
        """Add what every receiver sees along the `axes` that `maps` holds at present."""
        self._gather["axis_count"] = axes
        maps.texture.use(0)
        maps.axes.bind_to_uniform_block(0)
        self._geometric.bind_to_storage_buffer(3)
        for store in self._stores:
            for binding, buffer in ((1, store.points), (2, store.faces), (4, store.sums)):
                buffer.bind_to_storage_buffer(binding)
            self._gather["texel_count"] = store.count
            self._gather.run(-(-store.count // _LOCAL_SIZE))
            self._context.memory_barrier()

    def sums(self) -> Floats:
        """Return the sums since `place`, (k, 2) float32: weight of what is visible, and of all."""
        parts = [np.frombuffer(store.sums.read(), np.float32).reshape(-1, 2) for store in self._stores]
        return np.concatenate(parts) if parts else np.zeros((0, 2), np.float32)

    def _store(self, band: Band, index: Ints) -> _Store:
        count, context = len(index), self._context
        return _Store(
            band,
            count,
            context.buffer(index.astype(np.uint32)),
            context.buffer(reserve=count * 16),
            context.buffer(reserve=count * 4),
            context.buffer(reserve=count * 8),
        )
