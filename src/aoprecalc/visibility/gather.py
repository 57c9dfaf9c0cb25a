"""Ambient occlusion of texels: visibility sums of one group of axes after the other, and the image fitted to them.

An axis is a pair of opposite light directions, given by one unit vector.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice, pairwise
from types import TracebackType
from typing import ParamSpec, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from aoprecalc.raster.layout import Samples, texel_positions
from aoprecalc.raster.resolve import LeastSquaresImage
from aoprecalc.system import whole_cores
from aoprecalc.types import BoolArray, Float32Array, Int32Array, Texels
from aoprecalc.visibility.directions import texel_offset
from aoprecalc.visibility.integrand import sampling_error
from aoprecalc.visibility.interleaving import GROUPS, MEAN_OFFSET, group_of_texels, share_sums, smooth_change
from aoprecalc.visibility.plan import FIT_CHUNK, chunks
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide
from aoprecalc.visibility.source import TexelRequest, VisibilitySource

_Item = TypeVar("_Item")
_Made = TypeVar("_Made")
_Arguments = ParamSpec("_Arguments")


@dataclass(frozen=True, eq=False)
class TexelOcclusion:
    """The ambient occlusion of one side's texels.

    texels           k of them
    values           (k,) float32 in [0, 1]: the mean over the part of each texel that the surface covers
    measured         (k,) bool: texels that have a value
    reconstruction   every sample at its position in the texture, as occlusion (1 - AO value) and, where it is wanted,
                     visibility vector, to fit an image to
    directions       number of light directions used
    per_texel        how many of them a texel took itself, in the mean
    error            the estimated sampling error of `values`, RMS; None where one group of axes was used
    vectors          (k, 3) float32: the mean visibility vectors; None where they are not wanted
    """

    texels: Texels
    values: Float32Array
    measured: BoolArray
    reconstruction: LeastSquaresImage
    directions: int
    per_texel: float
    error: float | None
    vectors: Float32Array | None


def gather(setup: BakeSetup, side: SurfaceSide, source: VisibilitySource, chunk_size: int) -> TexelOcclusion:
    """Sum the visibility of a side's texels over all axes (Précalcul, sections 1.1.2 and 1.1.3).

    Each group of axes samples the texels at an offset of its own. Even and odd groups are summed separately: their
    difference tells the error. At most `chunk_size` texels are processed at a time. By rays neighbouring texels
    may take different groups, see `interleaving`.
    """
    one_thread = (setup.inputs.options.threads or whole_cores()) == 1
    with Background(inline=one_thread or setup.backend.kind == "gl") as background:  # OpenGL belongs to one thread
        gathering = _Gathering(setup, side, source, chunk_size, background)
        if setup.interleaved:
            gathering.interleave()
        else:
            gathering.take_groups()
    return gathering.result()


class Background:
    """A thread that does what it is asked for, in that order, during a `with` block.

    So NumPy computes what is needed next, and works on what was found last, while compiled code, which does not hold
    the interpreter's lock, runs on the other cores.
    """

    def __init__(self, *, inline: bool) -> None:
        """Start the thread; `inline`: there is none, and the caller does everything, at once."""
        self._thread = None if inline else ThreadPoolExecutor(1)
        self._waiting: list[Future[None]] = []

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until all is done, and raise what was raised there; after an error do no more."""
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=error is not None)
        if error is None:
            self._raise_errors()

    def do(self, function: Callable[_Arguments, None], *args: _Arguments.args, **named: _Arguments.kwargs) -> None:
        """Call a function, now or later. What it raises is raised by a later call, or at the end."""
        if self._thread is None:
            function(*args, **named)
            return
        self._raise_errors()
        self._waiting.append(self._thread.submit(function, *args, **named))

    def made_ahead(self, make: Callable[[_Item], _Made], items: Iterable[_Item]) -> Iterator[tuple[_Item, _Made]]:
        """Yield items and what is made of each, that of the next one while the caller works on this one.

        What is made for a caller that ends early is dropped.
        """
        if self._thread is None:
            yield from ((item, make(item)) for item in items)
            return
        before: tuple[_Item, Future[_Made]] | None = None
        for item in items:
            following = item, self._thread.submit(make, item)
            if before is not None:
                yield before[0], before[1].result()
            before = following
        if before is not None:
            yield before[0], before[1].result()

    def _raise_errors(self) -> None:
        for future in [future for future in self._waiting if future.done()]:
            self._waiting.remove(future)
            future.result()


