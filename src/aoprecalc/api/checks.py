"""What doctor checks in processes of their own, since a broken driver may crash or hang the one that uses it.

    python -m aoprecalc.api.checks egl 0 | osmesa | count | rays | self-test

The answer is one line of JSON on standard output:

count         devices: the number of EGL devices
egl, osmesa   renderer, vendor, version, software (runs on the processor), max_texture_size
rays          renderer, version, software
self-test     what `run_self_test` returns
any           fault, and nothing else, if it does not work
"""

import faulthandler
import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import AoprecalcError
from aoprecalc.gl.context import VERSION, Candidate, count_devices, is_software, make_context
from aoprecalc.mesh.surface import face_normals, sample_surface
from aoprecalc.options import Backend, BakeOptions
from aoprecalc.subprocesses import end_with_parent
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Float64Array, Part, Scene
from aoprecalc.visibility.rays import RayCaster, embreex_problem

_MAX_PROBE_SECONDS = 120  # after which a probe ends itself, where it does not end with its parent
# Explanations of glcontext's errors, by a part of their text; the first match counts.
_MEANINGS = {
    "libEGL": "EGL is not installed",
    "libGL": "libGL is not installed",
    "found 0 devices": "EGL has no driver",
    "eglInitialize": "its driver is missing or does not start",
    "eglCreateContext": f"it has no OpenGL {VERSION[0]}.{VERSION[1]}",
}

SIZE, POINTS = 128, 2000  # of the self-test
MAX_ERROR = 0.01  # RMS; depth maps and rays both leave 0.0034, mostly from the number of directions
_WIDTH, _DEPTH, _HEIGHT = 1.0, 0.8, 0.6  # of the box: unequal, so that mixed-up axes are noticed


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


# The self-test: an open box is baked and compared with its closed form.


def form_factor(points: Float64Array, normals: Float64Array, polygon: Float64Array) -> Float64Array:
    """Return the form factor of a flat polygon from points of a surface, (k,) float64 in [0, 1].

    It is the cosine-weighted share of the hemisphere that the polygon takes up: the ambient occlusion of a point that
    sees nothing but black around it.

    points    (k, 3) float64, none on the polygon's edges
    normals   (k, 3) float64 unit normals of the surface; no corner may lie below the surface's plane
    polygon   (c, 3) float64 corners, in order, clockwise seen from the points

    Lambert's formula: the sum over the edges of the angle under which each is seen, times the cosine between the
    surface's normal and that of the plane through the edge and the point, over 2 pi (J. H. Lambert, Photometria, 1760;
    D. Baum, H. Rushmeier, J. Winget, Improving Radiosity Solutions Through the Use of Analytically Determined
    Form-Factors, SIGGRAPH 1989). For a rectangle that is parallel or perpendicular to the surface it agrees with the
    expressions in section B of J. R. Howell's Catalog of Radiation Heat Transfer Configuration Factors.
    """
    start = polygon - points[:, None]
    end = np.roll(start, -1, axis=1)
    cross = np.cross(start, end)
    length = np.linalg.norm(cross, axis=2)
    angle = np.arctan2(length, np.einsum("kcx,kcx->kc", start, end))
    cosine = np.einsum("kcx,kx->kc", cross, normals) / np.where(length > 0, length, 1)
    factors: Float64Array = (angle * cosine).sum(axis=1) / (2 * np.pi)
    return factors


def run_self_test(backend: Backend = "auto") -> dict[str, Any]:
    """Bake the inside of an open box, new UVs included, and measure it at surface points as a renderer would.

    A point of it sees walls, and light through the opening. Returns the fields of `doctor.SelfTestResult`.
    Raises what `bake_scene` raises.
    """
    scene, opening = open_box()
    options = BakeOptions(size=SIZE, normals="flat", backend=backend)
    started = time.perf_counter()
    baked = bake_scene(scene, options)
    seconds = time.perf_counter() - started
    points = sample_surface(scene, baked.atlas.mapped, POINTS, seed=0)
    normals = face_normals(scene.corners)[0][points.faces]
    expected = form_factor(points.interpolate(scene.corners), normals, opening)
    values = bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs), repeats=baked.atlas.repeats)
    error = float(np.sqrt(((values - expected) ** 2).mean()))
    return {
        "backend": baked.backend,
        "renderer": baked.renderer,
        "error": round(error, 6),
        "allowed": MAX_ERROR,
        "passed": error <= MAX_ERROR,
        "seconds": round(seconds, 3),
    }


def open_box() -> tuple[Scene, Float64Array]:
    """Return a box without a lid whose faces point inwards, and its opening, (4, 3), clockwise seen from inside."""
    corners = np.array([(0, 0), (_WIDTH, 0), (_WIDTH, _DEPTH), (0, _DEPTH)])
    floor, opening = (np.column_stack([corners, np.full(4, height)]) for height in (0, _HEIGHT))
    ring = np.arange(4)
    ahead = np.roll(ring, -1)
    quads = np.concatenate([ring[None], np.column_stack([ahead, ring, ring + 4, ahead + 4])])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    part = Part("open box", 0, len(faces), faces)
    return Scene(Path("self-test"), "obj", np.concatenate([floor, opening]), faces, None, (), (part,)), opening


def main(request: list[str]) -> None:
    """Answer a request of the command line."""
    end_with_parent()
    if request == ["self-test"]:
        try:
            answer = run_self_test()
        except AoprecalcError as error:
            answer = {"fault": str(error)}
    else:
        faulthandler.dump_traceback_later(_MAX_PROBE_SECONDS, exit=True)
        answer = probe(request)
    print(json.dumps(answer))


if __name__ == "__main__":
    main(sys.argv[1:])
