"""Run an unwrapper in its own process: `python -m aoprecalc.uv.unwrap_process METHOD < request.npz > answer.npz`.

METHOD is xatlas or uvunwrap. xatlas neither releases the interpreter nor can be interrupted, so the parent must be able
to go on, or to end it. uvunwrap can be interrupted, but a fault inside it (an index out of bounds, on some meshes) ends
one of its threads, and the job never finishes; the parent detects the panic message on stderr. The protocol is that of
`subprocesses.ask`.

request: positions (v, 3) float32 about one unit across, faces (f, 3) uint32, size and padding in texels
answer:  uvs (f, 3, 2) float64 in [0, 1], placed (f,) bool: faces that got UVs, charts, gutter
"""

import io
import os
import sys
import time
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from aoprecalc.subprocesses import FIRST_STEP, POLL_SECONDS, end_with_parent, report_step
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.uv.unwrap import MIN_GUTTER, area_and_perimeter, choose_gutter, fitting_scale

# xatlas: search for the greatest scale at which the charts fit one page.
_MAX_PACKINGS = 12
_SCALE_STEP = 1.08  # between the first two tries; squared after each that is too large
_CLOSE = 1.005  # ratio of the smallest scale that is too large to the greatest that fits, at which the search ends

# uvunwrap: lower the density until its own packer needs one page only.
_MANY_CHARTS = 1500  # above this its fast packer: the better one would take longer than the bake
_MAX_DENSITIES = 8
_DENSITY_STEP = 0.85  # of the density that needed more pages

_ATLASES: list[Any] = []  # every xatlas.Atlas that was made


def unwrap_with_xatlas(positions: Float32Array, faces: NDArray[np.uint32], size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels."""
    report_step("charts")
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
    area, perimeter = area_and_perimeter(flat[corners], corners.astype(np.int32))
    gutter = choose_gutter(area, perimeter, size, padding)
    packed = _pack_with_xatlas(flat * fitting_scale(area, perimeter, size, gutter), corners, size, gutter)
    result: Float64Array = np.zeros((len(faces), 3, 2))
    result[placed] = packed[corners]
    return {"uvs": result, "placed": placed, "charts": atlas.chart_count, "gutter": gutter}


def _pack_with_xatlas(flat: Float64Array, corners: Int32Array, size: int, gutter: int) -> Float64Array:
    """Return (v, 2) UVs in [0, 1] of flat charts, (v, 2) in texels, at about the greatest scale that fits one page."""
    import xatlas

    border = gutter // 2  # kept free at the sides of the page, as textures repeat
    options = xatlas.PackOptions()
    options.resolution, options.texels_per_unit = size - 2 * border, 1.0
    options.padding, options.bilinear = gutter, False
    fits, too_large, scale, step = 0.0, np.inf, 1.0, _SCALE_STEP
    best = None
    for attempt in range(1, _MAX_PACKINGS + 1):
        report_step(f"packing, try {attempt} of at most {_MAX_PACKINGS}")
        page = _new_atlas()
        page.add_uv_mesh((flat * scale).astype(np.float32), corners.astype(np.uint32))
        page.generate(pack_options=options)
        if page.atlas_count == 1 and max(page.width, page.height) <= size - 2 * border:
            mapping, _, uvs = page.get_mesh(0)
            best = np.zeros((len(flat), 2))  # a vertex that xatlas left out is at the origin
            best[mapping] = uvs * np.array([page.width, page.height]) + border
            fits, best = scale, best / size
        else:
            too_large = scale
            step = step if fits else step * step
        if too_large < fits * _CLOSE:
            break
        scale = too_large / step if not fits else fits * step if np.isinf(too_large) else (fits + too_large) / 2
    if best is None:
        raise ValueError(f"its charts did not fit {size} x {size} texels with gutters of {gutter}; use a larger --size")
    return best


def _new_atlas() -> Any:
    """Return an xatlas.Atlas that is never destroyed.

    Its destructor may deadlock on a worker thread that missed its wake-up.
    """
    import xatlas

    _ATLASES.append(xatlas.Atlas())
    return _ATLASES[-1]


def unwrap_with_uvunwrap(positions: Float32Array, faces: NDArray[np.uint32], size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels."""
    import uvunwrap

    mesh = uvunwrap.Mesh(positions, faces)
    try:
        # A quick first packing tells how long the outlines are, and so how wide a gutter the page has room for.
        uvs, placed, corners, charts = _fit_one_page(mesh, size, MIN_GUTTER, "fast")
        area, perimeter = area_and_perimeter(uvs[placed] * size, corners[placed])
        gutter = choose_gutter(area, perimeter, size, padding)
        packing: Literal["shape", "fast"] = "fast" if charts > _MANY_CHARTS else "shape"
        if gutter > MIN_GUTTER or packing == "shape":
            uvs, placed, corners, charts = _fit_one_page(mesh, size, gutter, packing)
    except uvunwrap.UnwrapError as error:
        raise ValueError(str(error)) from error
    return {"uvs": uvs, "placed": placed, "charts": charts, "gutter": gutter}


def _fit_one_page(
    mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"]
) -> tuple[Float64Array, BoolArray, Int32Array, int]:
    """Return UVs (f, 3, 2), placed (f,), vertex indices (f, 3) and the number of charts."""
    density = None
    for _ in range(_MAX_DENSITIES):
        atlas = _run_uvunwrap(mesh, size, gutter, packing, density)
        if atlas.page_count == 1:
            break
        density = _DENSITY_STEP * atlas.texels_per_unit
    else:
        raise ValueError(f"its charts need {atlas.page_count} pages of {size} x {size} texels; use a larger --size")
    page = atlas.meshes[0]
    corners: Int32Array = np.array(page.indices, np.int32).reshape(-1, 3)
    placed: BoolArray = (np.array(page.page)[corners] == 0).all(axis=1)
    uvs = np.array(page.uv, np.float64).reshape(-1, 2)[corners] * (atlas.width / size, atlas.height / size)
    return uvs, placed, corners, atlas.chart_count


def _run_uvunwrap(mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"], density: float | None) -> Any:
    """Return uvunwrap's atlas, of `density` texels a unit (None: its own estimate), and report its steps meanwhile."""
    import uvunwrap

    job = uvunwrap.start([mesh], page_size=size, padding=gutter, packing=packing, texels_per_unit=density)
    reported = FIRST_STEP
    while not job.done:
        step = _describe(job.progress)
        if step != reported:
            report_step(step)
            reported = step
        time.sleep(POLL_SECONDS)
    return job.result()


def _describe(progress: Any) -> str:
    """Describe the step of a job; its packing counts tries without knowing how many there will be."""
    if progress is None:
        return FIRST_STEP
    count = f"{progress.done} of {progress.total}" if progress.total else f"try {progress.done}"
    return f"{progress.stage}, {count}"


_METHODS = {"xatlas": unwrap_with_xatlas, "uvunwrap": unwrap_with_uvunwrap}


def main(method: str) -> NoReturn:
    """Answer one request."""
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    arguments = request["positions"], request["faces"], int(request["size"]), int(request["padding"])
    try:
        answer = _METHODS[method](*arguments)
    except ValueError as error:
        _exit(1, str(error))
    except MemoryError:
        _exit(1, "out of memory; use a mesh of fewer faces")
    buffer = io.BytesIO()
    np.savez(buffer, **answer)
    sys.stdout.buffer.write(buffer.getvalue())
    _exit(0, "")


def _exit(status: int, message: str) -> NoReturn:
    """End the process without running destructors, see `_new_atlas`."""
    sys.stderr.write(message)
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1])
