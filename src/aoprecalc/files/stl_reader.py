"""Reads STL, binary or ASCII. Its triangles share nothing and its normals are those of the faces: neither is kept."""

import re
from pathlib import Path

import numpy as np

from aoprecalc.files.damage import damaged
from aoprecalc.files.pieces import Piece, build_scene
from aoprecalc.model import Doubles, Scene

HEADER = 84  # 80 bytes of text and the number of faces
FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_SOLID = re.compile(rb"^[ \t]*solid[ \t]*([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)


def read_stl(path: Path, data: bytes) -> Scene:
    """Read an STL file of the given bytes; raises InputError where it is damaged or has no usable faces."""
    if _SOLID.match(data) and b"\0" not in data:
        return build_scene(path, "stl", _ascii_pieces(path, data))
    faces = int.from_bytes(data[HEADER - 4 : HEADER], "little")
    size = HEADER + faces * FACE.itemsize
    if len(data) < max(size, HEADER):
        raise damaged(path, f"{faces} faces in {size} bytes were expected, but it has {len(data)} bytes")
    corners = np.frombuffer(data, FACE, faces, HEADER)["corners"].reshape(-1, 3).astype(np.float64)
    said = [] if len(data) == size else [f"{len(data) - size} bytes after the last face are ignored"]
    return build_scene(path, "stl", [_soup("mesh", corners)], warnings=said)


def _ascii_pieces(path: Path, data: bytes) -> list[Piece]:
    """Return one piece for each `solid`."""
    solids = list(_SOLID.finditer(data))
    ends = [solid.start() for solid in solids[1:]] + [len(data)]
    pieces = []
    for solid, end in zip(solids, ends, strict=True):
        rows = [row.split() for row in _VERTEX.findall(data, solid.end(), end)]
        try:
            corners = np.array(rows, dtype=np.float64).reshape(-1, 3)
        except ValueError:
            wrong = next(b" ".join(row) for row in rows if len(row) != 3 or not _are_numbers(row))
            raise damaged(path, f"a vertex is {wrong[:60].decode('latin-1')!a}, three numbers were expected") from None
        if len(corners) % 3:
            raise damaged(path, f"it has {len(corners)} vertices, three for each face were expected")
        name = solid[1].decode("utf-8", "surrogateescape").strip()
        pieces.append(_soup(name or "mesh", corners))
    return pieces


def _are_numbers(words: list[bytes]) -> bool:
    try:
        return bool([float(word) for word in words])
    except ValueError:
        return False


def _soup(name: str, corners: Doubles) -> Piece:
    return Piece(name, corners, np.arange(len(corners)).reshape(-1, 3))
