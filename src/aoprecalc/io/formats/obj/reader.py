"""Read Wavefront OBJ: every group and material, polygons, UVs and normals on the corners, as they are in the file.

trimesh's reader is not used for this format: it regroups the faces by material, counts relative indices from the
end of the file, takes index 0 for the first vertex, and drops all UVs where one face has none.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, one_or_many
from aoprecalc.io.formats.base import SourceDocument
from aoprecalc.io.formats.builder import MeshPiece, build_scene, damaged_file
from aoprecalc.io.formats.files import FileSearch, are_numbers
from aoprecalc.io.formats.obj.materials import (
    MtlMaterial,
    examine_maps,
    joined_lines,
    library_files,
    material_files,
    read_materials,
)
from aoprecalc.io.formats.polygons import Polygons, lost_faces, polygon_triangles
from aoprecalc.io.formats.textures import PartSource
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import Float32Array, Float64Array, Int32Array, Material, Scene

_LIBRARY = re.compile(r"^[ \t]*mtllib[ \t]+([^\n]+)", re.MULTILINE)


@dataclass(frozen=True)
class Section(PartSource):
    """The `o`, `g` and `usemtl` that hold for a run of faces; None where none was given."""

    object: str | None = None
    group: str | None = None

    @property
    def name(self) -> str:
        """The name of the part: its group, else its object, else its material."""
        return self.group or self.object or self.material or "mesh"


@dataclass(frozen=True, eq=False)
class ObjDocument(SourceDocument):
    """An OBJ file, for writing it back; `polygons` has one polygon for each `f` line.

    text               all its lines, continued ones joined
    corners            (c, 3) int32: the v, vt and vn of each corner of each `f` line, from 0; -1 for none
    normals_complete   every corner has a normal that is not zero
    libraries          the MTL files it names
    vertex_colors      (v, 3) float32, linear, with alpha (v, 4); None where no `v` line has any
    """

    materials: Mapping[str, MtlMaterial]
    text: str
    corners: Int32Array
    normals_complete: bool
    libraries: tuple[Path, ...] = ()
    vertex_colors: Float32Array | None = None

    def colors(self, scene: Scene) -> Float32Array | None:
        """Return the linear colours at the corners of the faces, (f, 3, 3 or 4); None where it has none."""
        if self.vertex_colors is None:
            return None
        return np.concatenate([self.vertex_colors[part.vertices] for part in scene.parts])


@dataclass(frozen=True)
class _Lines:
    """The lines of an OBJ by keyword, without it.

    faces     as text
    above     how many v, vt and vn precede each face: relative indices count from there
    sections  (section, index of its first face)
    """

    v: list[str]
    vt: list[str]
    vn: list[str]
    faces: list[str]
    above: list[tuple[int, int, int]]
    sections: list[tuple[Section, int]]
    libraries: list[str]


def read_obj(path: Path, data: bytes) -> Scene:
    """Read an OBJ file of the given bytes, and the MTL files it names where they lie beside it.

    Raises InputError where it is damaged or has no usable faces.
    """
    written = data.decode("utf-8", "surrogateescape")
    text = joined_lines(written)
    lines = _sort_lines(text)
    positions = _numbers(path, written, "v", "vertex (v)", lines.v, 3, 3)
    uvs = _numbers(path, written, "vt", "texture coordinate (vt)", lines.vt, 1, 2)
    normals = _numbers(path, written, "vn", "normal (vn)", lines.vn, 3, 3)
    counts, corners = _corners(path, written, lines, (len(positions), len(uvs), len(normals)))
    triangles, owners = polygon_triangles(counts, corners[:, 0], positions)
    polygons = Polygons(counts, triangles, owners)
    messages = list(lost_faces(counts))

    libraries = _libraries(path, lines.libraries)
    materials = read_materials(path.parent, libraries)
    sections = list(_sections_with_faces(lines.sections, len(counts)))
    used = dict.fromkeys(section.material for section, _, _ in sections if section.material is not None)
    if libraries and (unknown := [name for name in used if name not in materials]):
        messages.append(_unknown_materials(unknown, libraries))
    examined = {name: examine_maps(materials[name]) for name in used if name in materials}
    for name, found in examined.items():
        materials[name] = found.material
        messages += found.messages

    pieces = []
    for section, start, stop in sections:
        first, last = np.searchsorted(owners, [start, stop])
        position, uv, normal = np.moveaxis(corners[triangles[first:last]], 2, 0)
        at_corners = _rows_at(uvs, uv)
        uv_sets = () if at_corners is None else (at_corners,)
        names = (section.object, section.group, section.material)
        material = examined[section.material].at(at_corners) if section.material in examined else Material()
        piece = MeshPiece(section.name, positions, position, _rows_at(normals, normal), uv_sets, section, names)
        pieces.append(replace(piece, material=material))
    if not pieces:
        pieces = [MeshPiece("mesh", positions, np.empty((0, 3), dtype=np.int64))]
    normals_complete = bool(
        (corners[:, 2] >= 0).all() and (np.isfinite(normals).all(axis=1) & normals.any(axis=1)).all()
    )
    vertex_colors = _vertex_colors(lines.v)
    document = ObjDocument(
        polygons, materials, text, corners.astype(np.int32), normals_complete, libraries, vertex_colors
    )
    return build_scene(path, "obj", pieces, document, messages)


def _unknown_materials(names: Sequence[str], libraries: Sequence[Path]) -> Note:
    """Return the note about materials that no MTL file has."""
    missing = [file.name for file in libraries if not os.path.isfile(file)]
    why = (
        f"{', '.join(missing)} {one_or_many(len(missing), 'is', 'are')} not there" if missing else "no MTL file has it"
    )
    have = one_or_many(len(names), "has", "have")
    return Note(f"{counted(len(names), 'material')} {have} no colours or pictures, such as {names[0]!a}: {why}")


def obj_files(path: Path, data: bytes) -> list[Path]:
    """Return the MTL files that an OBJ file of the given bytes names, and the textures that these name."""
    libraries = _libraries(path, _LIBRARY.findall(joined_lines(data.decode("utf-8", "surrogateescape"))))
    return [*libraries, *material_files(read_materials(path.parent, libraries).values())]


def _libraries(path: Path, statements: Sequence[str]) -> tuple[Path, ...]:
    """Return the MTL files that the `mtllib` statements name, existing or not, and the one with the stem of the OBJ.

    Programs read that too (Blender): an OBJ that was renamed with its MTL still names the old one.
    """
    search = FileSearch(path.parent)
    files = library_files(search, statements)
    own = search.find(f"{path.stem}.mtl")
    return (*files, own) if own is not None and own not in files else files


def statement(line: str) -> tuple[str, str, str]:
    """Split a line into its keyword, a space and what follows."""
    return line.strip().replace("\t", " ").partition(" ")


def _sort_lines(text: str) -> _Lines:
    lines = _Lines([], [], [], [], [], [(Section(), 0)], [])
    keep = {"v": lines.v, "vt": lines.vt, "vn": lines.vn}
    section = Section()
    for line in text.split("\n"):
        keyword, _, rest = statement(line)
        if keyword in keep:
            keep[keyword].append(rest)
        elif keyword == "f":
            lines.faces.append(rest.partition("#")[0])
            lines.above.append((len(lines.v), len(lines.vt), len(lines.vn)))
        elif keyword in ("o", "g", "usemtl"):
            name = rest.strip() or None
            section = Section(
                object=name if keyword == "o" else section.object,
                group=name if keyword == "g" else None if keyword == "o" else section.group,
                material=name if keyword == "usemtl" else section.material,
            )
            lines.sections.append((section, len(lines.faces)))
        elif keyword == "mtllib":
            lines.libraries.append(rest.strip())
    return lines


def _numbers(
    path: Path, text: str, keyword: str, what: str, rows: list[str], min_count: int, width: int
) -> Float64Array:
    """Parse rows of at least min_count numbers, (len(rows), width) float64; missing ones are 0.

    text   the file, in which these are the statements of a keyword
    """
    split = [row.split(None, width)[:width] for row in rows]
    try:
        if all(len(row) == width for row in split):
            return np.array(split, dtype=np.float64).reshape(-1, width)
        table = np.zeros((len(split), width))
        for index, row in enumerate(split):
            if len(row) < min_count:
                raise ValueError
            table[index, : len(row)] = [float(number) for number in row]
    except ValueError:
        index, row_text = next(
            (index, row) for index, row in enumerate(rows) if not _starts_with_numbers(row.split()[:width], min_count)
        )
        found = f"{what} number {index + 1} is {row_text[:60]!a}, {min_count} numbers were expected"
        raise damaged_file(path, f"{_line(text, keyword, index)}: {found}") from None
    return table


def _vertex_colors(rows: list[str]) -> Float32Array | None:
    """Return the linear colours that follow the coordinates of vertices, (v, 3), with alpha (v, 4); None where none do.

    As ZBrush and MeshLab write them: red, green, blue in sRGB, and alpha; beyond 1 they count up to 255. A number alone
    is the weight w. Vertices without are white.
    """
    words = [row.partition("#")[0].split()[3:7] for row in rows]
    widths = {len(row) for row in words if len(row) >= 3}
    if not widths:
        return None
    colors = np.ones((len(rows), max(widths)))
    for color, row in zip(colors, words, strict=True):
        if _starts_with_numbers(row, 3):
            color[: len(row)] = [float(word) for word in row]
    colors = np.nan_to_num(colors, nan=1.0)
    colored = [index for index, row in enumerate(words) if len(row) >= 3]
    if colors.max() > 1:
        colors[colored] /= 255
    colors = np.clip(colors, 0, 1)
    return np.concatenate([linear_from_srgb(colors[:, :3]), colors[:, 3:]], axis=1, dtype=np.float32)


def _starts_with_numbers(words: Sequence[str], min_count: int) -> bool:
    return len(words) >= min_count and are_numbers(words)


def _line(text: str, keyword: str, index: int) -> str:
    """Return where the statement `index` of a keyword begins in a text: "line 3"."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    starts = (number for number, line in enumerate(lines) if not (number and lines[number - 1].endswith("\\")))
    found = [number + 1 for number in starts if statement(lines[number])[0] == keyword]
    return f"line {found[index]}"


