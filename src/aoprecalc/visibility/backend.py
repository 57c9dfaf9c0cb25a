"""What a bake runs on: depth maps in OpenGL, or rays where there is none or where they are asked for.

An axis is a pair of opposite light directions, given by one unit vector.
"""

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Protocol

import numpy as np

from aoprecalc.errors import ArgumentError, RendererError
from aoprecalc.gl.context import VERSION, Renderer, is_software, open_renderer, opengl_problem
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.options import Backend as BackendKind
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import Layout, Rasterizer, Samples
from aoprecalc.types import Float32Array, Float64Array
from aoprecalc.visibility.directions import Projections
from aoprecalc.visibility.embree import casts_packets
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.ray_testers import PacketTester, RayTester
from aoprecalc.visibility.rays import cast_depths, embreex_problem, require_embreex

_GROUP_MAP = 64  # map texels: sides of the maps of parts that others do not occlude are multiples of it
_DIAMETER = 2.0  # of what receives, at most


class VisibilityTester(Protocol):
    """Tests samples of one surface for visibility, any number of times."""

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the sums of k samples over both directions of (a, 3) axes, (k, 2) float32, with vectors (k, 5).

        The first is the sum of f(n.w) [g.w > 0] visible(w), see `Integrand`: that of Précalcul, equation 1.1.1.1, for
        f = max(0, n.w); the second is the same without visible(w); the last three, where the integrand has vectors,
        are that of f(n.w) [g.w > 0] visible(w) w. All are 0 where there is no sample. Directions done are counted on
        `progress`, two for each axis.
        """
        ...


class Backend(Protocol):
    """Makes the two things that differ: the rasterizer of texture space, and the visibility tester.

    kind   gl or ray
    name   of the OpenGL renderer, or of the ray tracer
    """

    kind: str
    name: str

    def check_size(self, options: BakeOptions) -> None:
        """Raise UsageError for a texture size beyond the backend."""
        ...

    def rasterizer(self, layout: Layout) -> Rasterizer:
        """Return a rasterizer of a layout."""
        ...

    def tester(
        self, surface: NormalizedSurface, integrand: Integrand, max_samples: int, shadow_size: int, texels: int
    ) -> VisibilityTester:
        """Return a tester of up to `max_samples` at a time; `shadow_size` is the side of its depth maps, if any.

        texels   of the whole surface, however its samples are split: their number tells how far apart neighbours lie
        """
        ...

    def depths(self, occluders: Float32Array, projection: Projections, size: int) -> Float32Array:
        """Return the depths of occluders along one axis, (2, size, size) float32; NaN where there are none.

        occluders   (o, 3, 3) float32, o >= 1: corners of triangles within 1 of the origin

        The first is the depth nearest to the axis' positive end at the centre of each map texel, the second that
        nearest to its negative end; row 0 has the smallest map y. See `Projections`.
        """
        ...

    def free_unused(self) -> None:
        """Free what rasterizers and testers have allocated that no longer exist."""
        ...

    def check_errors(self) -> None:
        """Raise RendererError if anything went wrong since the backend was opened."""
        ...


class GroupTester:
    """A VisibilityTester of a surface with groups: a tester for each of them in turn, with maps as fine as it needs."""

    def __init__(
        self, backend: Backend, surface: NormalizedSurface, integrand: Integrand, shadow_size: int, texels: int
    ) -> None:
        """Keep what the testers are made of; `shadow_size` and `texels` are those of the whole surface."""
        self._backend, self._surface = backend, surface
        self._integrand, self._shadow_size, self._texels = integrand, shadow_size, texels

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        sums = np.zeros((len(samples.faces), self._integrand.columns), np.float32)
        for surface, rows, faces in self._surface.by_group(samples.faces):
            size = self._size_of_maps(surface, len(rows))
            texels = round(self._texels * len(surface.occluders) / len(self._surface.occluders))
            tester = self._backend.tester(surface, self._integrand, len(rows), size, texels)
            own = Samples(faces.astype(np.int32), samples.weights[rows])
            sums[rows] = tester.accumulate(own, axes, Progress())
        progress.advance(2 * len(axes))
        return sums

    def _size_of_maps(self, surface: NormalizedSurface, samples: int) -> int:
        """Return the side of the maps of a group: their texels are half as wide as the distance of its samples."""
        area = np.linalg.norm(area_vectors(surface.positions[surface.faces].astype(np.float64)), axis=1).sum() / 2
        size = 2 * _DIAMETER * math.sqrt(samples / area) if area else 0.0
        return min(self._shadow_size, max(1, math.ceil(size / _GROUP_MAP)) * _GROUP_MAP)


class GLBackend:
    """Depth maps in an OpenGL context."""

    kind = "gl"

    def __init__(self, renderer: Renderer) -> None:
        """Use a context for as long as it is open."""
        self._renderer = renderer
        self.name = renderer.name

    def check_size(self, options: BakeOptions) -> None:
        """Raise UsageError for a texture beyond the renderer's limit; the band that is drawn never reaches it."""
        limit = self._renderer.max_size
        size = max(options.width, options.height)
        if size > limit:
            raise ArgumentError(
                "size",
                f"is {size}, beyond this renderer ({self.name}), at most {limit} was expected; "
                "use a smaller one, or {backend} ray",
                "backend",
            )

    def rasterizer(self, layout: Layout) -> Rasterizer:
        """Return a GLRasterizer."""
        from aoprecalc.raster.gl_rasterizer import GLRasterizer  # needs moderngl, as below

        self.free_unused()
        return GLRasterizer(self._renderer.context, layout)

    def tester(
        self, surface: NormalizedSurface, integrand: Integrand, max_samples: int, shadow_size: int, texels: int
    ) -> VisibilityTester:
        """Return a DepthMapTester, or one for each group of the surface."""
        if surface.groups is not None:
            return GroupTester(self, surface, integrand, shadow_size, texels)
        from aoprecalc.visibility.depth_maps import DepthMapTester

        self.free_unused()
        return DepthMapTester(self._renderer, surface, integrand, max_samples, shadow_size)

    def depths(self, occluders: Float32Array, projection: Projections, size: int) -> Float32Array:
        """Draw a depth map and read it back."""
        from aoprecalc.visibility.depth_maps import read_depths

        return read_depths(self._renderer.context, occluders, projection, size)

    def free_unused(self) -> None:
        """Free objects of OpenGL, which outlive those of Python."""
        self._renderer.context.gc()

    def check_errors(self) -> None:
        """Raise RendererError where OpenGL reports an error."""
        if self._renderer.context.error != "GL_NO_ERROR":
            raise RendererError(f"{self.name} reported an error while rendering; use smaller sizes or another driver")


