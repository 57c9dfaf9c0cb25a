"""The material library of an OBJ that is being written."""

from collections.abc import Iterable, Sequence
from itertools import chain, count
from pathlib import Path

from aoprecalc.files.obj.materials import Material, moved, names_picture
from aoprecalc.files.obj.reader import ObjDocument, Section
from aoprecalc.model import Part

_WHITE = "Kd 1 1 1"

Use = tuple[str | None, bool]  # a material, None for none, and whether parts that have it receive


def material_use(part: Part) -> Use:
    """Return which material a part has and whether it receives."""
    return (part.source.material if isinstance(part.source, Section) else None), part.receives


def material_names(parts: Sequence[Part], known: Iterable[str]) -> dict[Use, str]:
    """Name the materials that parts get: as they are called, but for a copy where some of their parts do not receive.

    known   names of materials that are taken, beside those of the parts
    """
    uses = list(dict.fromkeys(map(material_use, parts)))
    taken = {*known, *(material for material, _ in uses if material)}
    names: dict[Use, str] = {}
    for material, receives in uses:
        if material is not None and not (receives and (material, False) in uses):
            names[material, receives] = material
            continue
        name = f"{material}_ao" if material else "baked" if receives else "plain"
        free = next(free for free in chain([name], (f"{name}_{n}" for n in count(2))) if free not in taken)
        taken.add(free)
        names[material, receives] = free
    return names


def library_lines(
    document: ObjDocument, names: dict[Use, str], source: Path, target: Path, texture: str, kept: bool
) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines of an MTL at `target`, and what the user should know.

    names     of `material_names`
    source    the mesh whose materials they are
    texture   how the MTL calls the texture
    kept      the texture lies on the mesh's own UVs, so that all other pictures stay; it is map_Ka beside a map_Kd

    Materials that no part has, and those of parts that do not receive, stay as they are.
    """
    unknown = [Material(material or "") for material, _ in names if material not in document.materials]
    lines: list[str] = []
    lost = 0  # materials that part with pictures
    for material in (*document.materials.values(), *dict.fromkeys(unknown)):
        name = material.name or None
        plain, occluded = names.get((name, False)), names.get((name, True))
        here = [moved(line, source, target) for line in material.lines]
        if plain or not occluded:
            lines += [f"newmtl {plain or name}", *(here or [_WHITE]), ""]
        if occluded:
            stay = [line for line in here if not (_is_ambient(line) if kept else names_picture(line))]
            lost += len(stay) < len(here)
            statement = "map_Ka" if kept and material.picture else "map_Kd"
            lines += [f"newmtl {occluded}", *(stay or [_WHITE]), f"{statement} {texture}", ""]
    if not lost:
        return lines, ()
    if kept:
        return lines, (f"{lost} materials had an ambient texture (map_Ka) of their own, which was replaced",)
    return lines, (f"{target}: an MTL holds one set of UVs; the other textures of its materials are left out",)


def _is_ambient(line: str) -> bool:
    return line.lower().startswith("map_ka")
