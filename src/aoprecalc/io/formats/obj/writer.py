"""Write Wavefront OBJ with an MTL that shows the ambient occlusion as the diffuse texture, or beside it."""

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, listed
from aoprecalc.io.formats.base import MeshWithAo, TextureReference, WrittenMesh, source_polygons
from aoprecalc.io.formats.files import TextureCopies, file_beside, same_file
from aoprecalc.io.formats.obj.materials import MtlMaterial, TextureMap
from aoprecalc.io.formats.obj.reader import ObjDocument, statement
from aoprecalc.io.formats.polygons import NewUvs, OutputFaces, cut_note
from aoprecalc.io.formats.textures import MaterialUse, MeshTexture, material_names, material_uses
from aoprecalc.io.outputs import Outputs, relative_path
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.progress import Note
from aoprecalc.types import BoolArray, Float32Array, Int64Array, Scene

_MAX_NAMES = 8  # of textures in a message
_WHITE = "Kd 1 1 1"  # the diffuse colour of a material without lines


def library_lines(
    document: ObjDocument,
    names: dict[MaterialUse, str],
    target: Path,
    textures: Sequence[MeshTexture],
    copies: TextureCopies,
) -> tuple[list[str], WrittenMesh]:
    """Return the lines of an MTL at `target`, where they refer to the baked textures, and warnings.

    names     of the materials in the output, see `material_names`
    copies    names the other textures of the materials that are used

    Where the bake used the mesh's own UVs, other textures stay, and beside a map_Kd the baked one is map_Ka.

    Unused materials, and those of parts that do not receive, stay as they are.
    """
    unknown = [MtlMaterial(material or "") for material, _ in names if material not in document.materials]
    lines: list[str] = []
    slots = Counter[str]()
    stayed: dict[str, list[TextureMap]] = {}  # the textures that materials lose where their UVs stay
    lost: dict[str, list[TextureMap]] = {}  # and where they get new ones
    kept_maps: list[TextureMap] = []
    for material in (*document.materials.values(), *dict.fromkeys(unknown)):
        name = material.name or None
        plain = names.get((name, -1))
        baked = {index: made for (used, index), made in names.items() if used == name and index >= 0}
        if plain or not baked:
            lines += [f"newmtl {plain or name}", *_statements(material.lines, target, copies if plain else None), ""]
            kept_maps += [] if baked else material.maps
        for index, made in baked.items():
            kept = textures[index].atlas.uv_set == 0
            remaining = [line for line in material.lines if not _replaced(line, material, kept)]
            if replaced := [line for line in material.maps if _replaced(line, material, kept)]:
                (stayed if kept else lost)[made] = replaced
            slot = "map_Ka" if kept and material.texture else "map_Kd"
            slots[slot] += 1
            shown = f"{slot} {relative_path(textures[index].path, target)}"
            lines += [f"newmtl {made}", *_statements(remaining, target, copies), shown, ""]
            kept_maps += [line for line in remaining if isinstance(line, TextureMap)]
    messages = list[str]()
    if stayed:
        ambient = all(line.keyword == "map_ka" for replaced in stayed.values() for line in replaced)
        which = "ambient textures (map_Ka)" if ambient else "textures of an earlier bake"
        messages.append(Note(f"the {which} of {counted(len(stayed), 'material')} were replaced"))
    if lost:
        left_out = _names(line for replaced in lost.values() for line in replaced)
        found = "an MTL holds one set of UVs; the other textures of its materials are left out"
        if not (document.corners[:, 1] >= 0).any():
            found = "the mesh had no UVs for the textures of its materials, which are left out"
        messages.append(f"{target}: {found}: {left_out}")
    missing = [line for line in kept_maps if not line.found]
    if moved := [line for line in missing if not same_file(file_beside(target.parent, line.name), line.file)]:
        messages.append(f"{target}: names textures that were not there before the bake: {_names(moved)}")
    references = tuple(TextureReference(slot, "vt", materials) for slot, materials in slots.items())
    return lines, WrittenMesh(references, tuple(messages))


def _names(maps: Iterable[TextureMap]) -> str:
    """Return the names of textures for a message."""
    names = list(dict.fromkeys(f"{line.name!a}" for line in maps))
    return listed(names, _MAX_NAMES)


def _statements(lines: Sequence[str | TextureMap], target: Path, copies: TextureCopies | None) -> list[str]:
    """Return the statements of a material for an MTL at `target`; without `copies` textures keep their place."""
    return [line if isinstance(line, str) else line.relocated(target, copies) for line in lines] or [_WHITE]


