"""How many devices EGL knows of."""

import ctypes

from aoprecalc.gl.context import EGL_LIBRARY


def count_devices() -> int:
    """Return the number of EGL's devices; raises OSError where there is no EGL, or one that cannot tell.

    glcontext, which takes a device's number, does not say how many there are. See EGL_EXT_device_enumeration.
    """
    library = ctypes.CDLL(EGL_LIBRARY)
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        raise OSError(f"{EGL_LIBRARY} has no eglQueryDevicesEXT")
    # EGLBoolean eglQueryDevicesEXT(EGLint max_devices, EGLDeviceEXT *devices, EGLint *num_devices)
    kind = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))
    count = ctypes.c_int()
    if not kind(address)(0, None, ctypes.byref(count)):
        raise OSError(f"{EGL_LIBRARY} lists no devices")
    return count.value
