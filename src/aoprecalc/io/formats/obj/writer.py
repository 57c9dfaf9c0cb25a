"""Write Wavefront OBJ with an MTL that shows the ambient occlusion as the diffuse texture, or beside it."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.base import (
    MaterialUse,
    MeshWithAo,
    material_names,
    material_use,
    output_uvs,
    source_polygons,
)
from aoprecalc.io.formats.obj.materials import MtlMaterial, names_texture, relocate_line
from aoprecalc.io.formats.obj.reader import ObjDocument, statement
from aoprecalc.io.formats.polygons import OutputFaces
from aoprecalc.io.outputs import Outputs, relative_path
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.types import Atlas, BoolArray, Float32Array, Int64Array, Part, Scene

_WHITE = "Kd 1 1 1"


def library_lines(
    document: ObjDocument, names: dict[MaterialUse, str], source: Path, target: Path, texture: str, kept: bool
) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines of an MTL at `target`, and what the user should know.

    names     of `material_names`
    source    the mesh whose materials they are
    texture   how the MTL calls the texture
    kept      the texture lies on the mesh's own UVs, so that all other pictures stay; it is map_Ka beside a map_Kd

    Materials that no part has, and those of parts that do not receive, stay as they are.
    """
    unknown = [MtlMaterial(material or "") for material, _ in names if material not in document.materials]
    lines: list[str] = []
    lost = 0  # materials that part with pictures
    for material in (*document.materials.values(), *dict.fromkeys(unknown)):
        name = material.name or None
        plain, occluded = names.get((name, False)), names.get((name, True))
        here = [relocate_line(line, source, target) for line in material.lines]
        if plain or not occluded:
            lines += [f"newmtl {plain or name}", *(here or [_WHITE]), ""]
        if occluded:
            stay = [line for line in here if not (_is_ambient(line) if kept else names_texture(line))]
            lost += len(stay) < len(here)
            statement = "map_Ka" if kept and material.texture else "map_Kd"
            lines += [f"newmtl {occluded}", *(stay or [_WHITE]), f"{statement} {texture}", ""]
    if not lost:
        return lines, ()
    if kept:
        return lines, (f"{lost} materials had an ambient texture (map_Ka) of their own, which was replaced",)
    return lines, (f"{target}: an MTL holds one set of UVs; the other textures of its materials are left out",)


def _is_ambient(line: str) -> bool:
    return line.lower().startswith("map_ka")


# Says a scene that came from another kind of file in the words of an OBJ, for the writer to go on with.

POSITION, UV, NORMAL = "v {!r} {!r} {!r}", "vt {!r} {!r}", "vn {:.9g} {:.9g} {:.9g}"


def new_document(scene: Scene) -> ObjDocument:
    """Return the OBJ: an object for each part, no materials, bare `f` lines (what they say is in `corners`)."""
    polygons = source_polygons(scene)
    corners = np.full((polygons.counts.sum(), 3), -1, dtype=np.int32)
    corners[polygons.triangles, 0] = scene.faces
    lines = row_lines(POSITION, scene.positions)
    for column, (template, values) in enumerate(((UV, scene.uvs), (NORMAL, scene.normals)), 1):
        if values is not None:
            rows = values.reshape(-1, values.shape[2])
            first, which = unique_rows(rows)
            corners[polygons.triangles, column] = which.reshape(-1, 3)
            lines += row_lines(template, rows[first])

    starts = [0, *(polygons.owners[part.start] for part in scene.parts[1:]), len(polygons.counts)]
    for part, start, stop in zip(scene.parts, starts, starts[1:], strict=False):
        lines += [f"o {' '.join(part.name.split()) or 'mesh'}", *["f"] * (stop - start)]
    return ObjDocument(polygons, {}, "\n".join(lines), corners, scene.normals is not None)


def row_lines(template: str, rows: NDArray[Any]) -> list[str]:
    """Return a line for each row of numbers, with digits enough to tell float64 (UV, POSITION) or float32 apart."""
    return [template.format(*row) for row in rows.tolist()]


# Changes the lines of an OBJ: the faces of what was baked get UVs and normals, all else stays as it was.


@dataclass(frozen=True, eq=False)
class _Rows:
    """The `vt`, or the `vn`, of the faces to write.

    numbers   (n,) of each corner, counted from 1; 0 for none
    lines     all that there are, for the place before the first face; None: those of the file stay where they are
    """

    numbers: Int64Array
    lines: list[str] | None


def edit_lines(
    document: ObjDocument, scene: Scene, atlas: Atlas, normals: Float32Array, names: Mapping[MaterialUse, str]
) -> list[str]:
    """Return the lines of a scene's document with the atlas's UVs and these normals on the parts that receive.

    names   how the materials of the parts are called

    Vertices keep their lines and their numbers; `vt` and `vn` do where the file's own were used. A polygon is cut into
    its triangles where a seam runs through it. Libraries of materials are left out.
    """
    receives, polygons = scene.receives, document.polygons
    new_uvs = receives & (atlas.uv_set != 0)
    new_normals = receives & (not _has_normals(document, scene, normals))
    uvs = np.where(new_uvs[:, None, None], output_uvs(scene, atlas), 0.0)
    shading = np.where(new_normals[:, None, None], normals, np.float32(0))

    faces = polygons.merge_triangles([uvs, shading], decisive=atlas.mapped | ~new_uvs)
    vertices, old_uvs, old_normals = document.corners[polygons.triangles.reshape(-1)[faces.corners]].T
    lines = document.text.split("\n")
    vt = _rows(lines, "vt", old_uvs, UV, uvs, new_uvs, faces)
    vn = _rows(lines, "vn", old_normals, NORMAL, shading, new_normals, faces)
    texts = _face_texts(faces.counts, vertices + 1, vt.numbers, vn.numbers)

    ends = np.searchsorted(faces.owners, np.arange(len(polygons.counts)), side="right").tolist()
    starts = [int(polygons.owners[part.start]) for part in scene.parts]  # the first `f` line of each
    return _edited(lines, _Materials(starts, scene.parts, names), vt, vn, texts, ends)


