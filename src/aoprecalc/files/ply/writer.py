"""Writes binary PLY with one normal and one UV (s, t) for each vertex."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.corners import split_corners
from aoprecalc.files.ply.reader import PlyDocument
from aoprecalc.files.ply.table import TYPES
from aoprecalc.files.references import relative_path
from aoprecalc.model import Atlas, Doubles, Floats, Scene
from aoprecalc.options import Pack

_NAMES = {code: name for name, code in TYPES.items() if not name[-1].isdigit()}


def write_ply(
    outputs: Outputs, path: Path, scene: Scene, atlas: Atlas, normals: Floats, texture: Path, pack: Pack = "none"
) -> tuple[str, ...]:
    """Write a PLY whose vertices are split where UVs or normals differ; return what the user should know: nothing.

    Positions are float32 where that is exact, else float64. Other properties that the vertices of a PLY source have
    (colours, say) are carried over. The texture is named by a `comment TextureFile`, as MeshLab does.
    """
    uvs = atlas.uvs.astype(np.float32)
    extra = scene.document.columns if isinstance(scene.document, PlyDocument) else {}
    source = np.concatenate([part.vertices for part in scene.parts]) if extra else scene.faces
    split = split_corners(scene.faces, source, uvs, normals)

    positions = _shortest(scene.positions)[scene.faces.reshape(-1)[split.corner]]
    columns: dict[str, NDArray[Any]] = {}
    columns.update(zip("xyz", positions.T, strict=True))
    columns.update(zip(("nx", "ny", "nz"), normals.reshape(-1, 3)[split.corner].T, strict=True))
    columns.update(zip("st", uvs.reshape(-1, 2)[split.corner].T, strict=True))
    columns.update({name: values[source.reshape(-1)[split.corner]] for name, values in extra.items()})

    vertices = np.empty(len(split.corner), dtype=[(name, values.dtype.str) for name, values in columns.items()])
    for name, values in columns.items():
        vertices[name] = values
    faces = np.empty(len(split.triangles), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"], faces["vertices"] = 3, split.triangles

    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment TextureFile {relative_path(texture, path)}",
        f"element vertex {len(vertices)}",
        *(f"property {_NAMES[values.dtype.str[1:]]} {name}" for name, values in columns.items()),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    head = "\n".join(header).encode("utf-8", "surrogateescape")
    outputs.path(path).write_bytes(head + vertices.tobytes() + faces.tobytes())
    return ()


def _shortest(positions: Doubles) -> NDArray[Any]:
    single = positions.astype(np.float32)
    return single if np.array_equal(single, positions) else positions
