"""Simplify a mesh in a process of its own: `python -m aoprecalc.render.simplification < request.npz > answer.npz`.

By quadric error metrics (Garland and Heckbert 1997) as opengl_decimate by Mike C. Fletcher does it: vertices that
differ in normal, UV or material at one position stay different, so that seams and hard edges survive. That library is
young and compiled, and around a vertex of n triangles it takes n^2 steps, so the parent must be able to go on without
it. The protocol is that of `subprocesses.ask`.

request: `max_triangles`, `triangles` (t, 3) int32, and attributes of the n vertices by their names in glTF, (n, c) each
answer:  `triangles` and the attributes of those that are left
"""

import io
import sys
import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import face_normals
from aoprecalc.subprocesses import ChildTimeoutError, ask, command, end_with_parent
from aoprecalc.types import Int32Array

_LIBRARY = "opengl_decimate"
_SECONDS = 120.0  # that it may take; a mesh of 5,000,000 triangles needs half of them
_MAX_EXCESS = 3  # how many times more triangles than asked for there may be
_MIN_TRIANGLE_QUALITY = 0.01  # 1: equilateral
_MAX_NORMAL_ANGLE = 75  # degrees, of a vertex from its triangle
_CHILD = command("aoprecalc.render.simplification")

Attributes = dict[str, NDArray[Any]]  # by their names in glTF


class NotSimplifiedError(Exception):
    """A mesh cannot be simplified as far as asked for; the text says why."""


def simplified(attributes: Attributes, triangles: Int32Array, max_triangles: int) -> tuple[Attributes, Int32Array]:
    """Simplify a mesh to `max_triangles`; up to three times as many are left where pieces and holes need them.

    Vertices stay where they were, so that their UVs stay true. Raises NotSimplifiedError.
    """
    if find_spec(_LIBRARY) is None:
        raise NotSimplifiedError(f"{_LIBRARY}, which simplifies meshes for the 3D view, is not installed")
    request = _to_npz({**attributes, "triangles": triangles, "max_triangles": np.array(max_triangles)})
    try:
        answer = _from_npz(ask(_CHILD, request, timeout=_SECONDS))
    except ChildTimeoutError as error:
        raise NotSimplifiedError(f"{_LIBRARY} has not simplified the mesh within {_SECONDS:g} s") from error
    except OSError as error:
        raise NotSimplifiedError(f"{_LIBRARY} could not simplify the mesh: {error}") from error
    triangles = answer.pop("triangles")
    if not len(triangles):
        raise NotSimplifiedError("nothing of the mesh is left once it is simplified for a 3D view")
    if len(triangles) > _MAX_EXCESS * max_triangles:
        raise NotSimplifiedError("the mesh is of too many small pieces to be simplified for a 3D view")
    return _with_own_normals(answer, triangles)


def _with_own_normals(attributes: Attributes, triangles: Int32Array) -> tuple[Attributes, Int32Array]:
    """Give corners whose normal is far from their triangle's, as where a hard edge was lost, that of the triangle."""
    geometric, has_area = face_normals(attributes["POSITION"][triangles])
    geometric = geometric[:, None, :].repeat(3, axis=1)
    cosines = np.abs((attributes["NORMAL"][triangles] * geometric).sum(axis=2))
    strange = (cosines < np.cos(np.radians(_MAX_NORMAL_ANGLE))) & has_area[:, None]
    copied = triangles[strange]
    triangles = triangles.copy()
    triangles[strange] = len(attributes["NORMAL"]) + np.arange(len(copied))
    attributes = {name: np.concatenate([values, values[copied]]) for name, values in attributes.items()}
    attributes["NORMAL"][len(attributes["NORMAL"]) - len(copied) :] = geometric[strange]
    return attributes, triangles


def _to_npz(arrays: dict[str, Any]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _from_npz(data: bytes) -> Attributes:
    return dict(np.load(io.BytesIO(data)))


# The child.


def _simplify(attributes: Attributes, triangles: Int32Array, max_triangles: int) -> tuple[Attributes, Int32Array]:
    """Simplify with the lines of seams held; where that leaves too many triangles, the lines may move.

    Without a least shape of triangles, thin sheets shrink.
    """
    from opengl_decimate import SimplifyOptions, simplify

    for lock_seams in (True, False):
        options = SimplifyOptions(
            target_count=max_triangles,
            lock_seams=lock_seams,
            placement="endpoint",
            min_triangle_quality=_MIN_TRIANGLE_QUALITY,
        )
        result = simplify(attributes, triangles.reshape(-1), options)
        if len(result.indices) <= 3 * max_triangles:  # three indices each
            break
    return result.attributes, result.indices.reshape(-1, 3).astype(np.int32)


def main() -> None:
    """Answer one request."""
    end_with_parent()
    warnings.simplefilter("ignore")
    request = _from_npz(sys.stdin.buffer.read())
    max_triangles, triangles = int(request.pop("max_triangles")), request.pop("triangles")
    try:
        attributes, triangles = _simplify(request, triangles, max_triangles)
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
    sys.stdout.buffer.write(_to_npz({**attributes, "triangles": triangles}))


if __name__ == "__main__":
    main()
