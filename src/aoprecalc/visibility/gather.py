"""Ambient occlusion of texels: visibility sums of one group of axes after the other, and the image fitted to them.

An axis is a pair of opposite light directions, given by one unit vector.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aoprecalc.background import Background
from aoprecalc.mesh.roles import in_poses
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples, area_per_texel, keep_faces, texel_positions
from aoprecalc.raster.resolve import LeastSquaresImage, ResolvedTexture
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Texels
from aoprecalc.visibility.backend import VisibilityTester
from aoprecalc.visibility.directions import texel_offset
from aoprecalc.visibility.instances import SharedInstances, mean_over_poses, turns_to_rest
from aoprecalc.visibility.integrand import sampling_error
from aoprecalc.visibility.interleaving import GROUPS, MEAN_OFFSET, group_of_texels, share_sums, smooth_change
from aoprecalc.visibility.plan import FIT_CHUNK, chunks
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide


@dataclass(frozen=True, eq=False)
class TexelRequest:
    """Texels whose visibility is asked for along one group of axes.

    group   of the axes, an index into the groups of the BakeSetup
    rows    which of the side's texels: a slice, or (k,) int32
    """

    group: int
    rows: slice | Int32Array


class VisibilitySource(Protocol):
    """Returns the visibility sums of one side's texels, computed in this process or elsewhere, with equal results."""

    def expect(self, requests: Iterable[TexelRequest]) -> None:
        """Be ready for these requests, which come in this order, unless the gather ends early."""
        ...

    def visibility_sums(self, samples: Samples, request: TexelRequest) -> Float32Array:
        """Return the sums of texels along one group of axes, (k, columns) float32; see VisibilityTester.

        samples   the measured points of these texels, at the texel offset of the group
        """
        ...


class LocalVisibility:
    """Computes visibility in this process, with the backend of the setup."""

    def __init__(
        self, setup: BakeSetup, side: SurfaceSide, shadow_size: int, chunk_size: int, progress: Progress
    ) -> None:
        """Prepare for up to `chunk_size` texels at a time; directions done are counted on `progress`."""
        self._make_tester = partial(
            setup.backend.tester,
            integrand=setup.integrand,
            max_samples=chunk_size,
            shadow_size=shadow_size,
            texels=len(side.texels),
        )
        self._only = self._make_tester(side.surface) if len(side.surfaces) == 1 else None
        self._instances = SharedInstances.from_scene(side.scene, vectors=setup.integrand.vectors)
        self._setup, self._side, self._progress = setup, side, progress
        turned = side.scene.poses and setup.integrand.vectors
        self._turns = turns_to_rest(side.scene, setup.inputs.normals) if turned else None

    def expect(self, requests: Iterable[TexelRequest]) -> None:
        """Do nothing: sums are computed when they are asked for."""

    def visibility_sums(self, samples: Samples, request: TexelRequest) -> Float32Array:
        """Return the sums of texels; see VisibilitySource. Several poses take the memory of one."""
        axes = self._setup.axes[self._setup.groups[request.group]]
        return mean_over_poses(self._sums_in_poses(samples, axes, request.group))

    def _sums_in_poses(self, samples: Samples, axes: Float64Array, group: int) -> Iterator[Float32Array]:
        """Yield the sums in each pose, their vectors turned to the rest pose."""
        for pose, surface in enumerate(self._side.surfaces):
            tester = self._only or self._make_tester(surface)
            if self._turns is not None:
                tester = _TurnedTester(tester, self._turns[pose])
            sums = self._instances.accumulate(tester, samples, axes, group, self._progress)
            del tester  # before the next one is made
            yield sums


@dataclass(frozen=True, eq=False)
class _TurnedTester:
    """A VisibilityTester in a pose, whose vectors are turned to the rest pose with the faces.

    turns   (f, 3, 3) float32: see `turns_to_rest`
    """

    tester: VisibilityTester
    turns: Float32Array

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the sums of the samples, see VisibilityTester."""
        sums = self.tester.accumulate(samples, axes, progress)
        sums[:, 2:] = np.einsum("kx,kxy->ky", sums[:, 2:], self.turns[samples.faces])
        return sums


def gather_one_direction(
    setup: BakeSetup, side: SurfaceSide, tester: VisibilityTester, direction: Float64Array, chunk_size: int
) -> ResolvedTexture:
    """Return the integrand of Précalcul's equation 1.1.1.1 for one direction w: max(0, n.w) [g.w > 0] visible(w).

    direction   (3,) float64, the unit vector w towards the light

    A tester adds up both directions of an axis. A point faces one of them, so only samples on faces that face w are
    tested; the others are in their own shadow, 0. Each texel has one sample, at its centre where the surface covers
    that. Of instances that share texels the first one counts.
    """
    texels = side.texels
    faces_light = side.surface.geometric_normals @ direction > 0
    values: Float32Array = np.zeros((texels.height, texels.width), np.float32)
    valid: BoolArray = np.zeros(values.shape, bool)
    for chunk in chunks(len(texels), chunk_size):
        samples, index = setup.samples(side, chunk, 0), texels.index[chunk]
        sums = tester.accumulate(keep_faces(samples, faces_light), direction[None], Progress())
        values.ravel()[index], valid.ravel()[index] = sums[:, 0], samples.faces >= 0
    return ResolvedTexture(values, valid, valid)


VisibilityFactory = Callable[[BakeSetup, SurfaceSide, int, int, Progress], VisibilitySource]  # see LocalVisibility


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
    with Background(inline=setup.backend.kind == "gl") as background:  # OpenGL belongs to one thread
        gathering = _Gathering(setup, side, source, chunk_size, background)
        if setup.interleaved:
            gathering.interleave()
        else:
            gathering.take_groups()
    return gathering.result()


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
        poses = in_poses(setup.inputs.scene, setup.inputs.normals)
        self._face_areas = np.mean([area_per_texel(pose, atlas, texels) for pose, _ in poses], axis=0)
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
            for _ in slices:
                request, (samples, points) = next(sampled)
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

        def others(group: int, rows: Int32Array) -> TexelRequest:
            return TexelRequest(group, rows[groups[rows] != group])

        def sample(part: tuple[int, Int32Array, Float32Array]) -> tuple[Samples, Samples]:
            group, rows, _ = part
            samples = self._setup.texel_samples(self._side, rows, group)
            return samples, self._setup.measured(self._side, samples.select(groups[rows] != group))

        parts = [(group, rows, own_sums) for group in range(GROUPS) for rows, own_sums in chosen_chunks]
        self._source.expect(others(group, rows) for group, rows, _ in parts if (groups[rows] != group).any())
        for (group, rows, own_sums), (samples, points) in self._background.made_ahead(sample, parts):
            sums, is_other = own_sums.copy(), groups[rows] != group
            if is_other.any():
                sums[is_other] = self._source.visibility_sums(points, others(group, rows))
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
