"""Reads Stanford PLY, ASCII or binary: polygons of any mixture of sizes, triangle strips, UVs on vertices or corners.

trimesh's reader is not used for this format: it refuses binary files that mix triangles with other polygons, takes
strips for a cloud of points, and reorders the vertices where there are UVs.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.damage import check_indices, damaged
from aoprecalc.files.pieces import Piece, build_scene
from aoprecalc.files.ply.table import Element, Property, Table, read_table
from aoprecalc.files.polygons import polygon_triangles, strip_triangles
from aoprecalc.model import Doubles, Scene

VERTEX_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
VERTEX_NORMALS = ("nx", "ny", "nz")
FACE_LISTS = ("vertex_indices", "vertex_index")


@dataclass(frozen=True, eq=False)
class PlyDocument:
    """What a PLY holds beside its faces.

    columns   properties of vertices beside position, normal and UV (colours, say), to be passed on: name -> (n,)
              values, of the type that they had in the file
    picture   the file of its texture, where a `comment TextureFile` names one
    """

    columns: dict[str, NDArray[Any]]
    picture: Path | None = None


def read_ply(path: Path, data: bytes) -> Scene:
    """Read a PLY file of the given bytes; raises InputError where it is damaged or has no usable faces."""
    elements, body, order = _header(path, data)
    tables = read_table(path, elements, body, order)
    vertex = tables.get("vertex", Table({}, {}))
    if not all(axis in vertex.columns for axis in "xyz"):
        raise damaged(path, "its vertices have no x, y and z, which were expected")
    positions = np.column_stack([vertex.columns[axis] for axis in "xyz"]).astype(np.float64)
    uv_names = next((names for names in VERTEX_UVS if all(name in vertex.columns for name in names)), None)

    vertices, corner_uvs = _faces(positions, tables)
    strips = _strips(tables)
    if len(strips):
        vertices, corner_uvs = np.concatenate([vertices, strips]), None
    check_indices(path, vertices, len(positions))
    if uv_names is not None:
        corner_uvs = np.column_stack([vertex.columns[name] for name in uv_names])[vertices]
    normals = None
    if all(name in vertex.columns for name in VERTEX_NORMALS):
        normals = np.column_stack([vertex.columns[name] for name in VERTEX_NORMALS])[vertices]

    uv_sets = () if corner_uvs is None else (corner_uvs,)
    known = {*"xyz", *VERTEX_NORMALS, *(uv_names or ())}
    others = {name: column for name, column in vertex.columns.items() if name not in known}
    document = PlyDocument(others, _texture_file(path, data))
    return build_scene(path, "ply", [Piece("mesh", positions, vertices, normals, uv_sets)], document)


def _faces(positions: Doubles, tables: dict[str, Table]) -> tuple[NDArray[np.int64], Doubles | None]:
    """Return (f, 3) vertices and, where the faces carry UVs themselves, (f, 3, 2) UVs at the corners."""
    face = tables.get("face", Table({}, {}))
    polygons = next((face.lists[name] for name in FACE_LISTS if name in face.lists), None)
    if polygons is None:
        return np.empty((0, 3), dtype=np.int64), None
    vertices = polygons.values.astype(np.int64)
    known = (vertices >= 0) & (vertices < len(positions))
    # Indices that are wrong are reported later; until then any position will do.
    triangles, _ = polygon_triangles(polygons.counts, np.where(known, vertices, 0), positions)
    texcoord = face.lists.get("texcoord")
    if texcoord is None or not np.array_equal(texcoord.counts, 2 * polygons.counts):
        return vertices[triangles], None
    return vertices[triangles], texcoord.values.astype(np.float64).reshape(-1, 2)[triangles]


def _strips(tables: dict[str, Table]) -> NDArray[np.int64]:
    """Return the (f, 3) vertices of the triangles of all strips; in a list, -1 starts a new strip."""
    lists = tables.get("tristrips", Table({}, {})).lists.get("vertex_indices")
    if lists is None:
        return np.empty((0, 3), dtype=np.int64)
    ends = np.cumsum(lists.counts)[:-1]
    return strip_triangles(np.insert(lists.values.astype(np.int64), ends, -1))


def _header(path: Path, data: bytes) -> tuple[list[Element], bytes, str]:
    """Return the elements that the header announces, the bytes after it, and their order: ascii, < or >."""
    end = data.find(b"end_header")
    line_end = data.find(b"\n", end)
    if not data.startswith(b"ply") or end < 0 or line_end < 0:
        raise damaged(path, "a PLY header from 'ply' to 'end_header' was expected and is not there")
    order = ""
    elements: list[Element] = []
    for line in data[:end].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) >= 2:
            order = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1], "")
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_property(path, words))
    if not order:
        raise damaged(path, "its PLY header names no known format, ascii or binary was expected")
    return elements, data[line_end + 1 :], order


def _texture_file(path: Path, data: bytes) -> Path | None:
    """Return the file that the header's first `comment TextureFile` names, as MeshLab writes it."""
    header = data[: data.find(b"end_header")].decode("utf-8", "surrogateescape")
    named = re.search(r"^comment\s+TextureFile\s+(\S.*?)\s*$", header, re.MULTILINE)
    return path.parent / named[1].replace("\\", "/") if named else None


def _property(path: Path, words: Sequence[str]) -> Property:
    try:
        if words[1] == "list":
            return Property(words[4], words[3], words[2])
        return Property(words[2], words[1])
    except (IndexError, KeyError):
        raise damaged(path, f"its PLY header says {' '.join(words)!a}, a property was expected") from None
