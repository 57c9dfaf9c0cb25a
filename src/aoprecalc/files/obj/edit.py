"""Changes the lines of an OBJ: the faces of what was baked get UVs and normals, all else stays as it was."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.distinct import distinct_rows
from aoprecalc.files.obj.fresh import NORMAL, UV, row_lines
from aoprecalc.files.obj.library import Use, material_use
from aoprecalc.files.obj.reader import ObjDocument, statement
from aoprecalc.files.one_set import placed_uvs
from aoprecalc.files.polygons import Faces, Indices
from aoprecalc.model import Atlas, Floats, Mask, Part, Scene


@dataclass(frozen=True, eq=False)
class _Rows:
    """The `vt`, or the `vn`, of the faces to write.

    numbers   (n,) of each corner, counted from 1; 0 for none
    lines     all that there are, for the place before the first face; None: those of the file stay where they are
    """

    numbers: Indices
    lines: list[str] | None


def edit_lines(
    document: ObjDocument, scene: Scene, atlas: Atlas, normals: Floats, names: Mapping[Use, str]
) -> list[str]:
    """Return the lines of a scene's document with the atlas's UVs and these normals on the parts that receive.

    names   how the materials of the parts are called

    Vertices keep their lines and their numbers; `vt` and `vn` do where the file's own were used. A polygon is cut into
    its triangles where a seam runs through it. Libraries of materials are left out.
    """
    receives, polygons = scene.receives, document.polygons
    new_uvs = receives & (atlas.uv_set != 0)
    new_normals = receives & (not _has_normals(document, scene, normals))
    uvs = np.where(new_uvs[:, None, None], placed_uvs(scene, atlas), 0.0)
    shading = np.where(new_normals[:, None, None], normals, np.float32(0))

    faces = polygons.rejoin([uvs, shading], decides=atlas.covers | ~new_uvs)
    vertices, old_uvs, old_normals = document.corners[polygons.triangles.reshape(-1)[faces.corners]].T
    lines = document.text.split("\n")
    vt = _rows(lines, "vt", old_uvs, UV, uvs, new_uvs, faces)
    vn = _rows(lines, "vn", old_normals, NORMAL, shading, new_normals, faces)
    texts = _face_texts(faces.counts, vertices + 1, vt.numbers, vn.numbers)

    ends = np.searchsorted(faces.owners, np.arange(len(polygons.counts)), side="right").tolist()
    starts = [int(polygons.owners[part.start]) for part in scene.parts]  # the first `f` line of each
    return _edited(lines, _Materials(starts, scene.parts, names), vt, vn, texts, ends)


def _has_normals(document: ObjDocument, scene: Scene, normals: Floats) -> bool:
    """Tell whether the file's lines have the normals that were used."""
    where = scene.receives
    own = scene.normals if document.whole_normals else None
    return own is not None and np.array_equal(own[where], normals[where])


def _rows(
    lines: Sequence[str], keyword: str, old: Indices, template: str, values: NDArray[Any], new: Mask, faces: Faces
) -> _Rows:
    """Number the (t, 3, c) values of the triangles that are `new`, (t,), after the lines that other faces need."""
    is_new = np.repeat(new, 3)[faces.corners]
    if not is_new.any():
        return _Rows(old + 1, None)
    kept = [line for line in lines if statement(line)[0] == keyword] if (old[~is_new] >= 0).any() else []
    rows = values.reshape(-1, values.shape[2])[faces.corners[is_new]]
    first, which = distinct_rows(rows)
    numbers = old + 1
    numbers[is_new] = len(kept) + 1 + which
    return _Rows(numbers, kept + row_lines(template, rows[first]))


def _face_texts(counts: Indices, vertices: Indices, uvs: Indices, normals: Indices) -> list[str]:
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

    def __init__(self, starts: list[int], parts: Sequence[Part], names: Mapping[Use, str]) -> None:
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
