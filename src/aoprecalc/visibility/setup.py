"""How many texels are looked at at a time, which bounds memory; the result is the same, maps are drawn more often."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from aoprecalc.errors import ArgumentError
from aoprecalc.mesh.unit_sphere import NormalizedSurface
from aoprecalc.options import BakeOptions
from aoprecalc.raster.layout import build_layout
from aoprecalc.raster.samples import CENTER, Samples, keep_faces
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Scene, Texels
from aoprecalc.visibility.backend import Backend
from aoprecalc.visibility.directions import axis_groups, light_axes, texel_offset

FIT_CHUNK = 1 << 20  # texels that are fitted at a time, whatever the portion, so that no sum depends on it
_MOST_PARTS = 8  # without a limit: drawing maps twice for 4096^2 texels takes a tenth longer, and saves 400 MB

# Bytes that a bake takes beyond what it holds before it looks at anything; measured, on the high side.
_OF_PICTURE = 36  # a texel of the picture: the fit's planes, and those of one spot
_OF_COVERED = 24  # a texel that the surface covers: its index and the sums of both halves
_OF_HELD = 60  # a texel of the portion: its sample, its receiver, its sums
_OF_SOLVING = 76  # a texel of the picture, while the fit is solved and nothing is looked at
_OF_HELD_BEFORE = 16  # a texel of the portion, then: what the system was not given back
_OF_TRIANGLE = 400  # while occluders are sorted and uploaded
_OF_MAPS = 1 << 26  # what a batch of maps takes, unless a single axis takes more
_REST = 80 << 20  # that, and what the renderer compiles and keeps
_DRIFT = 16  # megabytes by which what a process holds differs from one run to the next


def texels_per_chunk(limit: int | None, size: str, picture: int, covered: int, maps: int, triangles: int) -> int:
    """Return the most texels that can be looked at at a time within `limit` bytes of memory; None is no limit.

    It is a multiple of PART, or all that are covered.
    size      of the picture, as it is called in messages
    picture   how many texels it has, `covered` of them by the surface
    maps      bytes of the near/far maps of one axis; triangles: of the mesh
    Raises UsageError where not even PART texels fit.
    """
    most = _MOST_PARTS * FIT_CHUNK
    if limit is None:
        return min(most, covered)
    present = _resident() + _REST + max(0, maps - _OF_MAPS) + triangles * _OF_TRIANGLE

    def need(held: int) -> int:
        looking = picture * _OF_PICTURE + covered * _OF_COVERED + held * _OF_HELD
        solving = picture * _OF_SOLVING + held * _OF_HELD_BEFORE
        return present + max(looking, solving)

    for held in range(most, 0, -FIT_CHUNK):
        if need(min(held, covered)) <= limit:
            return min(held, covered)
    enough = (need(min(FIT_CHUNK, covered)) >> 20) + _DRIFT
    raise ArgumentError(
        "memory_limit",
        f"is {limit >> 20}M; {size} texels of this mesh need {enough}M; use a higher limit or a smaller {{size}}",
        "size",
    )


def chunks(count: int, texels_per_chunk: int) -> list[slice]:
    """Cut `count` texels into runs of `portion`, the last one possibly shorter."""
    return [slice(start, min(start + texels_per_chunk, count)) for start in range(0, count, texels_per_chunk)]


def _resident() -> int:
    """Bytes of memory that this process holds; where only that is told, the most that it has held.

    Raises UsageError where the system tells neither.
    """
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        try:
            import resource
        except ModuleNotFoundError as error:
            raise ArgumentError(
                "memory_limit", "needs to know how much memory is used, which this system does not tell; omit it"
            ) from error
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most if sys.platform == "darwin" else most * 1024


# A scene made ready to be looked at: where its texels lie, on which of its sides, and along which axes.


@dataclass(frozen=True, eq=False)
class BakeInputs:
    """What is looked at and how, in plain values: whoever has them finds the same texels and sees the same.

    scene     with the roles of its parts; its document does not matter
    atlas     how the texture lies on it
    normals   (f, 3, 3) float32: the shading normals at the corners
    options   of the bake
    """

    scene: Scene
    atlas: Atlas
    normals: Float32Array
    options: BakeOptions


@dataclass(frozen=True, eq=False)
class SurfaceSide:
    """One side of the surface.

    surface   turned so that this side is in front
    texels    those that have a value on it
    faces     (f,) bool: samples on others do not count; None: all count
    """

    surface: NormalizedSurface
    texels: Texels
    faces: BoolArray | None


class BakeSetup:
    """A inputs on a backend.

    axes     (a, 3) float64, in groups whose sums are added in their order
    texels   all that the surface covers
    sides    the front, and the back where some faces have one
    """

    def __init__(self, backend: Backend, inputs: BakeInputs) -> None:
        """Find the texels."""
        self.backend, self.inputs = backend, inputs
        scene, options = inputs.scene, inputs.options
        self._rasterizer = backend.rasterizer(build_layout(scene, inputs.atlas, options.width, options.height))
        self.axes: Float64Array = light_axes(options.directions, options.sampling, options.seed)
        self.groups = axis_groups(len(self.axes))
        self.texels = self._rasterizer.coverage()
        self.sides = [SurfaceSide(NormalizedSurface.from_scene(scene, inputs.normals), self.texels, None)]
        backs = scene.two_sided & scene.receives
        if backs.any() and len(self.texels):
            face = self._rasterizer.samples(self.texels, CENTER).faces
            behind = self.texels.select((face < 0) | backs[face])
            self.sides.append(SurfaceSide(self.sides[0].surface.flipped(), behind, backs))

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        return self._rasterizer.overlap()

    def samples(self, side: SurfaceSide, held: slice, group: int) -> Samples:
        """Return what lies under a run of a side's texels at the spot of a group of axes."""
        samples = self._rasterizer.samples(side.texels.select(held), texel_offset(group))
        return samples if side.faces is None else keep_faces(samples, side.faces)
