"""Bakes an open box and compares it with its closed form: `python -m aoprecalc.recipes.trial_child`.

A process of its own, as a broken driver may crash the one that uses it. The answer is one line of JSON on standard
output: what `trial` returns, or a fault where the bake fails.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.measure.form_factor import form_factor
from aoprecalc.measure.lookup import bilinear
from aoprecalc.measure.points import spread_points
from aoprecalc.model import Doubles, Part, Scene
from aoprecalc.options import Backend, BakeOptions
from aoprecalc.recipes.baking import bake_scene
from aoprecalc.surface.normals import face_directions

SIZE, DIRECTIONS, POINTS = 128, 1000, 2000
# Root mean square. Maps and rays both leave 0.0034, most of which is the number of directions.
MOST_ERROR = 0.01

# Unequal, so that no two axes can be taken for each other. It stands on its floor and has no lid.
_WIDTH, _DEPTH, _HEIGHT = 1.0, 0.8, 0.6


def trial(backend: Backend = "auto") -> dict[str, Any]:
    """Bake the inside of an open box, new UVs included, and measure it where a renderer would look it up.

    Every point of it sees nothing but walls, and the light that comes through the opening.
    Returns the backend and the renderer that were used, the RMS error, whether it is at most `allowed`, and seconds.
    Raises what `bake_scene` raises.
    """
    scene, opening = open_box()
    options = BakeOptions(SIZE, SIZE, directions=DIRECTIONS, normals="flat", backend=backend)
    started = time.perf_counter()
    baked = bake_scene(scene, options)
    seconds = time.perf_counter() - started
    points = spread_points(scene, baked.atlas.covers, POINTS, seed=0)
    normals = face_directions(scene.corners)[0][points.faces]
    expected = form_factor(points.at(scene.corners), normals, opening)
    found = bilinear(baked.texture.values, points.at(baked.atlas.uvs), repeats=baked.atlas.wraps)
    error = float(np.sqrt(((found - expected) ** 2).mean()))
    return {
        "backend": baked.backend,
        "renderer": baked.renderer,
        "error": round(error, 6),
        "allowed": MOST_ERROR,
        "passed": error <= MOST_ERROR,
        "seconds": round(seconds, 3),
    }


def open_box() -> tuple[Scene, Doubles]:
    """Return a box without a lid whose faces look inwards, and its opening, (4, 3), clockwise seen from inside."""
    corners = np.array([(0, 0), (_WIDTH, 0), (_WIDTH, _DEPTH), (0, _DEPTH)])
    floor, opening = (np.column_stack([corners, np.full(4, height)]) for height in (0, _HEIGHT))
    ring = np.arange(4)
    ahead = np.roll(ring, -1)
    quads = np.concatenate([ring[None], np.column_stack([ahead, ring, ring + 4, ahead + 4])])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    part = Part("open box", 0, len(faces), faces)
    return Scene(Path("self-test"), "obj", np.concatenate([floor, opening]), faces, None, (), (part,)), opening


def main() -> None:
    """Answer."""
    try:
        answer = trial()
    except AoprecalcError as error:
        answer = {"fault": str(error)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
