"""The formats of which only geometry is read: STL, OFF, COLLADA and 3MF. A bake of them is written as GLB."""

import logging
import re
import warnings
from collections.abc import Iterator
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, ClassVar
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, cofactors, damaged_file
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.types import REVERSED_WINDING, Atlas, Scene

_HEADER_BYTES = 84  # of a binary STL: 80 bytes of text and the number of faces
_FACE_BYTES = 50
_SOLID = re.compile(r"\s*solid\b", re.IGNORECASE)
_FACET = re.compile(r"^\s*facet\b", re.MULTILINE | re.IGNORECASE)
_VERTEX = re.compile(r"^[ \t]*vertex((?:[ \t]+\S+)*)[ \t]*$", re.MULTILINE | re.IGNORECASE)
_MAX_UNPACKED = 1 << 30  # bytes of a zipped file; as XML that is more triangles than a bake can use

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


# Formats that are read through trimesh: triangles, the placement of each instance, and of COLLADA normals and UVs.


class TrimeshFormat(MeshFormat):
    """A format for which trimesh has a loader.

    packages   which that loader needs, beside trimesh; the extra `formats` installs them
    """

    packages: ClassVar[tuple[str, ...]]

    def read(self, path: Path, data: bytes) -> Scene:
        """Read every instance of every mesh as a part; raises InputError where a package is missing."""
        from trimesh import available_formats  # takes half a second, which other formats should not pay
        from trimesh.exchange.load import mesh_loaders

        kind = path.suffix.lower().removeprefix(".")
        if kind not in available_formats():
            needed = " and ".join(self.packages)
            raise InputError(f"{path}: {self.name} needs the package {needed}; `pip install 'aoprecalc[formats]'`")
        _check_unpacked_size(path, data)
        load: Any = mesh_loaders[kind]
        loaded = load(file_obj=BytesIO(data), file_type=kind, resolver=None)
        return build_scene(path, kind, list(_pieces(loaded)))

    def output_extension(self, scene: Scene, atlas: Atlas | None) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"{self.name} is not written, so the mesh becomes a GLB"


def _check_unpacked_size(path: Path, data: bytes) -> None:
    """Raise InputError for a ZIP that would fill the memory, as a few megabytes of it may."""
    if not data.startswith(b"PK"):
        return
    with ZipFile(BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > _MAX_UNPACKED:
        expected = f"at most {_MAX_UNPACKED >> 30} GiB were expected; use a smaller model"
        raise InputError(f"{path}: is a ZIP of {size / (1 << 30):.1f} GiB when unpacked, {expected}")


def _pieces(loaded: dict[str, Any]) -> Iterator[MeshPiece]:
    """Yield each instance of a geometry, placed in the world, from what a loader of trimesh returns."""
    from trimesh.scene.transforms import SceneGraph

    graph: Any = SceneGraph(base_frame=loaded.get("base_frame", "world"))
    for edge in loaded["graph"]:
        graph.update(**edge)
    for node in graph.nodes_geometry:
        matrix, name = graph.get(node)
        mesh, linear = loaded["geometry"][name], matrix[:3, :3]
        faces = np.asarray(mesh["faces"], np.int64).reshape(-1, 3)
        mirrored = np.linalg.det(linear) < 0
        if mirrored:
            faces = faces[:, REVERSED_WINDING]
        positions = np.asarray(mesh["vertices"], np.float64).reshape(-1, 3) @ linear.T + matrix[:3, 3]
        normals, uvs = mesh.get("vertex_normals"), getattr(mesh.get("visual"), "uv", None)
        if normals is not None:
            normals = (normals @ cofactors(linear).T * (-1 if mirrored else 1))[faces]
        yield MeshPiece(str(node), positions, faces, normals, () if uvs is None else (uvs[faces],), names=(str(name),))


class ColladaFormat(TrimeshFormat):
    """COLLADA, plain or zipped."""

    name = "COLLADA"
    extensions = (".dae", ".zae")
    packages = ("pycollada",)
    not_read = "its materials, other UV sets, skins, animations, cameras and lights"

    def sniff(self, data: bytes) -> bool:
        """Tell whether there is a COLLADA element, or a ZIP with a .dae in it."""
        return b"<COLLADA" in data[:4096] or (data.startswith(b"PK") and b".dae" in data)


class ThreeMfFormat(TrimeshFormat):
    """3D Manufacturing Format."""

    name = "3MF"
    extensions = (".3mf",)
    packages = ("networkx", "lxml")
    not_read = "its materials, colours, beams and print settings"

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a ZIP with a 3D model in it."""
        return data.startswith(b"PK") and b"3dmodel.model" in data.lower()