def _has_normals(document: ObjDocument, scene: Scene, normals: Float32Array) -> bool:
    """Tell whether the file's lines have the normals that were used."""
    where = scene.receives
    own = scene.normals if document.normals_complete else None
    return own is not None and np.array_equal(own[where], normals[where])


def _rows(
    lines: Sequence[str],
    keyword: str,
    old: Int64Array,
    template: str,
    values: NDArray[Any],
    new: BoolArray,
    faces: OutputFaces,
) -> _Rows:
    """Number the (t, 3, c) values of the triangles that are `new`, (t,), after the lines that other faces need."""
    is_new = np.repeat(new, 3)[faces.corners]
    if not is_new.any():
        return _Rows(old + 1, None)
    kept = [line for line in lines if statement(line)[0] == keyword] if (old[~is_new] >= 0).any() else []
    rows = values.reshape(-1, values.shape[2])[faces.corners[is_new]]
    first, which = unique_rows(rows)
    numbers = old + 1
    numbers[is_new] = len(kept) + 1 + which
    return _Rows(numbers, kept + row_lines(template, rows[first]))


def _face_texts(counts: Int64Array, vertices: Int64Array, uvs: Int64Array, normals: Int64Array) -> list[str]:
    """Return the `f` line of each face; a face has UVs, or normals, where all of its corners do."""
    starts = np.cumsum(counts) - counts
    has_uvs, has_normals = (np.minimum.reduceat(numbers, starts) > 0 for numbers in (uvs, normals))
    kinds = counts * 4 + has_uvs * 2 + has_normals
    texts = np.empty(len(counts), dtype=object)
    for kind in np.unique(kinds).tolist():
        size, with_uvs, with_normals = kind // 4, kind & 2, kind & 1
        chosen = np.flatnonzero(kinds == kind)
        around = starts[chosen][:, None] + np.arange(size)
        columns = [vertices, *([uvs] if with_uvs else []), *([normals] if with_normals else [])]
        corner = "%d" + ("/%d" if with_uvs else "/" if with_normals else "") + ("/%d" if with_normals else "")
        template = f"f {' '.join([corner] * size)}"
        rows = np.stack([column[around] for column in columns], axis=2).reshape(len(chosen), -1)
        texts[chosen] = [template % tuple(row) for row in rows.tolist()]
    return list(texts)


class _Materials:
    """Which `usemtl` is due where.

    starts   the first `f` line of each part
    """

    def __init__(self, starts: list[int], parts: Sequence[Part], names: Mapping[MaterialUse, str]) -> None:
        self._starts = starts
        self._own = [material_use(part)[0] for part in parts]
        self._names = [names[material_use(part)] for part in parts]
        self.at_face = dict(zip(starts, self._names, strict=True))

    def named(self, material: str | None, face: int) -> str | None:
        """Return what a `usemtl` that stands before an `f` line should name."""
        part = bisect_left(self._starts, face)
        return self._names[part] if part < len(self._own) and self._own[part] == material else material


def _edited(
    lines: Sequence[str], materials: _Materials, vt: _Rows, vn: _Rows, texts: Sequence[str], ends: Sequence[int]
) -> list[str]:
    """Return the lines with other faces: `texts` up to ends[0] for the first `f` line, and so on."""
    dropped = {"mtllib", *(["vt"] if vt.lines is not None else []), *(["vn"] if vn.lines is not None else [])}
    result: list[str] = []
    face, written, current = 0, 0, None
    for line in lines:
        keyword, _, rest = statement(line)
        if keyword == "f":
            if face == 0:
                result += [*(vt.lines or ()), *(vn.lines or ())]
            wanted = materials.at_face.get(face, current)
            if wanted != current:
                current = wanted
                result.append(f"usemtl {current}")
            result += texts[written : ends[face]]
            written = ends[face]
            face += 1
        elif keyword == "usemtl":
            current = materials.named(rest.strip() or None, face)
            result.append(f"usemtl {current or ''}".rstrip())
        elif keyword in ("l", "p") and "vt" in dropped:
            result.append(" ".join([keyword, *(word.partition("/")[0] for word in rest.split())]))
        elif keyword not in dropped:
            result.append(line)
    return result


def write_obj(outputs: Outputs, path: Path, mesh: MeshWithAo) -> tuple[str, ...]:
    """Write an OBJ and, beside it, an MTL of the same stem; return warnings.

    The lines of an OBJ source are kept except the faces that receive. Their materials show the texture as map_Kd and
    lose their other textures, which were made for other UVs. Where the file's own UVs were used the textures stay, and
    a material with a map_Kd shows the baked texture as map_Ka.
    """
    scene, atlas = mesh.scene, mesh.atlas
    document = scene.document if isinstance(scene.document, ObjDocument) else new_document(scene)
    names = material_names(scene.parts, document.materials)
    library = path.with_suffix(".mtl")
    edited = edit_lines(document, scene, atlas, mesh.normals, names)
    outputs.path(path).write_bytes(_encode([f"mtllib {library.name}", *edited]))
    texture = relative_path(mesh.texture, path)
    lines, warnings = library_lines(document, names, scene.path, library, texture, kept=atlas.uv_set == 0)
    outputs.path(library).write_bytes(_encode(lines))
    return warnings


def _encode(lines: Sequence[str]) -> bytes:
    return ("\n".join(lines).rstrip("\n") + "\n").encode("utf-8", "surrogateescape")
