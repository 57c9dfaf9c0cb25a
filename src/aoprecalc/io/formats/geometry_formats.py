"""STL and OFF, of which the geometry is read. A bake of them is written as GLB."""

import logging
import re
import warnings
from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO, StringIO
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MAX_COORDINATE, MeshPiece, build_scene, check_indices, damaged_file
from aoprecalc.io.formats.files import are_numbers
from aoprecalc.io.formats.polygons import lost_faces, polygon_triangles
from aoprecalc.mesh.topology import weld_corners
from aoprecalc.progress import Note
from aoprecalc.types import Scene

_HEADER_BYTES = 84  # of a binary STL: 80 bytes of text and the number of faces
_FACE_BYTES = 50
_WELD_TOLERANCE = 1e-6  # of the diagonal: how far corners are moved to meet
_MAX_COARSENESS = 0.02  # the step of float32 over the median edge, beyond which shapes are visibly coarse
_SOLID = re.compile(r"\s*solid\b", re.IGNORECASE)
_FACET = re.compile(r"^\s*facet\b", re.MULTILINE | re.IGNORECASE)
_VERTEX = re.compile(r"^[ \t]*vertex((?:[ \t]+\S+)*)[ \t]*$", re.MULTILINE | re.IGNORECASE)

# trimesh logs errors and tracebacks; logging prints them unless somebody listens.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


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
            return _stl_scene(path, _read_text(path, StringIO(text, newline=None).read()), [])
        faces, size = _binary_size(data)
        if len(data) < max(size, _HEADER_BYTES):
            raise damaged_file(
                path, f"{counted(faces, 'face')} in {size} bytes were expected, but it has {len(data)} bytes"
            )
        messages = [] if len(data) == size else [f"after the last face {counted(len(data) - size, 'byte')} ignored"]
        pieces = _read_binary(data[:size])
        return _stl_scene(path, pieces, [*messages, *_coarseness(path, pieces)])


def _stl_scene(path: Path, pieces: list[MeshPiece], messages: list[str]) -> Scene:
    """Return the scene of facets whose corners are joined where they differ only in their last digits."""
    points = np.concatenate([np.empty((0, 3)), *(piece.positions for piece in pieces)])
    if not len(points) or not (np.abs(points) <= MAX_COORDINATE).all():
        return build_scene(path, "stl", pieces, messages=messages)  # which raises what is wrong
    tolerance = _WELD_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0)))
    positions, faces = weld_corners(points.reshape(-1, 3, 3), tolerance)
    ends = np.cumsum([len(piece.vertices) for piece in pieces])
    parts = zip(pieces, np.split(faces, ends[:-1]), strict=True)
    pieces = [replace(piece, positions=positions, vertices=vertices) for piece, vertices in parts]
    moved = int(np.count_nonzero((positions[faces].reshape(-1, 3) != points).any(axis=1)))
    if not moved:
        return build_scene(path, "stl", pieces, messages=messages)
    were = one_or_many(moved, "was", "were")
    told = f"{moved} of {counted(len(points), 'corner')} {were} moved by up to {tolerance:.3g} units to meet"
    messages.append(Note(f"{told}, as STL has no shared vertices"))
    return build_scene(path, "stl", pieces, messages=messages, welded=(moved, tolerance))


def _binary_size(data: bytes) -> tuple[int, int]:
    """Return the number of faces that a binary STL announces, and the size in bytes of a file of so many."""
    faces = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    return faces, _HEADER_BYTES + faces * _FACE_BYTES


def _read_binary(data: bytes) -> list[MeshPiece]:
    from trimesh.exchange.stl import load_stl_binary  # takes half a second, which other formats should not pay

    loaded = load_stl_binary(BytesIO(data))
    return [_soup("mesh", loaded["vertices"])] if "vertices" in loaded else []


