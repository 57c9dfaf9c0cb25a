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

from aoprecalc.subprocesses import end_with_parent
from aoprecalc.types import Float64Array, Int32Array
from aoprecalc.uv.charts import Unwrapper, make_charts
from aoprecalc.uv.pack import pack_charts


def unwrap(method: Unwrapper, positions: Float64Array, faces: Int32Array, size: int, padding: int) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into exactly one page of size x size texels."""
    charts = make_charts(method, positions, faces)
    packed = pack_charts(charts, size, padding, method)
    return {"uvs": packed.uvs, "placed": charts.placed, "charts": charts.count, "gutter": packed.gutter}


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