def _replaced(line: str | TextureMap, material: MtlMaterial, kept: bool) -> bool:
    """Tell whether the baked texture replaces that of a line, which may be that of an earlier bake."""
    if not isinstance(line, TextureMap):
        return False
    return not kept or line.keyword == "map_ka" or (line.keyword == "map_kd" and material.texture is None)


# float64 positions and UVs, float32 normals; the digits give the same values back.
_POSITION, _UV, _NORMAL = "v {!r} {!r} {!r}", "vt {!r} {!r}", "vn {:.9g} {:.9g} {:.9g}"


def new_document(scene: Scene) -> ObjDocument:
    """Make the OBJ of a scene of another format: an object for each part, no materials.

    Its `f` lines are empty: `corners` has their indices.
    """
    polygons = source_polygons(scene)
    corners = np.full((polygons.counts.sum(), 3), -1, dtype=np.int32)
    corners[polygons.triangles, 0] = scene.faces
    lines = _format_rows(_POSITION, scene.positions)
    for column, (template, values) in enumerate(((_UV, scene.uvs), (_NORMAL, scene.normals)), 1):
        if values is not None:
            rows = values.reshape(-1, values.shape[2])
            first, which = unique_rows(rows)
            corners[polygons.triangles, column] = which.reshape(-1, 3)
            lines += _format_rows(template, rows[first])

    starts = [0, *(polygons.owners[part.start] for part in scene.parts[1:]), len(polygons.counts)]
    for part, start, stop in zip(scene.parts, starts, starts[1:], strict=False):
        lines += [f"o {' '.join(part.name.split()) or 'mesh'}", *["f"] * (stop - start)]
    return ObjDocument(polygons, {}, "\n".join(lines), corners, scene.normals is not None)


def _format_rows(template: str, rows: NDArray[Any]) -> list[str]:
    """Return a line for each row of numbers."""
    return [template.format(*row) for row in rows.tolist()]


@dataclass(frozen=True, eq=False)
class _CornerLines:
    """The `vt` or `vn` lines of the faces to write.

    indices   (n,) for each corner, from 1; 0 for none
    lines     all lines, to be written before the first face; None: those of the file stay where they are
    """

    indices: Int64Array
    lines: list[str] | None


def edit_lines(
    document: ObjDocument, mesh: MeshWithAo, names: Mapping[MaterialUse, str]
) -> tuple[list[str], tuple[Note, ...]]:
    """Return the lines of a document with the UVs and the normals of a bake on the parts that receive.

    names   of the materials in the output, see `material_names`

    Vertices keep their lines and indices; so do `vt` and `vn` where the file's own were used. A polygon is cut into its
    triangles where a seam runs through it, or where programs would cut it in other ways than the bake, as a note says.
    The `mtllib` lines are left out.
    """
    scene, normals, polygons = mesh.scene, mesh.normals, document.polygons
    new_uvs = mesh.per_face(texture.atlas.uv_set != 0 for texture in mesh.textures)
    new_normals = scene.receives & (not _has_normals(document, scene, normals))
    uvs = np.where(new_uvs[:, None, None], mesh.uvs, 0.0)
    new_values = np.where(new_normals[:, None, None], normals, np.float32(0))

    mapping = NewUvs(scene.corners, uvs, new_uvs)
    faces = polygons.merge_triangles([uvs, new_values], decisive=mesh.mapped | ~new_uvs, mapping=mapping)
    vertices, old_uvs, old_normals = document.corners[polygons.triangles.reshape(-1)[faces.corners]].T
    lines = document.text.split("\n")
    vt = _corner_lines(lines, "vt", old_uvs, _UV, uvs, new_uvs, faces)
    vn = _corner_lines(lines, "vn", old_normals, _NORMAL, new_values, new_normals, faces)
    texts = _face_texts(faces.counts, vertices + 1, vt.indices, vn.indices)

    ends = np.searchsorted(faces.owners, np.arange(len(polygons.counts)), side="right").tolist()
    starts = [int(polygons.owners[part.start]) for part in mesh.parts]  # the first `f` line of each
    materials = _UsemtlNames(starts, material_uses(mesh.parts, mesh.owners), names)
    edited = _replace_faces(lines, materials, vt, vn, texts, ends)
    return edited, cut_note(faces)


def _has_normals(document: ObjDocument, scene: Scene, normals: Float32Array) -> bool:
    """Tell whether the `vn` lines of the file are the normals that were used."""
    where = scene.receives
    own = scene.normals if document.normals_complete else None
    return own is not None and np.array_equal(own[where], normals[where])


