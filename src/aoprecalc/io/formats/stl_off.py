"""The formats without UVs: STL, binary or ASCII, and OFF, whose colours and normals are left out."""

import logging
import re
import warnings
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, damaged_file
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.types import Scene

_HEADER_BYTES = 84  # 80 bytes of text and the number of faces
_FACE_BYTES = 50

# trimesh logs the traceback of a normal that is none; logging prints that unless somebody listens.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_SOLID = re.compile(r"\s*solid\b", re.IGNORECASE)
_FACET = re.compile(r"^\s*facet\b", re.MULTILINE | re.IGNORECASE)
_VERTEX = re.compile(r"^[ \t]*vertex((?:[ \t]+\S+)*)[ \t]*$", re.MULTILINE | re.IGNORECASE)


class StlFormat(MeshFormat):
    """Stereolithography files: every face has corners of its own, and flat normals, which are not kept."""

    name = "STL"
    extensions = (".stl",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is ASCII with facets, or binary of the size that its number of faces asks for."""
        if _SOLID.match(data[:256].decode("latin-1")) and b"facet" in data[:4096].lower():
            return True
        return len(data) >= _HEADER_BYTES and len(data) == _binary_size(data)[1]

    def read(self, path: Path, data: bytes) -> Scene:
        """Read each solid of an ASCII file as a part, a binary file as one part."""
        text = "" if b"\0" in data else data.decode("utf-8", "surrogateescape")
        if _SOLID.match(text):
            return build_scene(path, "stl", _read_text(path, StringIO(text, newline=None).read()))
        faces, size = _binary_size(data)
        if len(data) < max(size, _HEADER_BYTES):
            raise damaged_file(
                path, f"{counted(faces, 'face')} in {size} bytes were expected, but it has {len(data)} bytes"
            )
        messages = [] if len(data) == size else [f"after the last face {counted(len(data) - size, 'byte')} ignored"]
        return build_scene(path, "stl", _read_binary(data[:size]), messages=messages)


def _binary_size(data: bytes) -> tuple[int, int]:
    """Return the number of faces that a binary STL announces, and the size in bytes of a file of so many."""
    faces = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    return faces, _HEADER_BYTES + faces * _FACE_BYTES


def _read_binary(data: bytes) -> list[MeshPiece]:
    from trimesh.exchange.stl import load_stl_binary  # takes half a second, which other formats should not pay

    loaded = load_stl_binary(BytesIO(data))
    return [_soup("mesh", loaded["vertices"])] if "vertices" in loaded else []


def _read_text(path: Path, text: str) -> list[MeshPiece]:
    """Return one piece for each solid; raises InputError unless every vertex of the text is in one of them."""
    from trimesh.exchange.stl import load_stl_ascii

    vertices = _VERTEX.findall(text)
    wrong = next((words.strip() for words in vertices if len(words.split()) != 3), None)
    if wrong is not None:
        raise damaged_file(path, f"a vertex is {wrong[:60]!a}, three numbers were expected")
    facets = len(_FACET.findall(text))
    if len(vertices) != 3 * facets:
        raise damaged_file(
            path, f"it has {len(vertices)} vertices, three for each of {counted(facets, 'facet')} were expected"
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of words that are no numbers, which are noticed below
        loaded = load_stl_ascii(StringIO(text))
    solids = loaded["geometry"] if "geometry" in loaded else {loaded["metadata"]["name"]: loaded}
    # Solids without a name are called geometry_1 and so on.
    pieces = [_soup("mesh" if name.startswith("geometry_") else name, s["vertices"]) for name, s in solids.items()]
    # trimesh stops silently at what is not a number, and leaves out a solid that has no end.
    found = sum(len(piece.positions) for piece in pieces)
    if found != len(vertices):
        raise damaged_file(path, f"only {found} of its {len(vertices)} vertices are numbers between solid and endsolid")
    return pieces


def _soup(name: str, corners: NDArray[np.floating]) -> MeshPiece:
    return MeshPiece(name, corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3))


# OFF.

_OFF_HEADER = re.compile(rb"\s*(?:ST)?C?N?OFF\s+(\d+)\s+(\d+)(?:\s+\d+)?[ \t\r]*\n")
_COMMENT = re.compile(rb"#[^\n]*")


class OffFormat(MeshFormat):
    """Object File Format, ASCII."""

    name = "OFF"
    extensions = (".off",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins with OFF and its counts."""
        return _OFF_HEADER.match(_COMMENT.sub(b"", data[:4096])) is not None

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the polygons as one part."""
        text = _COMMENT.sub(b"", data)
        header = _OFF_HEADER.match(text)
        if header is None:
            start = text[:24].decode("latin-1")
            raise damaged_file(path, f"it starts with {start!a}, OFF and its counts were expected")
        lines = [line for line in text[header.end() :].splitlines() if line.strip()]
        vertices, faces = int(header[1]), int(header[2])
        if len(lines) < vertices + faces:
            promised = f"{counted(vertices, 'vertex', 'vertices')} and {counted(faces, 'face')}"
            raise damaged_file(path, f"it promises {promised}, but has {counted(len(lines), 'line')} for them")
        try:
            rows = [line.split(None, 3)[:3] for line in lines[:vertices]]
            positions = np.array(rows, dtype=np.float64).reshape(-1, 3)
            polygons = [_polygon(line.split()) for line in lines[vertices : vertices + faces]]
        except ValueError:
            raise damaged_file(path, "a line is not the three coordinates or the polygon expected there") from None
        counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
        corners = np.array([vertex for polygon in polygons for vertex in polygon], dtype=np.int64)
        check_indices(path, corners, vertices)
        triangles, _ = polygon_triangles(counts, corners, positions)
        return build_scene(path, "off", [MeshPiece("mesh", positions, corners[triangles])])


def _polygon(words: list[bytes]) -> list[int]:
    """Return the vertices of a face line: as many as its first number says, before any colour."""
    count = int(words[0])
    if count < 0 or len(words) <= count:
        raise ValueError
    return [int(word) for word in words[1 : count + 1]]
