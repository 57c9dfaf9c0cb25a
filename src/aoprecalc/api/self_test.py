"""Self-test: bakes an open box and compares it with its closed form, `python -m aoprecalc.api.self_test`.

It runs in a process of its own, as a broken driver may crash the one that uses it. It prints one line of JSON: what
`run_self_test` returns, or a `fault` where the bake fails.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import AoprecalcError
from aoprecalc.mesh.normals import face_normals
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import Backend, BakeOptions
from aoprecalc.subprocesses import end_with_parent
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Float64Array, Part, Scene

SIZE, DIRECTIONS, POINTS = 128, 1000, 2000
MAX_ERROR = 0.01  # RMS; depth maps and rays both leave 0.0034, mostly from the number of directions

_WIDTH, _DEPTH, _HEIGHT = 1.0, 0.8, 0.6  # of the box: unequal, so that mixed-up axes are noticed


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
    options = BakeOptions(size=SIZE, directions=DIRECTIONS, normals="flat", backend=backend)
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


def main() -> None:
    """Run the test and print its result."""
    end_with_parent()
    try:
        answer = run_self_test()
    except AoprecalcError as error:
        answer = {"fault": str(error)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
