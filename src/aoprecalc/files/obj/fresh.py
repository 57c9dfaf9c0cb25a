"""Says a scene that came from another kind of file in the words of an OBJ, for the writer to go on with."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.distinct import distinct_rows
from aoprecalc.files.obj.reader import ObjDocument
from aoprecalc.files.ply.reader import PlyDocument
from aoprecalc.files.polygons import Polygons
from aoprecalc.model import Scene

POSITION, UV, NORMAL = "v {!r} {!r} {!r}", "vt {!r} {!r}", "vn {:.9g} {:.9g} {:.9g}"


def fresh_document(scene: Scene) -> ObjDocument:
    """Return the OBJ: an object for each part, no materials, bare `f` lines (what they say is in `corners`)."""
    document = scene.document
    polygons = document.polygons if isinstance(document, PlyDocument) else Polygons.of_triangles(len(scene.faces))
    corners = np.full((polygons.counts.sum(), 3), -1, dtype=np.int32)
    corners[polygons.triangles, 0] = scene.faces
    lines = row_lines(POSITION, scene.positions)
    for column, (template, values) in enumerate(((UV, scene.uvs), (NORMAL, scene.normals)), 1):
        if values is not None:
            rows = values.reshape(-1, values.shape[2])
            first, which = distinct_rows(rows)
            corners[polygons.triangles, column] = which.reshape(-1, 3)
            lines += row_lines(template, rows[first])

    starts = [0, *(polygons.owners[part.start] for part in scene.parts[1:]), len(polygons.counts)]
    for part, start, stop in zip(scene.parts, starts, starts[1:], strict=False):
        lines += [f"o {' '.join(part.name.split()) or 'mesh'}", *["f"] * (stop - start)]
    return ObjDocument("\n".join(lines), corners, polygons, scene.normals is not None, {})


def row_lines(template: str, rows: NDArray[Any]) -> list[str]:
    """Return a line for each row of numbers, with digits enough to tell float64 (UV, POSITION) or float32 apart."""
    return [template.format(*row) for row in rows.tolist()]
