"""OFF: polygons of any mixture of sizes; colours and normals are left out."""

import re
from pathlib import Path

import numpy as np

from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, damaged_file
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.types import Scene

_HEADER = re.compile(rb"\s*(?:ST)?C?N?OFF\s+(\d+)\s+(\d+)(?:\s+\d+)?[ \t\r]*\n")
_COMMENT = re.compile(rb"#[^\n]*")


class OffFormat(MeshFormat):
    """Object File Format, ASCII."""

    name = "OFF"
    extensions = (".off",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins with OFF and its counts."""
        return _HEADER.match(_COMMENT.sub(b"", data[:4096])) is not None

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the polygons as one part."""
        text = _COMMENT.sub(b"", data)
        header = _HEADER.match(text)
        if header is None:
            start = text[:24].decode("latin-1")
            raise damaged_file(path, f"it starts with {start!a}, OFF and its counts were expected")
        lines = [line for line in text[header.end() :].splitlines() if line.strip()]
        vertices, faces = int(header[1]), int(header[2])
        if len(lines) < vertices + faces:
            promised = f"{vertices} vertices and {faces} faces"
            raise damaged_file(path, f"it promises {promised}, but has {len(lines)} lines for them")
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
