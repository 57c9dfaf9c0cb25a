"""The points that receive light, one under each covered texel, on the renderer, and the sums of what they see."""

from dataclasses import dataclass

import moderngl
import numpy as np

from aoprecalc.gl.programs import compute_program
from aoprecalc.model import Floats
from aoprecalc.occlusion.near_far import GRID, NearFarMaps
from aoprecalc.surface.unit import UnitSurface
from aoprecalc.texspace.samples import Samples

_LOCAL_SIZE = 128
_MOST = 1 << 22  # texels of one store: keeps storage buffers under llvmpipe's 128 MB
_NO_FACE = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class _Store:
    """A run of receivers on the renderer: storage buffers, each with one entry a receiver."""

    texels: slice
    faces: moderngl.Buffer
    points: moderngl.Buffer
    sums: moderngl.Buffer


class Receivers:
    """Puts a receiver at each sample, gathers visibility for all of them, and hands back the sums."""

    def __init__(self, context: moderngl.Context, surface: UnitSurface, count: int, maps: NearFarMaps) -> None:
        """Upload the surface, and make room for `count` receivers that look into `maps`."""
        constants: dict[str, float | str] = {"LOCAL_SIZE": f"{_LOCAL_SIZE}u", "NO_FACE": _NO_FACE}
        looks = " ".join(f"look(one, {5 * axis}); look(other, {5 * axis});" for axis in range(maps.capacity))
        self._context = context
        self._receive = compute_program(context, __package__, "receive.comp.glsl", **constants)
        self._gather = compute_program(
            context,
            __package__,
            "gather.comp.glsl",
            **constants | {"AXES": maps.capacity, "EACH_AXIS": looks, "GRID": float(GRID)},
        )
        self._gather["most_turns"] = 4
        self._maps = maps
        self._surface = [
            context.buffer(np.ascontiguousarray(array))
            for array in (surface.positions, surface.faces.astype(np.uint32), surface.shading, surface.geometric)
        ]
        self._stores = [self._store(slice(start, min(start + _MOST, count))) for start in range(0, count, _MOST)]
        self._weights = context.buffer(reserve=min(count, _MOST) * 8)  # of one store at a time
        self._placed = 0  # receivers

    def place(self, samples: Samples) -> None:
        """Put receivers at the samples, as many as there is room for or fewer, and their sums to zero."""
        self._placed = len(samples.faces)
        for binding, buffer in enumerate(self._surface):
            buffer.bind_to_storage_buffer(binding)
        for store in self._stores:
            store.faces.write(np.ascontiguousarray(samples.faces[store.texels]))  # -1 is NO_FACE
            self._weights.write(np.ascontiguousarray(samples.weights[store.texels, 1:]))
            for binding, buffer in enumerate((store.faces, self._weights, store.points, store.sums), 4):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._receive, store)

    def gather(self) -> None:
        """Add what every receiver sees along the axes that the maps hold at present."""
        self._maps.bind()
        self._surface[3].bind_to_storage_buffer(3)
        for store in self._stores:
            for binding, buffer in ((1, store.points), (2, store.faces), (4, store.sums)):
                buffer.bind_to_storage_buffer(binding)
            self._run(self._gather, store, 2)

    def sums(self) -> Floats:
        """Return the sums since `place`, (k, 2) float32: weight of what is visible, and of all."""
        sums = np.empty((self._placed, 2), np.float32)
        for store in self._stores:
            if self._count(store):
                found = np.frombuffer(store.sums.read(), np.float32).reshape(-1, 2)
                sums[store.texels] = found[: self._count(store)]
        return sums

    def _run(self, program: moderngl.ComputeShader, store: _Store, each: int = 1) -> None:
        """Run a program of which an invocation takes `each` texels."""
        count = self._count(store)
        if count:
            program["texel_count"] = count
            program.run(-(-count // (each * _LOCAL_SIZE)))
            self._context.memory_barrier()

    def _count(self, store: _Store) -> int:
        """How many receivers are placed in a store."""
        count: int = min(store.texels.stop, self._placed) - store.texels.start
        return max(0, count)

    def _store(self, texels: slice) -> _Store:
        count = texels.stop - texels.start
        return _Store(texels, *(self._context.buffer(reserve=count * size) for size in (4, 16, 8)))
