"""Triangles that stop rays."""

from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from aoprecalc.errors import RendererError
from aoprecalc.mesh.unit_sphere import NormalizedSurface
from aoprecalc.progress import Progress
from aoprecalc.raster.samples import Samples
from aoprecalc.system import whole_cores
from aoprecalc.types import BoolArray, Float32Array, Float64Array

# Of the bounding radius: how far above its face a ray starts, so that it does not meet that face; 32-bit positions are
# good to 1e-7. With ten times as much, rays from a crease start behind the wall that ought to stop them.
RAY_OFFSET = 1e-5
_BLOCK = 1 << 18  # rays that a thread casts at a time


def embreex_problem() -> str | None:
    """Return why rays cannot be cast here and what to do, or None where they can."""
    if find_spec("embreex") is None:
        return "embreex, which traces rays, is not installed; `pip install 'aoprecalc[ray]'`"
    try:
        import_module("embreex.rtcore_scene")
    except ImportError as error:
        return f"embreex, which traces rays, cannot be loaded ({error}); install it again"
    return None


def require_embreex() -> None:
    """Raise RendererError where rays cannot be cast."""
    reason = embreex_problem()
    if reason is not None:
        raise RendererError(reason)


class RayCaster:
    """The triangles of a mesh in an Embree scene; both their sides stop rays."""

    def __init__(self, corners: Float32Array, threads: int = 0) -> None:
        """Build over triangles, (o, 3, 3) float32 corners; `threads` cast rays, 0 is one a core.

        Raises RendererError where rays cannot be cast.
        """
        require_embreex()
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # The scene does not keep what it was made of alive.
        vertices = np.ascontiguousarray(corners.reshape(-1, 3), np.float32)
        self._mesh = TriangleMesh(self._scene, vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
        self._threads = threads or whole_cores()

    def occluded(self, origins: Float32Array, directions: Float32Array) -> BoolArray:
        """Return which of k rays meet a triangle, (k,) bool.

        origins      (k, 3) float32
        directions   (k, 3) float32, or (1, 3) for parallel rays
        """
        stopped = np.empty(len(origins), bool)

        def cast(start: int) -> None:
            part = slice(start, start + _BLOCK)
            along = directions if len(directions) == 1 else directions[part]
            stopped[part] = self._scene.run(origins[part], along, query="OCCLUDED") >= 0

        with ThreadPoolExecutor(self._threads) as pool:
            list(pool.map(cast, range(0, len(origins), _BLOCK)))
        return stopped


# Visibility by tracing rays: slower than maps, exact, and without OpenGL.


class RayTester:
    """An Observer that casts a ray from every sample along every direction in front of it."""

    def __init__(self, surface: NormalizedSurface, threads: int = 0) -> None:
        """Build the occluders. Raises RendererError where embreex is not installed."""
        self._surface = surface
        self._occluders = RayCaster(surface.occluders, threads)

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        there = np.flatnonzero(samples.faces >= 0)
        places, normals, geometric = self._surface.interpolate(samples.faces[there], samples.weights[there])
        origins = (places + RAY_OFFSET * geometric).astype(np.float32)
        visible, whole = np.zeros(len(there)), np.zeros(len(there))
        for axis in axes:
            g_along, n_along = geometric @ axis, normals @ axis
            for towards in (1.0, -1.0):  # the end of the axis from which light comes
                facing = np.flatnonzero((towards * g_along > 0) & (towards * n_along > 0))
                weights = np.abs(n_along[facing])
                direction = towards * axis
                if self._surface.is_below_ground(direction):
                    hidden = np.ones(len(facing), bool)
                else:
                    hidden = self._occluders.occluded(origins[facing], direction[None].astype(np.float32))
                whole[facing] += weights
                visible[facing] += np.where(hidden, 0, weights)
                progress.advance()
        sums = np.zeros((len(samples.faces), 2), np.float32)
        sums[there] = np.column_stack([visible, whole])
        return sums
