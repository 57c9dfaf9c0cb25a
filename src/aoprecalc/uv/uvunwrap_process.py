"""Unwraps with uvunwrap in a process of its own: `python -m aoprecalc.uv.uvunwrap_process < request.npz > answer.npz`.

It can be interrupted, but a fault inside it (an index out of bounds, on some meshes) ends a thread of its own and
leaves its job undone for ever; the parent hears of the panic. Requests and answers are those of `xatlas_child`.
"""

import io
import sys
import time
from typing import Any, Literal

import numpy as np
import uvunwrap
from numpy.typing import NDArray

from aoprecalc.subprocesses import FIRST_STEP, POLL, end_with_parent, say_step
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array
from aoprecalc.uv.gutter import MIN_GUTTER, area_and_perimeter, choose_gutter

_MANY_CHARTS = 1500  # above this the fast packing: the better one takes longer than the bake
_PACKINGS = 8  # tries at one page
_THINNER = 0.85  # of the density that needed more pages


def unwrap(positions: Float32Array, faces: NDArray[np.uint32], size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels."""
    mesh = uvunwrap.Mesh(positions, faces)
    # A quick first packing tells how much outline there is, and so how much gutter the page has room for.
    uvs, placed, corners, charts = _run(mesh, size, MIN_GUTTER, "fast")
    area, outline = area_and_perimeter(uvs[placed] * size, corners[placed])
    gutter = choose_gutter(area, outline, size, padding)
    packing: Literal["shape", "fast"] = "fast" if charts > _MANY_CHARTS else "shape"
    if gutter > MIN_GUTTER or packing == "shape":
        uvs, placed, corners, charts = _run(mesh, size, gutter, packing)
    return {"uvs": uvs, "placed": placed, "charts": charts, "gutter": gutter}


def _run(
    mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"]
) -> tuple[Float64Array, BoolArray, Int32Array, int]:
    """Return UVs (f, 3, 2), placed (f,), corner numbers (f, 3) and the number of charts."""
    density = None
    for _ in range(_PACKINGS):
        atlas = _pack(mesh, size, gutter, packing, density)
        if atlas.page_count == 1:
            break
        density = _THINNER * atlas.texels_per_unit
    else:
        raise ValueError(f"its charts need {atlas.page_count} pages of {size} x {size} texels; use a larger --size")
    page = atlas.meshes[0]
    corners: Int32Array = np.array(page.indices, np.int32).reshape(-1, 3)
    placed: BoolArray = (np.array(page.page)[corners] == 0).all(axis=1)
    uvs = np.array(page.uv, np.float64).reshape(-1, 2)[corners] * (atlas.width / size, atlas.height / size)
    return uvs, placed, corners, atlas.chart_count


def _pack(mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"], density: float | None) -> Any:
    """Return uvunwrap's atlas, of `density` texels a unit or what it thinks will fit, and say its steps meanwhile."""
    job = uvunwrap.start([mesh], page_size=size, padding=gutter, packing=packing, texels_per_unit=density)
    said = FIRST_STEP
    while not job.done:
        step = _step(job.progress)
        if step != said:
            say_step(step)
            said = step
        time.sleep(POLL)
    return job.result()


def _step(progress: Any) -> str:
    """Say in words what uvunwrap's job is at; its packing counts tries and does not know how many there will be."""
    if progress is None:
        return FIRST_STEP
    count = f"{progress.done} of {progress.total}" if progress.total else f"try {progress.done}"
    return f"{progress.stage}, {count}"


def main() -> None:
    """Answer one request."""
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    try:
        answer = unwrap(request["positions"], request["faces"], int(request["size"]), int(request["padding"]))
    except (ValueError, uvunwrap.UnwrapError) as error:
        sys.exit(str(error))
    except MemoryError:
        sys.exit("out of memory; use a mesh of fewer faces")
    buffer = io.BytesIO()
    np.savez(buffer, **answer)
    sys.stdout.buffer.write(buffer.getvalue())


if __name__ == "__main__":
    main()
