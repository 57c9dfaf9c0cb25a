"""The material libraries of OBJ files."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from aoprecalc.io.outputs import relative_path

# Statements that name a picture.
_MAP = re.compile(r"(map_|bump|disp|decal|refl|norm)", re.IGNORECASE)


@dataclass(frozen=True)
class MtlMaterial:
    """What an MTL says about one material, as far as it is passed on.

    name     as in the file
    lines    its lines, without `newmtl`
    color    diffuse colour (Kd), 0 to 1
    picture  the file of its diffuse texture (map_Kd), where it has one
    ambient  the file of its ambient texture (map_Ka), where it has one
    """

    name: str
    lines: tuple[str, ...] = ()
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    picture: Path | None = None
    ambient: Path | None = None


def read_materials(folder: Path, libraries: Sequence[str]) -> dict[str, MtlMaterial]:
    """Read the materials of MTL files in a folder; a file that is missing or makes no sense gives none."""
    materials: dict[str, MtlMaterial] = {}
    for library in libraries:
        try:
            text = (folder / library).read_bytes().decode("utf-8", "surrogateescape")
        except (OSError, ValueError):
            continue
        name, lines = None, list[str]()
        for line in [*text.replace("\r", "\n").split("\n"), "newmtl"]:
            words = line.split(None, 1)
            if not words:
                continue
            if words[0] != "newmtl":
                lines.append(line.strip())
                continue
            if name is not None and name not in materials:
                materials[name] = _material(folder, name, lines)
            name, lines = words[1].strip() if len(words) == 2 else None, []
    return materials


def material_files(materials: Iterable[MtlMaterial]) -> list[Path]:
    """Return the pictures of materials that are read or passed on."""
    return [picture for material in materials for picture in (material.picture, material.ambient) if picture]


def names_picture(line: str) -> bool:
    """Tell whether a line of an MTL names a picture."""
    return _MAP.match(line) is not None


def moved(line: str, source: Path, target: Path) -> str:
    """Return a line of an MTL in the folder of `source` as it reads beside `target`."""
    name = _file_name(_statement(line)[1]) if names_picture(line) else ""
    file = source.parent / name.replace("\\", "/")
    if not name or source.parent.resolve() == target.parent.resolve() or not os.path.isfile(file):
        return line
    return line.removesuffix(name) + relative_path(file, target)


def _material(folder: Path, name: str, lines: Sequence[str]) -> MtlMaterial:
    color, pictures = (1.0, 1.0, 1.0), dict[str, Path]()
    for line in lines:
        keyword, rest = _statement(line)
        if keyword == "Kd":
            color = _color(rest.split()) or color
        elif keyword.lower() in ("map_kd", "map_ka") and rest:
            pictures[keyword.lower()] = folder / _file_name(rest).replace("\\", "/")
    return MtlMaterial(name, tuple(lines), color, pictures.get("map_kd"), pictures.get("map_ka"))


def _statement(line: str) -> tuple[str, str]:
    """Split a line into its keyword and what follows."""
    keyword, *rest = line.split(None, 1) or [""]
    return keyword, rest[0] if rest else ""


def _color(words: Sequence[str]) -> tuple[float, float, float] | None:
    try:
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in words[:3])
    except ValueError:
        return None
    return red, green, blue


def _file_name(rest: str) -> str:
    """Take the file name from what follows `map_Kd`: after its options, which come first and start with a dash."""
    words = rest.split()
    if not any(word.startswith("-") for word in words):
        return rest.strip()
    return words[-1]
