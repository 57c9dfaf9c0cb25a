"""Casts a ray in a process of its own: `python -m aoprecalc.rays.probe_child`.

The answer is one line of JSON on standard output: renderer, version (of embreex) and software as
OpenGL's probe has them, or a fault where rays cannot be cast.
"""

import json
from importlib.metadata import version
from typing import Any

import numpy as np

from aoprecalc.rays.occluders import Occluders, obstacle


def probe() -> dict[str, Any]:
    """Cast one ray at a triangle and one beside it."""
    fault = obstacle()
    if fault is not None:
        return {"fault": fault}
    triangle = np.array([[(-1, -1, 0), (1, -1, 0), (0, 1, 0)]], np.float32)
    origins = np.array([(0, 0, -1), (9, 0, -1)], np.float32)
    hidden = Occluders(triangle, threads=1).hidden(origins, np.array([(0, 0, 1)], np.float32))
    if hidden.tolist() != [True, False]:
        return {"fault": "embreex does not find a triangle where there is one; install it again"}
    return {"renderer": "Embree", "version": version("embreex"), "software": True}


if __name__ == "__main__":
    print(json.dumps(probe()))
