"""Writes Wavefront OBJ with an MTL that shows the ambient occlusion as the diffuse texture (map_Kd)."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.distinct import distinct_rows
from aoprecalc.files.obj.materials import Material
from aoprecalc.files.obj.reader import ObjDocument, Section
from aoprecalc.files.references import relative_path
from aoprecalc.model import Atlas, Floats, Part, Scene
from aoprecalc.options import Pack

# MTL statements that name another texture; it was made for other UVs.
_OTHER_MAP = re.compile(r"(map_|bump|disp|decal|refl|norm)", re.IGNORECASE)


def write_obj(
    outputs: Outputs, path: Path, scene: Scene, atlas: Atlas, normals: Floats, texture: Path, pack: Pack = "none"
) -> tuple[str, ...]:
    """Write an OBJ and, beside it, an MTL of the same stem; return what the user should know.

    Positions and UVs have as many digits as tell their float64 values apart, normals those of their float32 values.
    Objects, groups and materials are those of the source; other textures of its materials are left out.
    """
    uv_rows, uv_corners = _number(atlas.uvs)
    normal_rows, normal_corners = _number(normals)
    library = path.with_suffix(".mtl")
    lines = [f"mtllib {library.name}"]
    lines += ["v {!r} {!r} {!r}".format(*row) for row in scene.positions.tolist()]
    lines += ["vt {!r} {!r}".format(*row) for row in uv_rows.tolist()]
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(*row) for row in normal_rows.tolist()]

    corners = np.stack([scene.faces, uv_corners, normal_corners], axis=2).reshape(-1, 9) + 1
    before = Section()
    for part in scene.parts:
        section = _section(part)
        lines += _section_lines(section, before)
        lines += ["f {}/{}/{} {}/{}/{} {}/{}/{}".format(*row) for row in corners[part.start : part.stop].tolist()]
        before = section
    outputs.path(path).write_bytes(_encode(lines))

    known = scene.document.materials if isinstance(scene.document, ObjDocument) else {}
    names = dict.fromkeys(_section(part).material for part in scene.parts)
    materials = [known.get(name or "", Material(name or "")) for name in names]
    outputs.path(library).write_bytes(_encode(_material_lines(materials, relative_path(texture, path))))
    if any(_OTHER_MAP.match(line) for material in materials for line in material.lines):
        return (f"{path}: an MTL holds one set of UVs; the other textures of its materials are left out",)
    return ()


def _section(part: Part) -> Section:
    """Return what stands above a part's faces; every one has a material, so that every one shows the texture."""
    section = part.source if isinstance(part.source, Section) else Section(object=" ".join(part.name.split()) or None)
    return Section(section.object, section.group, section.material or "baked")


def _section_lines(section: Section, before: Section) -> list[str]:
    lines = []
    if section.object is not None and section.object != before.object:
        lines.append(f"o {section.object}")
    if section.group is not None and (section.group, section.object) != (before.group, before.object):
        lines.append(f"g {section.group}")
    if section.material != before.material:
        lines.append(f"usemtl {section.material}")
    return lines


def _material_lines(materials: Sequence[Material], texture: str) -> list[str]:
    lines = []
    for material in materials:
        kept = [line for line in material.lines if not _OTHER_MAP.match(line)]
        lines += [f"newmtl {material.name or 'baked'}", *(kept or ["Kd 1 1 1"]), f"map_Kd {texture}", ""]
    return lines


def _number(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return the distinct rows of (f, 3, c) values, and (f, 3) which of them each corner has."""
    rows = values.reshape(-1, values.shape[2])
    first, which = distinct_rows(rows)
    return rows[first], which.reshape(-1, 3)


def _encode(lines: Sequence[str]) -> bytes:
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogateescape")
