"""Probe one renderer in its own process: `python -m aoprecalc.api.probe egl 0`, `osmesa`, `count` or `rays`.

A broken driver may crash or hang this process, but not its parent. The answer is one line of JSON on standard output:

count         devices: the number of EGL devices
egl, osmesa   renderer, vendor, version, software (runs on the processor), max_texture_size
rays          renderer, version, software
any           fault, and nothing else, if it does not work
"""

import faulthandler
import json
import sys
from importlib.metadata import version
from typing import Any

import numpy as np

from aoprecalc.gl.context import VERSION, Candidate, count_devices, make_context
from aoprecalc.subprocesses import end_with_parent
from aoprecalc.visibility.rays import RayCaster, embreex_problem

_MAX_SECONDS = 120  # after which the process ends itself, where it does not end with its parent
# Explanations of glcontext's errors, by a part of their text; the first match counts.
_MEANINGS = {
    "libEGL": "EGL is not installed",
    "libGL": "libGL is not installed",
    "found 0 devices": "EGL has no driver",
    "eglInitialize": "its driver is missing or does not start",
    "eglCreateContext": f"it has no OpenGL {VERSION[0]}.{VERSION[1]}",
}
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software", "swiftshader", "swr")  # in GL_RENDERER, in small letters


def probe(request: list[str]) -> dict[str, Any]:
    """Answer a request such as ["egl", "0"]."""
    if request == ["rays"]:
        return probe_rays()
    try:
        if request == ["count"]:
            return {"devices": count_devices()}
        return _describe(Candidate(request[0], int(request[1]) if len(request) > 1 else None))
    except Exception as error:  # glcontext raises bare Exception for all its reasons
        return {"fault": explain(" ".join(str(error).split()))}


def explain(reason: str) -> str:
    """Return a reason with its explanation before it, if there is one."""
    meaning = next((meaning for word, meaning in _MEANINGS.items() if word in reason), None)
    return f"{meaning} ({reason})" if meaning else reason


def is_software(renderer: str) -> bool:
    """Tell from GL_RENDERER whether a renderer runs on the processor."""
    return any(name in renderer.lower() for name in _SOFTWARE)


def _describe(candidate: Candidate) -> dict[str, Any]:
    context = make_context(candidate)
    info = context.info
    context.release()
    return {
        "renderer": info["GL_RENDERER"],
        "vendor": info["GL_VENDOR"],
        "version": info["GL_VERSION"],
        "software": is_software(info["GL_RENDERER"]),
        "max_texture_size": info["GL_MAX_TEXTURE_SIZE"],
    }


def probe_rays() -> dict[str, Any]:
    """Trace one ray that hits a triangle and one that misses it."""
    fault = embreex_problem()
    if fault is not None:
        return {"fault": fault}
    triangle = np.array([[(-1, -1, 0), (1, -1, 0), (0, 1, 0)]], np.float32)
    origins = np.array([(0, 0, -1), (9, 0, -1)], np.float32)
    hidden = RayCaster(triangle, threads=1).occluded(origins, np.array([(0, 0, 1)], np.float32))
    if hidden.tolist() != [True, False]:
        return {"fault": "embreex does not hit a triangle that is in the way of the ray; install it again"}
    return {"renderer": "Embree", "version": version("embreex"), "software": True}


if __name__ == "__main__":
    end_with_parent()
    faulthandler.dump_traceback_later(_MAX_SECONDS, exit=True)
    print(json.dumps(probe(sys.argv[1:])))
