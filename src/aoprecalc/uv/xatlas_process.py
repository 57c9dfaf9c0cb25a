"""Unwraps with xatlas in a process of its own: `python -m aoprecalc.uv.xatlas_process < request.npz > answer.npz`.

xatlas neither releases the interpreter nor can be interrupted, so the parent must be able to go on, or to end it. What
is said on the way is for `child.ask`.

request: positions (v, 3) float32 about one unit across, faces (f, 3) uint32, size and padding in texels
answer:  uvs (f, 3, 2) float32 in [0, 1], placed (f,) bool, charts, gutter
"""

import io
import os
import sys
from typing import Any, NoReturn

import numpy as np
import xatlas
from numpy.typing import NDArray

from aoprecalc.subprocesses import end_with_parent, say_step
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.uv.gutter import area_and_perimeter, choose_gutter, fitting_scale

_PACKINGS = 12  # tries at the greatest scale that fits one page
_STEP = 1.08  # between the first two tries; squared after each that is too large
_CLOSE = 1.005  # such a pair is close enough

_ATLASES: list["xatlas.Atlas"] = []  # all that were made


def unwrap(positions: Float32Array, faces: NDArray[np.uint32], size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels."""
    say_step("charts")
    atlas = _new_atlas()
    atlas.add_mesh(positions, faces)
    atlas.generate()
    _, corners, uvs = atlas.get_mesh(0)
    page, _ = atlas.get_mesh_vertex_assignment(0)
    placed: BoolArray = (page.astype(np.int32)[corners] >= 0).all(axis=1)
    if not placed.any():
        raise ValueError("every face is too thin for it; use a mesh without slivers")
    corners = np.ascontiguousarray(corners[placed])
    flat = uvs.astype(np.float64) * (atlas.width, atlas.height)
    area, outline = area_and_perimeter(flat[corners], corners.astype(np.int32))
    gutter = choose_gutter(area, outline, size, padding)
    packed = _pack(flat * fitting_scale(area, outline, size, gutter), corners, size, gutter)
    result: Float64Array = np.zeros((len(faces), 3, 2))
    result[placed] = packed[corners]
    return {"uvs": result, "placed": placed, "charts": atlas.chart_count, "gutter": gutter}


def _pack(flat: Float64Array, corners: Int32Array, size: int, gutter: int) -> Float64Array:
    """Return (v, 2) UVs in [0, 1] of flat charts, (v, 2) in texels, at about the greatest scale that fits one page."""
    border = gutter // 2  # kept free at the page's sides, as textures repeat
    options = xatlas.PackOptions()
    options.resolution, options.texels_per_unit = size - 2 * border, 1.0
    options.padding, options.bilinear = gutter, False
    fits, too_large, scale, step = 0.0, np.inf, 1.0, _STEP
    best = None
    for attempt in range(1, _PACKINGS + 1):
        say_step(f"packing, try {attempt} of at most {_PACKINGS}")
        page = _new_atlas()
        page.add_uv_mesh((flat * scale).astype(np.float32), corners.astype(np.uint32))
        page.generate(pack_options=options)
        if page.atlas_count == 1 and max(page.width, page.height) <= size - 2 * border:
            fits, best = scale, _uvs_of(page, len(flat), border) / size
        else:
            too_large = scale
            step = step if fits else step * step
        if too_large < fits * _CLOSE:
            break
        scale = too_large / step if not fits else fits * step if np.isinf(too_large) else (fits + too_large) / 2
    if best is None:
        raise ValueError(f"its charts did not fit {size} x {size} texels with gutters of {gutter}; use a larger --size")
    return best


def _new_atlas() -> "xatlas.Atlas":
    """Return an atlas that is never destroyed: its destructor waits for ever for a thread that missed being woken."""
    _ATLASES.append(xatlas.Atlas())
    return _ATLASES[-1]


def _uvs_of(page: "xatlas.Atlas", count: int, border: int) -> Float64Array:
    """Return (v, 2) places on the page in texels; a vertex that xatlas left out is at the origin."""
    mapping, _, uvs = page.get_mesh(0)
    result: Float64Array = np.zeros((count, 2))
    result[mapping] = uvs * np.array([page.width, page.height]) + border
    return result


def main() -> None:
    """Answer one request."""
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    try:
        answer = unwrap(request["positions"], request["faces"], int(request["size"]), int(request["padding"]))
    except ValueError as error:
        _end(1, str(error))
    except MemoryError:
        _end(1, "out of memory; use a mesh of fewer faces")
    buffer = io.BytesIO()
    np.savez(buffer, **answer)
    sys.stdout.buffer.write(buffer.getvalue())
    _end(0, "")


def _end(status: int, said: str) -> NoReturn:
    """End the process without destructors."""
    sys.stderr.write(said)
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
