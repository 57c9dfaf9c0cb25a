"""Embree's C interface: the library that embreex carries, for packets of rays, which embreex itself does not cast.

The names and numbers are those of Embree 4, rtcore.h (I. Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray
Tracing", 2014).
"""

import ctypes
from functools import cache
from importlib import import_module, metadata
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import RendererError
from aoprecalc.types import Float32Array

_TRIANGLES = 0  # RTC_GEOMETRY_TYPE_TRIANGLE
_INDEX, _VERTEX = 0, 1  # RTC_BUFFER_TYPE
_UINT3, _FLOAT3 = 0x5003, 0x9003  # RTC_FORMAT
_HIGH_QUALITY = 2  # RTC_BUILD_QUALITY: a sixth less time for rays than medium (measured)
_COHERENT = 1 << 16  # RTC_RAY_QUERY_FLAG
_ALL_FEATURES = 0xFFFFFFFF  # RTC_FEATURE_FLAG
_POINTER, _UINT = ctypes.c_void_p, ctypes.c_uint
_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, ctypes.c_int]),
    "rtcSetSceneBuildQuality": (None, [_POINTER, ctypes.c_int]),
    "rtcSetSharedGeometryBuffer": (
        None,
        [_POINTER, ctypes.c_int, _UINT, ctypes.c_int, _POINTER, ctypes.c_size_t, ctypes.c_size_t, ctypes.c_size_t],
    ),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_UINT, [_POINTER, _POINTER]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcOccluded16": (None, [_POINTER] * 4),
}


@cache
def library() -> ctypes.CDLL | None:
    """Return Embree's library, or None where embreex carries none that has packets of 16 rays."""
    try:
        carried = metadata.files("embreex") or []
    except metadata.PackageNotFoundError:
        return None
    for file in carried:
        if "embree4" in file.name:
            try:
                found = ctypes.CDLL(str(file.locate()))
                for name, (result, arguments) in _SIGNATURES.items():
                    function = getattr(found, name)
                    function.restype, function.argtypes = result, arguments
            except (OSError, AttributeError):
                return None
            return found
    return None


@cache
def casts_packets() -> bool:
    """Tell whether packets of rays can be cast here: Embree and numba can be loaded."""
    try:
        import_module("numba")
    except (ImportError, OSError):
        return False
    return library() is not None


class OcclusionScene:
    """Triangles, ready to be hit by packets of rays.

    triangles    how many
    occluded16   the address of rtcOccluded16, for compiled code
    scene        the address of the scene
    """

    def __init__(self, corners: Float32Array) -> None:
        """Build over triangles, (o, 3, 3) float32 corners. Raises RendererError where Embree has no memory for them."""
        embree = library()
        if embree is None:
            raise RendererError("embreex carries no library of Embree 4; install it again: `pip install embreex`")
        self.triangles = len(corners)
        self.occluded16: int = ctypes.cast(embree.rtcOccluded16, _POINTER).value or 0
        # Embree reads both as long as the scene lives.
        self._vertices = np.ascontiguousarray(corners, np.float32).reshape(-1, 3)
        self._indices = np.arange(len(self._vertices), dtype=np.uint32).reshape(-1, 3)
        device = embree.rtcNewDevice(None)
        geometry = embree.rtcNewGeometry(device, _TRIANGLES)
        for kind, layout, values in ((_VERTEX, _FLOAT3, self._vertices), (_INDEX, _UINT3, self._indices)):
            embree.rtcSetSharedGeometryBuffer(geometry, kind, 0, layout, values.ctypes.data, 0, 12, len(values))
        embree.rtcCommitGeometry(geometry)
        self.scene = embree.rtcNewScene(device)
        finalize(self, _release, embree, self.scene, device)
        embree.rtcSetSceneBuildQuality(self.scene, _HIGH_QUALITY)
        embree.rtcAttachGeometry(self.scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(self.scene)
        error = embree.rtcGetDeviceError(device)
        if error:
            raise RendererError(f"Embree cannot build a scene of {len(corners)} triangles (error {error})")


def _release(embree: ctypes.CDLL, scene: int, device: int) -> None:
    embree.rtcReleaseScene(scene)
    embree.rtcReleaseDevice(device)


def occluded_arguments(*, coherent: bool) -> NDArray[np.uint64]:
    """Return RTCOccludedArguments; coherent packets have one direction, and origins near each other."""
    arguments = np.zeros(8, np.uint64)  # its pointers stay null
    arguments[:1].view(np.uint32)[:] = (_COHERENT if coherent else 0, _ALL_FEATURES)
    return arguments