def _coarseness(path: Path, pieces: list[MeshPiece]) -> Iterator[str]:
    """Yield a warning where the float32 of a binary STL cannot tell its positions apart, as at map coordinates."""
    for piece in pieces:
        corners = piece.positions.reshape(-1, 3, 3)[:: len(piece.vertices) // 10_000 + 1]
        step = float(np.spacing(np.abs(piece.positions).max(initial=0).astype(np.float32)))
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        if len(edges) and step > _MAX_COARSENESS * np.median(edges):
            far = f"the float32 coordinates of a binary STL are {step:g} units apart so far from the origin"
            yield f"{path}: {far}, and the shape is as coarse; move it to the origin and export it again"


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

_OFF_KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?(?:OFF|off)(?![A-Za-z])")
_MAX_INDEX = 1 << 62
_OFF_COUNTS = re.compile(rb"\s*(\d+)\s+(\d+)(?:[ \t]+\d+|\s+\d+(?=[ \t]*(?:[\r\n]|$)))?(?=\s|$)")
_COMMENT = re.compile(rb"#[^\r\n]*")

_Lines = list[list[bytes]]  # the words of each


class OffFormat(MeshFormat):
    """Object File Format of Geomview, ASCII: polygons, and normals and UVs of the vertices."""

    name = "OFF"
    extensions = (".off",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins with OFF and its counts."""
        text = _COMMENT.sub(b"", data[:4096].removeprefix(BOM_UTF8))
        keyword = _OFF_KEYWORD.match(text)
        return keyword is not None and _OFF_COUNTS.match(text, keyword.end()) is not None

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the polygons as one part; a warning tells of colours, which are left out."""
        text = _COMMENT.sub(b"", data.removeprefix(BOM_UTF8))
        header, start = _off_header(path, text)
        lines = [words for line in re.split(rb"[\r\n]+", text[start:]) if (words := line.split())]
        of_vertices, of_faces = _off_lines(path, header, lines)
        table = _off_vertices(path, header, of_vertices)
        faces = _off_faces(path, header, of_faces)
        counts = np.fromiter(map(len, faces), np.int64)
        corners = np.fromiter(chain.from_iterable(faces), np.int64, counts.sum())
        check_indices(path, corners, len(table))

        positions = table[:, :3] if header.dimension == 3 else table[:, :3] / table[:, 3:4]
        vertices = corners[polygon_triangles(counts, corners, positions)[0]]
        normals = table[vertices, header.dimension : header.dimension + 3] if header.normals else None
        uv_sets = (table[vertices, -2:],) if header.uvs else ()
        messages = list(lost_faces(counts))
        of_what = {"vertices": any(len(words) > header.width for words in of_vertices)}
        of_what["faces"] = any(len(words) > len(face) + 1 for words, face in zip(of_faces, faces, strict=True))
        if any(of_what.values()):
            colored = " and ".join(what for what, has_colors in of_what.items() if has_colors)
            messages.append(f"{path}: the colours of its {colored} are left out; export it as PLY to keep them")
        return build_scene(path, "off", [MeshPiece("mesh", positions, vertices, normals, uv_sets)], messages=messages)


@dataclass(frozen=True)
class _OffHeader:
    """The word at the start of an OFF, and its counts.

    dimension   coordinates of a vertex; the last of four divides the others
    """

    vertices: int
    faces: int
    dimension: int
    normals: bool
    uvs: bool

    @property
    def width(self) -> int:
        """The numbers of a vertex, without its colour, which stands before the UVs."""
        return self.dimension + 3 * self.normals + 2 * self.uvs

    def __str__(self) -> str:
        """Return the counts in words."""
        return f"it promises {counted(self.vertices, 'vertex', 'vertices')} and {counted(self.faces, 'face')}"


def _off_header(path: Path, text: bytes) -> tuple[_OffHeader, int]:
    """Return the header and where it ends; the word OFF may be missing, or glued to the counts."""
    keyword = _OFF_KEYWORD.match(text)
    start = keyword.end() if keyword else 0
    uvs, normals, homogeneous, any_dimension = (bool(keyword and keyword[group]) for group in (1, 3, 4, 5))
    if re.match(rb"\s*BINARY", text[start:]):
        raise InputError(f"{path}: is a binary OFF, ASCII was expected; export it as that, or as PLY")
    if any_dimension:
        stated = re.compile(rb"\s*(\d+)(?=\s)").match(text, start)
        if stated is None or stated[1] != b"3":
            found = "unknown" if stated is None else stated[1].decode()
            raise InputError(f"{path}: is an OFF of dimension {found}, 3 was expected; project the model")
        start = stated.end()
    counts = _OFF_COUNTS.match(text, start)
    if counts is None:
        raise damaged_file(path, f"it starts with {text[:24].decode('latin-1')!a}, OFF and its counts were expected")
    return _OffHeader(int(counts[1]), int(counts[2]), 4 if homogeneous else 3, normals, uvs), counts.end()


def _off_lines(path: Path, header: _OffHeader, lines: _Lines) -> tuple[_Lines, _Lines]:
    """Return the words of each vertex and each face; raises InputError unless they are as many as the header says."""
    total = header.vertices + header.faces
    if len(lines) == total:
        return lines[: header.vertices], lines[header.vertices :]
    words = [word for line in lines for word in line]
    width, at = header.width, header.vertices * header.width
    if at <= len(words) and not all(len(line) == width or _is_face(line) for line in lines):  # they break anywhere
        faces: _Lines = []
        while len(faces) < header.faces and at < len(words) and words[at].isdigit():
            at, start = at + 1 + int(words[at]), at
            faces.append(words[start:at])
        if len(faces) == header.faces and at == len(words):
            return [words[i * width : (i + 1) * width] for i in range(header.vertices)], faces
    raise damaged_file(path, f"{header}, but has {counted(len(lines), 'line')} for them")


def _is_face(words: list[bytes]) -> bool:
    return words[0].isdigit() and len(words) == int(words[0]) + 1


def _off_vertices(path: Path, header: _OffHeader, lines: _Lines) -> NDArray[np.float64]:
    """Return the numbers of each vertex without its colour, (vertices, header.width)."""
    width = max(header.width, len(lines[0]) if lines else 0)  # with the colour, which all have or none
    uvs = 2 * header.uvs
    rows = lines
    if width > header.width:
        rows = [[*line[: header.width - uvs], *line[len(line) - uvs :]] for line in lines]
    try:
        if all(len(line) == width for line in lines):
            return np.array(rows, dtype=np.float64).reshape(-1, header.width)
    except ValueError:
        pass
    number, line = next((n, line) for n, line in enumerate(lines) if len(line) != width or not are_numbers(line))
    raise damaged_file(path, f"vertex {number} is {_shown(line)}, {width} numbers were expected; {header}")


def _off_faces(path: Path, header: _OffHeader, lines: _Lines) -> list[list[int]]:
    """Return the vertices of each face: as many as its first number says, before any colour."""
    faces = []
    for number, words in enumerate(lines):
        try:
            count = int(words[0])
            faces.append(list(map(int, words[1 : count + 1])))
            if count < 0 or len(words) <= count or not abs(max(faces[-1], key=abs, default=0)) < _MAX_INDEX:
                raise ValueError
        except (ValueError, OverflowError):
            expected = f"the number of its corners and their vertices were expected; {header}"
            raise damaged_file(path, f"face {number} is {_shown(words)}, {expected}") from None
    return faces


def _shown(words: list[bytes]) -> str:
    return ascii(b" ".join(words[:20]).decode("latin-1")[:60])
