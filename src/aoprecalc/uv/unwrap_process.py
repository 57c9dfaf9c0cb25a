"""Unwrap in a process of its own: `python -m aoprecalc.uv.unwrap_process METHOD < request.npz > answer.npz`.

METHOD is xatlas or uvunwrap. xatlas neither releases the interpreter nor can be interrupted, so the parent must be able
to go on, or to end it. uvunwrap can be interrupted, but a fault inside it (an index out of bounds, on some meshes) ends
one of its threads, and the job never finishes; the parent detects the panic message on stderr. The protocol is that of
`subprocesses.ask`.

request: positions (v, 3) float64 about one unit across, faces (f, 3) int32, size and padding in texels
answer:  uvs (f, 3, 2) float64 in [0, 1], placed (f,) bool: faces that got UVs, charts, gutter
"""

import io
import os
import sys
from typing import Any, NoReturn, cast

import numpy as np

from aoprecalc.errors import counted
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.raster.cpu_rasterizer import overlapping_triangles
from aoprecalc.subprocesses import end_with_parent, report_step
from aoprecalc.types import BoolArray, Float64Array, Int32Array
from aoprecalc.uv.charts import (
    FINER,
    Unwrapper,
    cut_again,
    doubled_uv_areas,
    make_charts,
    out_of_scale,
    sum_over_charts,
)
from aoprecalc.uv.pack import pack_charts

_TINY = 1e-4  # square texels that do not matter


def unwrap(method: Unwrapper, positions: Float64Array, faces: Int32Array, size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels.

    Charts that are faulty when they are packed, whoever cut and packed them, are cut into smaller ones.
    """
    charts = make_charts(method, positions, faces)
    packed = pack_charts(charts, size, padding, method)
    surface = np.linalg.norm(area_vectors(positions[faces]), axis=1) / 2
    for fineness in FINER:
        faulty = faulty_charts(packed.uvs, charts.chart, surface, size)
        if not faulty.any():
            break
        report_step(f"cutting {counted(np.count_nonzero(faulty), 'chart')} again")
        charts = cut_again(charts, faulty, method, positions, faces, fineness)
        packed = pack_charts(charts, size, padding, method)
    return {"uvs": packed.uvs, "placed": charts.placed, "charts": charts.count, "gutter": packed.gutter}


def faulty_charts(uvs: Float64Array, chart: Int32Array, surface: Float64Array, size: int) -> BoolArray:
    """Return which charts are blown up or shrunk, fold, or lie over others, (n,) bool.

    uvs       (f, 3, 2) in [0, 1]
    chart     (f,) the chart of each face, -1 for none
    surface   (f,) the area of each face
    A chart's share of the texture must be that of the surface within a factor of MAX_RATIO, but for charts far smaller
    than a texel, and no texel's centre may lie inside two faces.
    """
    texels = sum_over_charts(chart, doubled_uv_areas(uvs) / 2 * size**2)
    faulty = out_of_scale(texels, sum_over_charts(chart, surface), _TINY)
    triangles = (uvs * (size, -size) + (0.0, size)).astype(np.float32)
    placed = chart >= 0
    faulty[chart[placed][overlapping_triangles(triangles[placed], size, size)]] = True
    return faulty


def main(method: str) -> NoReturn:
    """Answer one request."""
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    settings = int(request["size"]), int(request["padding"])
    try:
        answer = unwrap(cast(Unwrapper, method), request["positions"], request["faces"], *settings)
    except ValueError as error:
        _exit(1, str(error))
    except MemoryError:
        _exit(1, "out of memory; use a mesh of fewer faces")
    buffer = io.BytesIO()
    np.savez(buffer, **answer)
    sys.stdout.buffer.write(buffer.getvalue())
    _exit(0, "")


def _exit(status: int, message: str) -> NoReturn:
    """End the process without running destructors, see `charts.new_xatlas`."""
    sys.stderr.write(message)
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1])
