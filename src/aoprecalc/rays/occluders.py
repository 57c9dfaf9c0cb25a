"""Triangles that stop rays."""

from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from aoprecalc.errors import RendererError
from aoprecalc.limits import whole_cores
from aoprecalc.model import Floats, Mask

# Of the bounding radius: how far above its face a ray starts, so that it does not meet that face; 32-bit positions are
# good to 1e-7. With ten times as much, rays from a crease start behind the wall that ought to stop them.
LIFT = 1e-5
_BLOCK = 1 << 18  # rays that a thread casts at a time


def obstacle() -> str | None:
    """Return why rays cannot be cast here and what to do, or None where they can."""
    if find_spec("embreex") is None:
        return "embreex, which traces rays, is not installed; `pip install 'aoprecalc[ray]'`"
    try:
        import_module("embreex.rtcore_scene")
    except ImportError as error:
        return f"embreex, which traces rays, cannot be loaded ({error}); install it again"
    return None


def require() -> None:
    """Raise RendererError where rays cannot be cast."""
    reason = obstacle()
    if reason is not None:
        raise RendererError(reason)


class Occluders:
    """The triangles of a mesh in an Embree scene; both their sides stop rays."""

    def __init__(self, corners: Floats, threads: int = 0) -> None:
        """Build over triangles, (o, 3, 3) float32 corners; `threads` cast rays, 0 is one a core.

        Raises RendererError where rays cannot be cast.
        """
        require()
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # The scene does not keep what it was made of alive.
        vertices = np.ascontiguousarray(corners.reshape(-1, 3), np.float32)
        self._mesh = TriangleMesh(self._scene, vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
        self._threads = threads or whole_cores()

    def hidden(self, origins: Floats, directions: Floats) -> Mask:
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