def _corners(
    path: Path, text: str, lines: _Lines, sizes: tuple[int, int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (p,) corner counts of the faces, and the (sum, 3) v, vt and vn of each corner, from 0; -1 for none."""
    split = [face.split() for face in lines.faces]
    counts = np.array([len(words) for words in split], dtype=np.int64)
    words = [word for face in split for word in face]
    try:
        given = _indices(words)
    except (ValueError, OverflowError):
        index, wrong = next(
            (index, face) for index, face in enumerate(split) if not all(_is_corner(word) for word in face)
        )
        found = f"a face is {' '.join(wrong)[:60]!a}, corners such as 1, 1/2 or 1/2/3 were expected"
        raise damaged_file(path, f"{_line(text, 'f', index)}: {found}") from None
    above = np.repeat(np.array(lines.above, dtype=np.int64).reshape(-1, 3), counts, axis=0)
    corners = np.where(given < 0, above + given, given - 1)
    for column, what in enumerate(("v", "vt", "vn")):
        absent = given[:, column] == 0 if column else np.zeros(len(given), dtype=bool)
        wrong_corner = ~absent & ((corners[:, column] < 0) | (corners[:, column] >= sizes[column]))
        if wrong_corner.any():
            corner = np.flatnonzero(wrong_corner)[0]
            face = int(np.repeat(np.arange(len(counts)), counts)[corner])
            found = f"a face refers to {what} {given[corner, column]}, but there are {sizes[column]} (counted from 1)"
            raise damaged_file(path, f"{_line(text, 'f', face)}: {found}")
    return counts, corners


def _indices(words: list[str]) -> NDArray[np.int64]:
    """Parse corners such as 1/2/3 to (n, 3) indices as written, 0 where left out; raises ValueError.

    Some programs write the slashes of what is left out behind it, too: 1/2/, 1// and 1/.
    """
    slashes = {word.count("/") for word in words}
    if len(slashes) == 1:
        (number,) = slashes
        if number <= 2:
            flat = "/".join(f"{word}0" if word.endswith("/") else word for word in words)
            if number == 2:
                flat = flat.replace("//", "/0/")
            numbers = np.array([int(word) for word in flat.split("/")], dtype=np.int64).reshape(-1, number + 1)
            return np.pad(numbers, ((0, 0), (0, 2 - number)))
    table = np.zeros((len(words), 3), dtype=np.int64)
    for row, word in zip(table, words, strict=True):
        first, *others = word.split("/")
        row[: 1 + len(others)] = [int(first), *(int(other or 0) for other in others)]
    return table


def _is_corner(word: str) -> bool:
    try:
        _indices([word])
    except (ValueError, OverflowError):
        return False
    return True


def _sections_with_faces(sections: list[tuple[Section, int]], faces: int) -> Iterator[tuple[Section, int, int]]:
    """Yield (section, first face, end) of the sections that have faces; equal neighbours are merged."""
    ends = [start for _, start in sections[1:]] + [faces]
    pending: tuple[Section, int, int] | None = None
    for (section, start), stop in zip(sections, ends, strict=True):
        if start == stop:
            continue
        if pending is not None and pending[0] == section:
            pending = (section, pending[1], stop)
            continue
        if pending is not None:
            yield pending
        pending = (section, start, stop)
    if pending is not None:
        yield pending


def _rows_at(table: Float64Array, indices: NDArray[np.int64]) -> Float64Array | None:
    """Return table[indices], NaN where an index is -1; None if all are -1."""
    if not (indices >= 0).any():
        return None
    return np.where((indices >= 0)[:, :, None], table[indices], np.nan)
