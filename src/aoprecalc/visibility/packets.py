"""Packets of 16 rays, in compiled code: whether they hit anything, and visibility sums.

For the sums a packet holds one direction for 16 samples that follow each other, which lie side by side on the surface,
and Embree follows the 16 rays together. Where triangles are smaller than the distance between samples, such rays soon
part; then a packet holds 16 directions of one sample.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from aoprecalc.progress import Progress
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.visibility.embree import OcclusionScene, occluded_arguments

FloatArray = NDArray[np.floating]
_Function = TypeVar("_Function", bound=Callable[..., Any])

_LANES = 16  # rays of a packet
# Of a thread; multiples of _LANES, so that packets do not depend on threads.
_SAMPLES_PER_TASK, _RAYS_PER_TASK = 1 << 14, 1 << 18
_TEXELS_PER_TRIANGLE = 2.0  # from which packets of samples are faster than packets of directions (measured)

# Where the rows of _LANES values begin in a packet, which is an RTCRay16, and one more row: which lanes are valid.
_ORIGIN, _DIRECTION, _REACH, _MASK, _VALID, _END = (row * _LANES for row in (0, 4, 8, 9, 12, 13))
# And in `lanes`, (_ALL,) float64: a sample, an axis, the weight of its end that the sample faces, up to five totals.
_GEOMETRIC, _SHADING, _HEIGHT, _AXIS, _RADIANCE, _WEIGHT, _TOTALS = (row * _LANES for row in (0, 3, 6, 7, 10, 12, 13))
_ALL = _TOTALS + 5 * _LANES
_IN_GROUND = -1.0  # the height of samples below the ground
_HIT = -1.0  # the reach of a ray that has hit something, as Embree leaves it
_ALIGNMENT = 64  # bytes


class Receivers(NamedTuple):
    """Points of a surface that receive light: see `Samples` and `NormalizedSurface`.

    faces, weights   (k,) int32 and (k, 3) float32
    corners          (f, 3) int32: of all faces, indices of the positions
    positions        (v, 3) float32
    shading          (f, 3, 3) float32: n at the corners
    geometric        (f, 3) float32: g
    offset           along g, of where rays start
    """

    faces: Int32Array
    weights: Float32Array
    corners: Int32Array
    positions: Float32Array
    shading: Float32Array
    geometric: Float32Array
    offset: float


class Lights(NamedTuple):
    """Both directions of axes, and what light counts for.

    axes         (a, 3) float64 unit vectors
    radiance     (a, 2) float64, from their positive and negative ends
    cosine       whether the weight of a direction is the cosine with the shading normal; else it is 1
    min_cosine   of directions that count
    reach        the distance up to which occluders count
    up           (3,) float64, the unit vector away from the ground plane; 0 without one
    ground       its height along that
    deepest      height above the ground, at most 0, below which there is no light
    """

    axes: Float64Array
    radiance: Float64Array
    cosine: bool
    min_cosine: float
    reach: float
    up: Float64Array
    ground: float
    deepest: float


def visibility_sums(
    scene: OcclusionScene,
    receivers: Receivers,
    lights: Lights,
    columns: int,
    texels: int,
    threads: int,
    progress: Progress,
) -> Float32Array:
    """Return the visibility sums of k samples, (k, columns) float32, see VisibilityTester.

    texels      see `Backend.tester`; it decides what packets hold, so that no bit depends on how samples are split
    threads     that cast rays
    """
    of_samples = texels >= _TEXELS_PER_TRIANGLE * scene.triangles
    count = len(receivers.faces)
    sums = np.zeros((count, columns), np.float32)
    embree = _Embree(scene.occluded16, scene.scene, occluded_arguments(coherent=of_samples))

    def add_from(start: int) -> None:
        part = slice(start, start + _SAMPLES_PER_TASK)
        some = receivers._replace(faces=receivers.faces[part], weights=receivers.weights[part])
        _add_visibility(embree, some, lights, sums[part], of_samples)

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
    """Return a packet, (_END,) float32, with the parts that all packets share."""
    memory = np.zeros(_END + _ALIGNMENT // 4, np.float32)
    start = (-memory.ctypes.data % _ALIGNMENT) // 4
    packet = memory[start : start + _END]
    packet[_MASK : _MASK + _LANES].view(np.uint32)[:] = 0xFFFFFFFF
    return packet


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
    valid = packet[_VALID:].view(np.int32)
    parallel = len(directions) == 1
    for first in range(start, stop, _LANES):
        used = min(_LANES, stop - first)
        valid[:] = 0
        for lane in range(used):
            ray = first + lane
            for dimension in range(3):
                packet[_ORIGIN + dimension * _LANES + lane] = origins[ray, dimension]
                packet[_DIRECTION + dimension * _LANES + lane] = directions[0 if parallel else ray, dimension]
            packet[_REACH + lane], valid[lane] = reach, -1
        _call_occluded16(
            embree.occluded16, valid.ctypes.data, embree.scene, packet.ctypes.data, embree.arguments.ctypes.data
        )
        for lane in range(used):
            hits[first + lane] = packet[_REACH + lane] < 0.0


@_compiled
def _add_visibility(
    embree: _Embree,
    receivers: Receivers,
    lights: Lights,
    sums: Float32Array,
    of_samples: bool,
) -> None:
    """Store the visibility sums of samples, by packets of samples or of directions."""
    packet, lanes, columns = _packet(), np.zeros(_ALL), sums.shape[1]
    rays, valid = packet.ctypes.data, packet[_VALID:].ctypes.data
    sample_step, axis_step = (1, 0) if of_samples else (0, 1)
    for first in range(0, len(sums), _LANES if of_samples else 1):
        samples = min(_LANES, len(sums) - first) if of_samples else _LANES
        lanes[_TOTALS:] = 0.0
        _take_samples(packet, lanes, receivers, lights, first, sample_step, samples)
        for first_axis in range(0, len(lights.axes), 1 if of_samples else _LANES):
            axes = _LANES if of_samples else min(_LANES, len(lights.axes) - first_axis)
            _take_axes(lanes, lights, first_axis, axis_step, axes)
            if _aim(packet, lanes, lights):
                _call_occluded16(embree.occluded16, valid, embree.scene, rays, embree.arguments.ctypes.data)
            _add_weights(packet, lanes, columns)
        for column in range(columns):
            totals = lanes[_TOTALS + column * _LANES : _TOTALS + (column + 1) * _LANES]
            if of_samples:
                sums[first : first + samples, column] = totals[:samples]
            else:
                sums[first, column] = totals.sum()


@_inlined
def _take_samples(
    packet: Float32Array, lanes: Float64Array, receivers: Receivers, lights: Lights, first: int, step: int, count: int
) -> None:
    """Put samples in the lanes of a packet: `first` in all (step 0), or `count` samples from `first` on (step 1)."""
    taken = count if step else 1
    for lane in range(taken):
        _take_sample(packet, lanes, receivers, first + lane, lane)
    used = 1.0 - step
    for lane in range(taken, _LANES):
        for row in range(3):
            at = row * _LANES
            packet[_ORIGIN + at + lane] = packet[_ORIGIN + at]
            lanes[_GEOMETRIC + at + lane] = used * lanes[_GEOMETRIC + at]  # 0 faces no end of an axis
            lanes[_SHADING + at + lane] = used * lanes[_SHADING + at]
    up_x, up_y, up_z = lights.up[0], lights.up[1], lights.up[2]
    for lane in range(_LANES):
        x, y, z = packet[_ORIGIN + lane], packet[_ORIGIN + _LANES + lane], packet[_ORIGIN + 2 * _LANES + lane]
        height = up_x * x + up_y * y + up_z * z - lights.ground
        lanes[_HEIGHT + lane] = _IN_GROUND if height < lights.deepest else max(height, 0.0)


@_inlined
def _take_sample(packet: Float32Array, lanes: Float64Array, receivers: Receivers, sample: int, lane: int) -> None:
    """Put a sample in a lane: where its rays start, g and n; these are 0 where it is on no face."""
    face = receivers.faces[sample]
    shading_length = towards = 0.0
    for dimension in range(3):
        at = dimension * _LANES + lane
        position = shading = geometric = 0.0
        if face >= 0:
            geometric = np.float64(receivers.geometric[face, dimension])
            for corner in range(3):
                weight = np.float64(receivers.weights[sample, corner])
                position += weight * receivers.positions[receivers.corners[face, corner], dimension]
                shading += weight * receivers.shading[face, corner, dimension]
        packet[_ORIGIN + at] = position + receivers.offset * geometric
        lanes[_GEOMETRIC + at], lanes[_SHADING + at] = geometric, shading
        towards += shading * geometric
        shading_length += shading * shading
    for dimension in range(3):
        at = dimension * _LANES + lane
        if towards > 0.0:
            lanes[_SHADING + at] /= math.sqrt(shading_length)
        else:
            lanes[_SHADING + at] = lanes[_GEOMETRIC + at]


@_inlined
def _take_axes(lanes: Float64Array, lights: Lights, first: int, step: int, count: int) -> None:
    """Put axes in the first `count` lanes of a packet: one in all (step 0), or those that follow it (step 1)."""
    for lane in range(_LANES):
        axis, used = (first + step * lane, 1.0) if lane < count else (first, 0.0)
        for dimension in range(3):
            lanes[_AXIS + dimension * _LANES + lane] = used * lights.axes[axis, dimension]
        for end in range(2):
            lanes[_RADIANCE + end * _LANES + lane] = lights.radiance[axis, end]


@_inlined
def _dot(lanes: Float64Array, at: int, x: float, y: float, z: float) -> float:
    """Return the scalar product of the vector in one lane, whose first component is at an index, with another one."""
    product: float = lanes[at] * x + lanes[at + _LANES] * y + lanes[at + 2 * _LANES] * z
    return product


@_inlined
def _aim(packet: Float32Array, lanes: Float64Array, lights: Lights) -> bool:
    """Aim a ray in each lane to that end of its axis which its sample faces; tell whether any has to be cast.

    Stores the weight of that end, signed as the end. A ray is not cast where the ground or the weight decide; its reach
    is then as Embree leaves it. There are no branches, so that the compiler makes vector instructions of the loop.
    """
    valid, any_ray = packet.view(np.int32), 0
    cosine_counts, min_cosine, reach = lights.cosine, lights.min_cosine, lights.reach
    up_x, up_y, up_z = lights.up[0], lights.up[1], lights.up[2]
    for lane in range(_LANES):
        x, y, z = lanes[_AXIS + lane], lanes[_AXIS + _LANES + lane], lanes[_AXIS + 2 * _LANES + lane]
        towards = _dot(lanes, _GEOMETRIC + lane, x, y, z)
        sign = 1.0 if towards > 0.0 else -1.0
        cosine = sign * _dot(lanes, _SHADING + lane, x, y, z)
        positive, negative = lanes[_RADIANCE + lane], lanes[_RADIANCE + _LANES + lane]
        radiance = positive if towards > 0.0 else negative
        counts = (towards != 0.0) & (cosine > 0.0) & (cosine >= min_cosine)
        weight = radiance * (cosine if cosine_counts else 1.0)
        weight = weight if counts else 0.0
        slope, height = sign * (up_x * x + up_y * y + up_z * z), lanes[_HEIGHT + lane]
        stopped = (height < 0.0) | ((slope < 0.0) & (height < -slope * reach))
        is_ray = (weight != 0.0) & (not stopped)
        lanes[_WEIGHT + lane] = sign * weight
        packet[_DIRECTION + lane] = sign * x
        packet[_DIRECTION + _LANES + lane] = sign * y
        packet[_DIRECTION + 2 * _LANES + lane] = sign * z
        packet[_REACH + lane] = _HIT if stopped else reach
        valid[_VALID + lane] = -1 if is_ray else 0
        any_ray |= is_ray
    return any_ray != 0


@_inlined
def _add_weights(packet: Float32Array, lanes: Float64Array, columns: int) -> None:
    """Add what the lanes of a packet see to their totals; _WEIGHT then holds the weights of the visible ends."""
    for lane in range(_LANES):
        weight = lanes[_WEIGHT + lane]
        visible = weight if packet[_REACH + lane] >= 0.0 else 0.0
        lanes[_TOTALS + lane] += abs(visible)
        lanes[_TOTALS + _LANES + lane] += abs(weight)
        lanes[_WEIGHT + lane] = visible
    for column in range(2, columns):
        for lane in range(_LANES):
            component = lanes[_AXIS + (column - 2) * _LANES + lane]
            lanes[_TOTALS + column * _LANES + lane] += lanes[_WEIGHT + lane] * component
