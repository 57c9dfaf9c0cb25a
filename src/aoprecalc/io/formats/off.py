"""Reads OFF: polygons of any mixture of sizes; colours and normals are left out."""

import re
from pathlib import Path

import numpy as np

from aoprecalc.io.formats.builder import Piece, build_scene, check_indices, damaged
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.types import Scene


def read_off(path: Path, data: bytes) -> Scene:
    """Read an OFF file of the given bytes; raises InputError where it is damaged or has no usable faces."""
    text = re.sub(rb"#[^\n]*", b"", data)
    header = re.match(rb"\s*(?:ST)?C?N?OFF\s+(\d+)\s+(\d+)(?:\s+\d+)?[ \t\r]*\n", text)
    if header is None:
        raise damaged(path, f"it starts with {text[:24].decode('latin-1')!a}, OFF and its counts were expected")
    lines = [line for line in text[header.end() :].splitlines() if line.strip()]
    vertices, faces = int(header[1]), int(header[2])
    if len(lines) < vertices + faces:
        raise damaged(path, f"it promises {vertices} vertices and {faces} faces, but has {len(lines)} lines for them")
    try:
        positions = np.array([line.split(None, 3)[:3] for line in lines[:vertices]], dtype=np.float64).reshape(-1, 3)
        polygons = [[int(word) for word in _polygon(line.split())] for line in lines[vertices : vertices + faces]]
    except ValueError:
        raise damaged(path, "a line is not the three coordinates or the polygon expected at its place") from None
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    corners = np.array([vertex for polygon in polygons for vertex in polygon], dtype=np.int64)
    check_indices(path, corners, vertices)
    triangles, _ = polygon_triangles(counts, corners, positions)
    return build_scene(path, "off", [Piece("mesh", positions, corners[triangles])])


def _polygon(words: list[bytes]) -> list[bytes]:
    """Return the vertices of a face line: as many as its first number says, before any colour."""
    count = int(words[0])
    if count < 0 or len(words) <= count:
        raise ValueError
    return words[1 : count + 1]