class RayBackend:
    """Rays on the processor; no OpenGL."""

    kind = "ray"
    name = "Embree"

    def __init__(self, threads: int) -> None:
        """Cast rays on `threads` threads, 0 is one for each core. Raises RendererError where embreex is missing."""
        self._threads = threads
        require_embreex()

    def check_size(self, options: BakeOptions) -> None:
        """Accept any size."""

    def rasterizer(self, layout: Layout) -> Rasterizer:
        """Return a CPURasterizer."""
        return CPURasterizer(layout)

    def tester(
        self, surface: NormalizedSurface, integrand: Integrand, max_samples: int, shadow_size: int, texels: int
    ) -> VisibilityTester:
        """Return a PacketTester, or a RayTester where packets do not do; or one for each group of the surface."""
        if surface.groups is not None:
            return GroupTester(self, surface, integrand, shadow_size, texels)
        if PacketTester.serves(surface, integrand):
            return PacketTester(surface, integrand, texels, self._threads)
        return RayTester(surface, integrand, self._threads)

    def depths(self, occluders: Float32Array, projection: Projections, size: int) -> Float32Array:
        """Cast rays from both ends of the axis."""
        return cast_depths(occluders, projection, size, self._threads)

    def free_unused(self) -> None:
        """Do nothing: all is Python's."""

    def check_errors(self) -> None:
        """Do nothing: rays raise their errors at once."""


@contextmanager
def open_backend(options: BakeOptions, progress: Progress) -> Iterator[Backend]:
    """Open the backend that `options` ask for.

    auto is gl on a GPU, and what is faster on a processor; ray with a note where there is no OpenGL. Where distances
    count it is ray. Raises RendererError where there is none, UsageError for a size of the texture beyond it.
    """
    if options.max_distance is not None:
        progress.note("rays are traced: depth maps do not tell how far away an occluder is (--max-distance)")
        yield RayBackend(options.threads)
        return
    with ExitStack() as stack:
        heard = Progress() if takes_rays(options) else progress  # what would be told is that rays are slower
        renderer = _choose(options.backend, options.threads, heard, stack)
        if renderer is not None and options.backend == "auto" and _faster_by_rays(renderer, options):
            stack.close()
            renderer = None
        backend = RayBackend(options.threads) if renderer is None else GLBackend(renderer)
        backend.check_size(options)
        yield backend


def takes_rays(options: BakeOptions) -> bool:
    """Tell whether `auto` takes rays where there is no GPU, although OpenGL works: they are faster, or needed."""
    few = options.interleaves and options.backfaces == "occlude" and embreex_problem() is None and casts_packets()
    return few or options.max_distance is not None


def _faster_by_rays(renderer: Renderer, options: BakeOptions) -> bool:
    """Tell whether rays, which are few then and cast in packets, are faster than the depth maps of a renderer.

    What is too large for the renderer is left to it, to say so: by rays it would take hours, and much memory.
    """
    too_large = max(options.width, options.height) > renderer.max_size
    return is_software(renderer.name) and takes_rays(options) and not too_large


@contextmanager
def open_renderer_or_rays(kind: BackendKind, threads: int, progress: Progress) -> Iterator[Renderer | None]:
    """Open OpenGL, or return None where rays are to be traced: auto is gl, else ray with a note.

    Raises RendererError where neither works, or not what was asked for.
    """
    with ExitStack() as stack:
        yield _choose(kind, threads, progress, stack)


def _choose(kind: BackendKind, threads: int, progress: Progress, stack: ExitStack) -> Renderer | None:
    if kind == "ray":
        require_embreex()
        return None
    try:
        return stack.enter_context(open_renderer(threads))
    except RendererError as error:
        no_rays = embreex_problem()
        if no_rays is not None:
            raise RendererError(f"{error}; or trace rays: {no_rays}") from error
        if kind == "gl":
            raise RendererError(f"{error}; or trace rays: --backend ray") from error
        progress.note(ray_note())
        return None


def ray_note() -> str:
    """Say that `auto` takes rays, why, and how to get what is faster."""
    problem, opengl = opengl_problem(), f"OpenGL {VERSION[0]}.{VERSION[1]}"
    if problem is not None:
        return f"tracing rays instead of drawing depth maps, as there is no {opengl}: {problem}"
    return f"no {opengl}: rays are traced, which takes longer; `aoprecalc doctor` says how to get the faster way"
