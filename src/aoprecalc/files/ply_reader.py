"""Reads Stanford PLY, ASCII or binary: polygons of any mixture of sizes, triangle strips, UVs on vertices or corners.

trimesh's reader is not used for this format: it refuses binary files that mix triangles with other polygons, takes
strips for a cloud of points, and reorders the vertices where there are UVs.
"""

import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyListProperty, PlyParseError

from aoprecalc.files.damage import check_indices, damaged
from aoprecalc.files.pieces import Piece, build_scene
from aoprecalc.files.polygons import polygon_triangles, strip_triangles
from aoprecalc.model import Doubles, Scene

VERTEX_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
VERTEX_NORMALS = ("nx", "ny", "nz")
FACE_LISTS = ("vertex_indices", "vertex_index")

_HEADER_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class PlyDocument:
    """The properties of a PLY's vertices beside position, normal and UV (colours, say), to be passed on.

    columns   name -> (n,) values, of the type that they had in the file
    """

    columns: dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class _Lists:
    """A list for every row of an element: `values` end to end, `counts` (rows,) of them each."""

    counts: NDArray[np.int64]
    values: NDArray[Any]


def read_ply(path: Path, data: bytes) -> Scene:
    """Read a PLY file of the given bytes.

    Raises InputError where it promises more than it has or has no usable faces, and what plyfile raises (ValueError,
    PlyParseError and the like) where it cannot be understood, of which load_scene makes an InputError.
    """
    ply = _parse(path, data)
    columns = _columns(ply, "vertex")
    if not all(axis in columns for axis in "xyz"):
        raise damaged(path, "its vertices have no x, y and z, which were expected")
    positions = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    uv_names = next((names for names in VERTEX_UVS if all(name in columns for name in names)), None)

    vertices, corner_uvs = _faces(positions, _lists(ply, "face"))
    strips = _strips(_lists(ply, "tristrips"))
    if len(strips):
        vertices, corner_uvs = np.concatenate([vertices, strips]), None
    check_indices(path, vertices, len(positions))
    if uv_names is not None:
        corner_uvs = np.column_stack([columns[name] for name in uv_names])[vertices]
    normals = None
    if all(name in columns for name in VERTEX_NORMALS):
        normals = np.column_stack([columns[name] for name in VERTEX_NORMALS])[vertices]

    known = {*"xyz", *VERTEX_NORMALS, *(uv_names or ())}
    document = PlyDocument({name: column for name, column in columns.items() if name not in known})
    return build_scene(path, "ply", [Piece("mesh", positions, vertices, normals, corner_uvs)], document)


def _parse(path: Path, data: bytes) -> PlyData:
    """Return what plyfile makes of the bytes, after checks that it does not make itself."""
    end = _HEADER_END.search(data)
    if not data.startswith(b"ply") or end is None:
        raise damaged(path, "a PLY header from 'ply' to 'end_header' was expected and is not there")
    # plyfile takes only ASCII, also in comments, where others write the names of files.
    words = [line.split() for line in data[: end.end()].splitlines()]
    header = b"".join(b" ".join(line) + b"\n" for line in words if line[:1] not in ([], [b"comment"], [b"obj_info"]))
    # plyfile sets memory aside for what the header promises, so that has to be possible.
    is_text = _check_promises(path, header, len(data) - end.end())

    with TemporaryFile() as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # plyfile's loadtxt warns of empty lists
        file.write(header)
        file.write(memoryview(data)[end.end() :])
        # Lists of one length, known beforehand, are read at once; others one after another.
        for corners in () if is_text else (3, 4):
            file.seek(0)
            lengths = {**dict.fromkeys(FACE_LISTS, corners), "texcoord": 2 * corners}
            try:
                return PlyData.read(file, known_list_len={"face": lengths})
            except (PlyParseError, ValueError):
                continue
        file.seek(0)
        return PlyData.read(file)


def _check_promises(path: Path, header: bytes, size: int) -> bool:
    """Raise InputError if the elements cannot fit into a body of `size` bytes; return whether the body is text."""
    counts = re.findall(rb"^element \S+ (\S+)$", header, re.MULTILINE)
    without_rows = PlyData.read(BytesIO(re.sub(rb"^(element \S+) \S+$", rb"\1 0", header, flags=re.MULTILINE)))
    left = size + 1  # the last line of a text may lack its end
    for element, count in zip(without_rows.elements, map(int, counts), strict=True):
        kinds = [prop.len_dtype if isinstance(prop, PlyListProperty) else prop.val_dtype for prop in element.properties]
        row = 2 * len(kinds) if without_rows.text else sum(np.dtype(kind).itemsize for kind in kinds)
        left -= count * max(row, 1)
        if count < 0 or left < 0:
            raise damaged(path, f"its header promises {count} of {element.name!a}, but it ends before that")
    return bool(without_rows.text)


def _columns(ply: PlyData, name: str) -> dict[str, NDArray[Any]]:
    """Return the (rows,) numbers of an element by the name of the property, in the byte order of this machine."""
    if name not in ply:
        return {}
    numbers = [prop for prop in ply[name].properties if not isinstance(prop, PlyListProperty)]
    return {prop.name: ply[name][prop.name].astype(prop.val_dtype) for prop in numbers}


def _lists(ply: PlyData, name: str) -> dict[str, _Lists]:
    """Return the lists of an element by the name of the property."""
    lists = {}
    for prop in ply[name].properties if name in ply else ():
        rows = ply[name][prop.name]
        if isinstance(prop, PlyListProperty) and len(rows):
            counts = np.fromiter(map(len, rows), np.int64, len(rows))
            lists[prop.name] = _Lists(counts, np.concatenate(rows) if rows.ndim == 1 else rows.reshape(-1))
    return lists


def _faces(positions: Doubles, lists: dict[str, _Lists]) -> tuple[NDArray[np.int64], Doubles | None]:
    """Return (f, 3) vertices and, where the faces carry UVs themselves, (f, 3, 2) UVs at the corners."""
    polygons = next((lists[name] for name in FACE_LISTS if name in lists), None)
    if polygons is None:
        return np.empty((0, 3), dtype=np.int64), None
    vertices = polygons.values.astype(np.int64)
    known = (vertices >= 0) & (vertices < len(positions))
    # Indices that are wrong are reported later; until then any position will do.
    triangles, _ = polygon_triangles(polygons.counts, np.where(known, vertices, 0), positions)
    texcoord = lists.get("texcoord")
    if texcoord is None or not np.array_equal(texcoord.counts, 2 * polygons.counts):
        return vertices[triangles], None
    return vertices[triangles], texcoord.values.astype(np.float64).reshape(-1, 2)[triangles]


def _strips(lists: dict[str, _Lists]) -> NDArray[np.int64]:
    """Return the (f, 3) vertices of the triangles of all strips; in a list, -1 starts a new strip."""
    if "vertex_indices" not in lists:
        return np.empty((0, 3), dtype=np.int64)
    strips = lists["vertex_indices"]
    return strip_triangles(np.insert(strips.values.astype(np.int64), np.cumsum(strips.counts)[:-1], -1))