def _corner_lines(
    lines: Sequence[str],
    keyword: str,
    old: Int64Array,
    template: str,
    values: NDArray[Any],
    new: BoolArray,
    faces: OutputFaces,
) -> _CornerLines:
    """Index the (t, 3, c) values of the `new` triangles, (t,) bool, after the lines that other faces need."""
    is_new = np.repeat(new, 3)[faces.corners]
    if not is_new.any():
        return _CornerLines(old + 1, None)
    kept = [line for line in lines if statement(line)[0] == keyword] if (old[~is_new] >= 0).any() else []
    rows = values.reshape(-1, values.shape[2])[faces.corners[is_new]]
    first, which = unique_rows(rows)
    indices = old + 1
    indices[is_new] = len(kept) + 1 + which
    return _CornerLines(indices, kept + _format_rows(template, rows[first]))


def _face_texts(counts: Int64Array, vertices: Int64Array, uvs: Int64Array, normals: Int64Array) -> list[str]:
    """Return the `f` line of each face; it states UVs, or normals, if all corners of the face have them."""
    starts = np.cumsum(counts) - counts
    has_uvs, has_normals = (np.minimum.reduceat(numbers, starts) > 0 for numbers in (uvs, normals))
    kinds = counts * 4 + has_uvs * 2 + has_normals
    texts = np.empty(len(counts), dtype=object)
    for kind in np.unique(kinds).tolist():
        size, with_uvs, with_normals = kind // 4, kind & 2, kind & 1
        chosen = np.flatnonzero(kinds == kind)
        loops = starts[chosen][:, None] + np.arange(size)
        columns = [vertices, *([uvs] if with_uvs else []), *([normals] if with_normals else [])]
        corner = "%d" + ("/%d" if with_uvs else "/" if with_normals else "") + ("/%d" if with_normals else "")
        template = f"f {' '.join([corner] * size)}"
        rows = np.stack([column[loops] for column in columns], axis=2).reshape(len(chosen), -1)
        texts[chosen] = [template % tuple(row) for row in rows.tolist()]
    return list(texts)


class _UsemtlNames:
    """The material names of the `usemtl` lines.

    starts   the index of the first `f` line of each part
    """

    def __init__(self, starts: list[int], uses: Sequence[MaterialUse], names: Mapping[MaterialUse, str]) -> None:
        self._starts = starts
        self._own = [material for material, _ in uses]
        self._names = [names[use] for use in uses]
        self.at_face = dict(zip(starts, self._names, strict=True))

    def named(self, material: str | None, face: int) -> str | None:
        """Return the name for a `usemtl` line that precedes an `f` line."""
        part = bisect_left(self._starts, face)
        return self._names[part] if part < len(self._own) and self._own[part] == material else material


def _replace_faces(
    lines: Sequence[str],
    materials: _UsemtlNames,
    vt: _CornerLines,
    vn: _CornerLines,
    texts: Sequence[str],
    ends: Sequence[int],
) -> list[str]:
    """Replace the first `f` line by texts[: ends[0]], the second by texts[ends[0] : ends[1]], and so on."""
    dropped = {"mtllib", *(["vt"] if vt.lines is not None else []), *(["vn"] if vn.lines is not None else [])}
    result: list[str] = []
    face, written, current = 0, 0, None
    for line in lines:
        keyword, _, rest = statement(line)
        if keyword == "f":
            if face == 0:
                result += [*(vt.lines or ()), *(vn.lines or ())]
            required = materials.at_face.get(face, current)
            if required != current:
                current = required
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


def write_obj(outputs: Outputs, path: Path, mesh: MeshWithAo) -> tuple[WrittenMesh, tuple[Note, ...]]:
    """Write an OBJ and, beside it, an MTL of the same stem.

    The lines of an OBJ source are kept except the faces that receive. Their materials show the texture as map_Kd and
    lose their other textures, which were made for other UVs. Where the file's own UVs were used the textures stay, and
    a material with a map_Kd shows the baked texture as map_Ka. The notes are about polygons that were cut.
    """
    scene = mesh.scene
    document = scene.document if isinstance(scene.document, ObjDocument) else new_document(scene)
    names = material_names(material_uses(mesh.parts, mesh.owners), document.materials, mesh.textures)
    library = path.with_suffix(".mtl")
    edited, notes = edit_lines(document, mesh, names)
    outputs.path(path).write_bytes(_encode([f"mtllib {library.name}", *edited]))
    copies = TextureCopies(outputs, path, scene.path)
    lines, written = library_lines(document, names, library, mesh.textures, copies)
    outputs.path(library).write_bytes(_encode(lines))
    return written, notes


def _encode(lines: Sequence[str]) -> bytes:
    return ("\n".join(lines).rstrip("\n") + "\n").encode("utf-8", "surrogateescape")
