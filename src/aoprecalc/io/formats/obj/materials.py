"""MTL files, the material libraries of OBJ: read, and written again."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aoprecalc.io.formats.base import ColorImages, ImageSource, SourceMaterial, same_file
from aoprecalc.io.formats.builder import file_beside, read_file
from aoprecalc.io.outputs import relative_path
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import BaseColor, Float64Array

# Statements that name a texture file.
_MAP = re.compile(r"(map_|bump|disp|decal|refl|norm)", re.IGNORECASE)


@dataclass(frozen=True)
class MtlMaterial(SourceMaterial):
    """A material of an MTL: Kd is its colour and map_Kd its texture.

    lines    all its lines, without `newmtl`
    ambient  the file of its ambient texture (map_Ka)
    """

    lines: tuple[str, ...] = ()
    ambient: Path | None = None

    def base_color(self, uvs: Float64Array | None, images: ColorImages, occlusion: Path | None) -> BaseColor:
        """Return Kd, which counts as sRGB, times map_Kd at the UVs of a part, unless that is the ambient occlusion.

        A texture with a black Kd, as some programs write, counts alone.
        """
        red, green, blue = linear_from_srgb(np.array(self.color)).tolist()
        if self.texture is None or same_file(self.texture, occlusion) or uvs is None:
            return BaseColor((red, green, blue))
        texture = images.get(ImageSource(str(self.texture), self.texture))
        if texture is None:
            return BaseColor((red, green, blue))
        return BaseColor((red, green, blue) if any(self.color) else (1.0, 1.0, 1.0), texture, uvs)


def library_files(folder: Path, names: Iterable[str]) -> tuple[Path, ...]:
    """Return the MTL files that an OBJ in a folder names, existing or not."""
    return tuple(file for name in names if (file := file_beside(folder, name)) is not None)


def read_materials(folder: Path, libraries: Sequence[Path]) -> dict[str, MtlMaterial]:
    """Read the materials of the MTL files of an OBJ in a folder; a file that is missing or unreadable gives none."""
    materials: dict[str, MtlMaterial] = {}
    for library in libraries:
        try:
            text = read_file(library).decode("utf-8", "surrogateescape")
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
    """Return the files of the diffuse and ambient textures of materials."""
    return [texture for material in materials for texture in (material.texture, material.ambient) if texture]


def names_texture(line: str) -> bool:
    """Tell whether a line of an MTL names a texture file."""
    return _MAP.match(line) is not None


def relocate_line(line: str, source: Path, target: Path) -> str:
    """Rewrite a line of an MTL beside `source` so that the file it names is found from beside `target`."""
    name = _file_name(_statement(line)[1]) if names_texture(line) else ""
    file = file_beside(source.parent, name.replace("\\", "/"))
    if not name or file is None or source.parent.resolve() == target.parent.resolve() or not os.path.isfile(file):
        return line
    return line.removesuffix(name) + relative_path(file, target)


def _material(folder: Path, name: str, lines: Sequence[str]) -> MtlMaterial:
    color, textures = (1.0, 1.0, 1.0), dict[str, Path | None]()
    for line in lines:
        keyword, rest = _statement(line)
        if keyword == "Kd":
            color = _color(rest.split()) or color
        elif keyword.lower() in ("map_kd", "map_ka") and rest:
            textures[keyword.lower()] = file_beside(folder, _file_name(rest).replace("\\", "/"))
    return MtlMaterial(name, color, textures.get("map_kd"), tuple(lines), textures.get("map_ka"))


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