class _Gathering:
    """The visibility sums of a side's texels so far, and the image that is fitted to their samples."""

    def __init__(
        self,
        setup: BakeSetup,
        side: SurfaceSide,
        source: VisibilitySource,
        chunk_size: int,
        background: Background,
    ) -> None:
        """Start without sums. In the background texels are sampled, and the image is fitted."""
        self._setup, self._side, self._source, self._chunk_size = setup, side, source, chunk_size
        self._background = background
        texels, atlas, columns = side.texels, setup.inputs.atlas, setup.integrand.columns
        self._image = LeastSquaresImage(texels.width, texels.height, repeats=atlas.repeats, channels=columns - 1)
        self._face_areas = setup.area_per_texel(texels)
        self._halves = np.zeros((2, len(texels), columns), np.float32)  # the sums of even and of odd groups
        self._used = [0, 0]  # directions of each half
        self._per_texel = 0.0  # directions that a texel took itself, in the mean
        self._error: float | None = None

    def take_groups(self) -> None:
        """Sum the groups one after the other, until the bake's `target_error`, if it has one, is reached."""
        target, texels = self._setup.inputs.options.target_error, self._side.texels
        slices, groups = chunks(len(texels), self._chunk_size), range(len(self._setup.groups))
        requests = [TexelRequest(group, rows) for group in groups for rows in slices]
        self._source.expect(requests)
        sampled = self._background.made_ahead(self._sample, requests)
        for group in groups:
            for request, (samples, points) in islice(sampled, len(slices)):
                sums = self._source.visibility_sums(points, request)
                self._halves[group % 2, request.rows] += sums
                self._background.do(self._fit, samples, sums, group)
            self._used[group % 2] += self._setup.directions_of(group)
            self._per_texel += self._setup.directions_of(group)
            if group % 2 or group == groups[-1]:
                self._estimate_error()
            if self._error is not None and target is not None and self._error <= target:
                break

    def interleave(self) -> None:
        """Sum one group at each texel; share the sums where visibility is smooth, sum all other groups elsewhere."""
        texels, setup = self._side.texels, self._setup
        groups = group_of_texels(texels)
        faces, own, normals = self._sum_own(groups)
        self._used = [sum(map(setup.directions_of, range(half, GROUPS, 2))) for half in range(2)]
        smooth = share_sums(texels, groups, own, normals, self._halves, smooth_change(2 * len(setup.axes)))
        own = own[~smooth]
        del normals  # these are large: not one is kept for longer than it is needed
        self._background.do(self._fit_shared, smooth, faces)
        del faces
        self._sum_others(~smooth, groups, own)
        if len(texels):
            self._per_texel = sum(self._used) * (1 - (1 - 1 / GROUPS) * float(smooth.mean()))
        self._estimate_error()

    def _sum_own(self, groups: NDArray[np.int8]) -> tuple[Int32Array, Float32Array, NDArray[np.float16]]:
        """Sum at each texel its own group, (k,); return the faces and the sums of the texels, and their normals."""
        texels = self._side.texels
        faces, own = np.full(len(texels), -1, np.int32), np.zeros_like(self._halves[0])
        normals = np.zeros((len(texels), 3), np.float16)

        def requests() -> Iterator[TexelRequest]:
            for group in range(GROUPS):
                for rows in self._chunks(groups == group):
                    yield TexelRequest(group, rows)

        def sample(request: TexelRequest) -> Samples:
            samples, points = self._sample(request)
            faces[request.rows] = samples.faces
            of_request = normals[request.rows]
            for part in chunks(len(points.faces), FIT_CHUNK):
                some = points.select(part)
                of_request[part] = self._side.surface.interpolate(some.faces, some.weights)[1]
            normals[request.rows] = of_request
            return points

        self._source.expect(requests())
        for request, points in self._background.made_ahead(sample, requests()):
            own[request.rows] = self._source.visibility_sums(points, request)
        return faces, own, normals

    def _sum_others(self, chosen: BoolArray, groups: NDArray[np.int8], own: Float32Array) -> None:
        """Sum at chosen texels, (k,) bool, the groups that they have not taken, and fit the image to all samples.

        groups   (k,) the group that each texel has taken
        own      (chosen texels, columns): the sums of that
        """
        own_of_chunks = [own[part] for part in chunks(len(own), self._chunk_size)]
        chosen_chunks = list(zip(self._chunks(chosen), own_of_chunks, strict=True))

        def sample(part: tuple[int, Int32Array, Float32Array]) -> tuple[Samples, Samples, BoolArray]:
            group, rows, _ = part
            samples, is_other = self._setup.texel_samples(self._side, rows, group), groups[rows] != group
            return samples, self._setup.measured(self._side, samples.select(is_other)), is_other

        parts = [(group, rows, own_sums) for group in range(GROUPS) for rows, own_sums in chosen_chunks]
        others = ((group, rows[groups[rows] != group]) for group, rows, _ in parts)
        self._source.expect(TexelRequest(group, rows) for group, rows in others if len(rows))
        for (group, rows, own_sums), (samples, points, is_other) in self._background.made_ahead(sample, parts):
            sums = own_sums.copy()
            if is_other.any():
                sums[is_other] = self._source.visibility_sums(points, TexelRequest(group, rows[is_other]))
            self._halves[group % 2, rows] += sums
            self._background.do(self._fit, samples, sums, group)

    def _fit_shared(self, smooth: BoolArray, faces: Int32Array) -> None:
        """Fit the image to the shared sums of smooth texels: they are of the middle of the samples of all groups.

        smooth, faces   (k,) bool and int32: of all texels
        """
        starts = [*np.flatnonzero(smooth)[::FIT_CHUNK].tolist(), len(smooth)]
        for start, stop in pairwise(starts):
            some = start + np.flatnonzero(smooth[start:stop])
            row, column = np.divmod(self._side.texels.index[some], self._side.texels.width)
            positions = (np.stack([column, row], axis=1) + MEAN_OFFSET).astype(np.float32)
            sums = self._halves[0, some] + self._halves[1, some]
            self._add(positions, faces[some], sums, sum(self._used), MEAN_OFFSET, means_of=GROUPS)

    def _chunks(self, chosen: BoolArray) -> list[Int32Array]:
        """Return the rows of chosen texels, (k,) bool, as many as are processed at a time."""
        rows = np.flatnonzero(chosen).astype(np.int32)
        return [rows[part] for part in chunks(len(rows), self._chunk_size)]

    def _sample(self, request: TexelRequest) -> tuple[Samples, Samples]:
        """Return the points of the textured mesh for the texels of a request, and those measured for them."""
        samples = self._setup.texel_samples(self._side, request.rows, request.group)
        return samples, self._setup.measured(self._side, samples)

    def _fit(self, samples: Samples, sums: Float32Array, group: int) -> None:
        """Fit the image to the sums of a group, (k, columns), at samples of the textured mesh."""
        for start in range(0, len(sums), FIT_CHUNK):
            rows = slice(start, start + FIT_CHUNK)
            some = samples.select(rows)
            positions = texel_positions(self._setup.inputs.atlas, self._side.texels, some)
            self._add(positions, some.faces, sums[rows], self._setup.directions_of(group), texel_offset(group))

    def _add(
        self,
        positions: Float32Array,
        faces: Int32Array,
        sums: Float32Array,
        directions: int,
        offset: tuple[float, float],
        means_of: int = 1,
    ) -> None:
        """Add samples with their sums over a number of directions to the image; see `LeastSquaresImage`."""
        integrand = self._setup.integrand
        values, measured = integrand.estimates(sums, directions)
        values[:, 0] = 1.0 - values[:, 0]
        # Weight each group as the estimator weights it in the total.
        total = sums[:, 1] if integrand.estimator == "ratio" else directions
        weights = np.where(measured, total * self._face_areas[faces], 0.0)
        self._image.add_samples(positions, values, weights, offset, means_of)

    def _estimate_error(self) -> None:
        self._error = sampling_error(
            self._halves, self._used, self._setup.integrand, self._setup.inputs.options.sampling
        )

    def result(self) -> TexelOcclusion:
        """Return the ambient occlusion of the texels; ends the gathering."""
        integrand, total = self._setup.integrand, self._halves[0]
        total += self._halves[1]
        found, measured = integrand.estimates(total, sum(self._used))
        values, vectors = np.clip(found[:, 0], 0.0, 1.0), found[:, 1:] if integrand.vectors else None
        return TexelOcclusion(
            texels=self._side.texels,
            values=values,
            measured=measured,
            reconstruction=self._image,
            directions=sum(self._used),
            per_texel=self._per_texel,
            error=self._error,
            vectors=vectors,
        )
