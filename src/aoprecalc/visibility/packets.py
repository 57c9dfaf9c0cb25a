"""Packets of 16 rays, in compiled code: whether they hit anything, and visibility sums.

For the sums a packet holds one direction for 16 samples that follow each other, which lie side by side on the surface,
and Embree follows the 16 rays together. Where triangles are smaller than the distance between samples, such rays soon
part; then a packet holds 16 directions of one sample.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from aoprecalc.progress import Progress
from aoprecalc.types import BoolArray, Float32Array, Float64Array
from aoprecalc.visibility.embree import OcclusionScene, occluded_arguments

FloatArray = NDArray[np.floating]
_Function = TypeVar("_Function", bound=Callable[..., Any])

_LANES = 16  # rays of a packet
# Of a thread; multiples of _LANES, so that packets do not depend on threads.
_SAMPLES_PER_TASK, _RAYS_PER_TASK = 1 << 14, 1 << 18
_SAMPLES_PER_TRIANGLE = 4.0  # from which packets of samples are faster than packets of directions (measured)

# The rows of RTCRay16 that are used, and one more: which lanes are valid.
_ORIGIN, _DIRECTION, _REACH, _MASK, _VALID, _ROWS = 0, 4, 8, 9, 12, 13
_HIT = -1.0  # the reach of a ray that has hit something, as Embree leaves it
_ALIGNMENT = 64  # bytes


class Receivers(NamedTuple):
    """Samples that receive light.

    origins      (k, 3) float32: where their rays start
    shading      (k, 3) float64: n
    geometric    (k, 3) float64: g
    in_ground    (k,) bool: below the ground plane, in the dark
    """

    origins: Float32Array
    shading: Float64Array
    geometric: Float64Array
    in_ground: BoolArray


class Lights(NamedTuple):
    """Both directions of axes, and what light counts for.

    axes         (a, 3) float64 unit vectors
    radiance     (a, 2) float64, from their positive and negative ends
    cosine       whether the weight of a direction is the cosine with the shading normal; else it is 1
    min_cosine   of directions that count
    reach        the distance up to which occluders count
    up           (1, 3) float64, the unit vector away from the ground plane; 0 without one
    ground       its height along that
    """

    axes: Float64Array
    radiance: Float64Array
    cosine: bool
    min_cosine: float
    reach: float
    up: Float64Array
    ground: float


def visibility_sums(
    scene: OcclusionScene, receivers: Receivers, lights: Lights, columns: int, threads: int, progress: Progress
) -> Float32Array:
    """Return the visibility sums of k samples, (k, columns) float32, see VisibilityTester; `threads` cast rays."""
    count = len(receivers.origins)
    of_samples = count >= _SAMPLES_PER_TRIANGLE * scene.triangles
    sums = np.zeros((count, columns), np.float32)
    embree = _Embree(scene.occluded16, scene.scene, occluded_arguments(coherent=of_samples))

    def add_from(start: int) -> None:
        stop = min(start + _SAMPLES_PER_TASK, count)
        _add_visibility(embree, receivers, lights, sums, start, stop, of_samples)

    starts, done, total = range(0, count, _SAMPLES_PER_TASK), 0, 2 * len(lights.axes)
    with ThreadPoolExecutor(threads) as pool:
        for number, _ in enumerate(pool.map(add_from, starts), 1):
            before, done = done, total * number // len(starts)
            progress.advance(done - before)
    progress.advance(total - done)
    return sums


def occluded(
    scene: OcclusionScene, origins: Float32Array, directions: Float32Array, reach: float, threads: int
) -> BoolArray:
    """Return which of k rays hit a triangle within `reach`, (k,) bool.

    origins      (k, 3) float32
    directions   (k, 3) float32, or (1, 3) for parallel rays
    """
    count, hits = len(origins), np.empty(len(origins), bool)
    embree = _Embree(scene.occluded16, scene.scene, occluded_arguments(coherent=len(directions) == 1))

    def cast_from(start: int) -> None:
        _cast_each(embree, origins, directions, reach, hits, start, min(start + _RAYS_PER_TASK, count))

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(cast_from, range(0, count, _RAYS_PER_TASK)))
    return hits


# Compiled code.


class _Embree(NamedTuple):
    """Addresses for compiled code."""

    occluded16: int
    scene: int
    arguments: NDArray[np.uint64]


def _compiled(function: _Function) -> _Function:
    """Compile a function to machine code when it is first called, to run without the interpreter's lock.

    The code is kept for later processes beside this file or in the user's cache, where one of them can be written.
    """
    try:
        return cast(_Function, njit(nogil=True, cache=True)(function))
    except RuntimeError:
        return cast(_Function, njit(nogil=True)(function))


def _inlined(function: _Function) -> _Function:
    """Compile a function as a part of those that call it: to pass arrays would take longer than what it does."""
    return cast(_Function, njit(nogil=True, inline="always")(function))


def _occluded16(typing: Any, address: Any, valid: Any, scene: Any, rays: Any, arguments: Any) -> Any:
    """Call the function at an address, rtcOccluded16, with its arguments, all of them addresses."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function = ir.FunctionType(ir.VoidType(), [values[0].type] * 4)
        builder.call(builder.inttoptr(values[0], function.as_pointer()), values[1:])
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), generate


_call_occluded16: Any = intrinsic(_occluded16)


@_compiled
def _packet() -> Float32Array:
    """Return a packet, (_ROWS, _LANES) float32, with the parts that all packets share."""
    memory = np.zeros(_ROWS * _LANES + _ALIGNMENT // 4, np.float32)
    start = (-memory.ctypes.data % _ALIGNMENT) // 4
    packet = memory[start : start + _ROWS * _LANES].reshape(_ROWS, _LANES)
    packet[_MASK].view(np.uint32)[:] = 0xFFFFFFFF
    return packet


@_inlined
def _dot(vectors: FloatArray, row: int, x: float, y: float, z: float) -> float:
    """Return the scalar product of a row of (n, 3) vectors with another vector."""
    product: float = vectors[row, 0] * x + vectors[row, 1] * y + vectors[row, 2] * z
    return product


@_inlined
def _aim(packet: Float32Array, lane: int, receivers: Receivers, sample: int, lights: Lights, axis: int) -> float:
    """Aim a ray from a sample to the end of an axis that it faces; return the weight of that end, signed as the end.

    The ray is not cast where the ground or the weight decide; its reach is as Embree leaves it.
    """
    x, y, z = lights.axes[axis, 0], lights.axes[axis, 1], lights.axes[axis, 2]
    towards = _dot(receivers.geometric, sample, x, y, z)
    sign = 1.0 if towards > 0.0 else -1.0
    cosine = sign * _dot(receivers.shading, sample, x, y, z)
    weight = 0.0
    if towards != 0.0 and cosine > 0.0 and cosine >= lights.min_cosine:
        weight = lights.radiance[axis, 0 if sign > 0.0 else 1] * (cosine if lights.cosine else 1.0)
    stopped = receivers.in_ground[sample]
    slope = sign * _dot(lights.up, 0, x, y, z)
    if slope < 0.0:
        origins = receivers.origins
        height = _dot(lights.up, 0, origins[sample, 0], origins[sample, 1], origins[sample, 2]) - lights.ground
        stopped = stopped or max(height, 0.0) < -slope * lights.reach
    for dimension in range(3):
        packet[_ORIGIN + dimension, lane] = receivers.origins[sample, dimension]
        packet[_DIRECTION + dimension, lane] = sign * lights.axes[axis, dimension]
    packet[_REACH, lane] = _HIT if stopped else lights.reach
    return sign * weight


@_compiled
def _cast_each(
    embree: _Embree,
    origins: Float32Array,
    directions: Float32Array,
    reach: float,
    hits: BoolArray,
    start: int,
    stop: int,
) -> None:
    """Store whether rays start .. stop - 1 hit anything; one direction counts for all."""
    packet = _packet()
    valid = packet[_VALID].view(np.int32)
    parallel = len(directions) == 1
    for first in range(start, stop, _LANES):
        used = min(_LANES, stop - first)
        valid[:] = 0
        for lane in range(used):
            ray = first + lane
            for dimension in range(3):
                packet[_ORIGIN + dimension, lane] = origins[ray, dimension]
                packet[_DIRECTION + dimension, lane] = directions[0 if parallel else ray, dimension]
            packet[_REACH, lane], valid[lane] = reach, -1
        _call_occluded16(
            embree.occluded16, valid.ctypes.data, embree.scene, packet.ctypes.data, embree.arguments.ctypes.data
        )
        for lane in range(used):
            hits[first + lane] = packet[_REACH, lane] < 0.0


@_compiled
def _add_visibility(
    embree: _Embree,
    receivers: Receivers,
    lights: Lights,
    sums: Float32Array,
    start: int,
    stop: int,
    of_samples: bool,
) -> None:
    """Store the visibility sums of samples start .. stop - 1, by packets of samples or of directions."""
    packet = _packet()
    rays, valid = packet.ctypes.data, packet[_VALID].view(np.int32)
    weights, totals = np.zeros(_LANES), np.zeros((_LANES, sums.shape[1]))
    samples_each, axes_each = (_LANES, 1) if of_samples else (1, _LANES)
    for first in range(start, stop, samples_each):
        totals[:] = 0.0
        for first_axis in range(0, len(lights.axes), axes_each):
            used = min(samples_each, stop - first) if of_samples else min(axes_each, len(lights.axes) - first_axis)
            any_ray = False
            valid[:] = 0
            for lane in range(used):
                sample, axis = (first + lane, first_axis) if of_samples else (first, first_axis + lane)
                weights[lane] = _aim(packet, lane, receivers, sample, lights, axis)
                if weights[lane] != 0.0 and packet[_REACH, lane] >= 0.0:
                    valid[lane], any_ray = -1, True
            if any_ray:
                _call_occluded16(embree.occluded16, valid.ctypes.data, embree.scene, rays, embree.arguments.ctypes.data)
            for lane in range(used):
                number, axis = (lane, first_axis) if of_samples else (0, first_axis + lane)
                visible = weights[lane] if packet[_REACH, lane] >= 0.0 else 0.0
                totals[number, 0] += abs(visible)
                totals[number, 1] += abs(weights[lane])
                for column in range(2, sums.shape[1]):
                    totals[number, column] += visible * lights.axes[axis, column - 2]
        for number in range(min(samples_each, stop - first)):
            for column in range(sums.shape[1]):
                sums[first + number, column] = totals[number, column]
