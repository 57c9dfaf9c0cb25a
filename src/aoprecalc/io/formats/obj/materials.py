"""MTL files, the material libraries of OBJ: read, and written again."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aoprecalc.io.formats.base import ColorImages, ImageSource, Placement, SourceMaterial, same_file
from aoprecalc.io.formats.files import FileSearch, file_beside, read_text
from aoprecalc.io.outputs import relative_path
from aoprecalc.texture_lookup import repeating_texture
from aoprecalc.types import BaseColor, Float32Array, Float64Array

# Statements that name a texture file.
_MAP = re.compile(r"(map_|bump|disp|decal|refl|norm)", re.IGNORECASE)

# How many words follow an option of such a statement (the MTL specification of 1995, and colorspace); of those in
# _UP_TO, at most so many numbers.
_WORDS = {
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-colorspace": 1, "-imfchan": 1,
    "-mm": 2, "-texres": 1, "-type": 1,
}  # fmt: skip
_UP_TO = {"-o": 3, "-s": 3, "-t": 3}
_PLAIN = Placement()
_CHANNELS = {"r": "red", "g": "green", "b": "blue", "m": "alpha", "l": "luminance"}


@dataclass(frozen=True)
class TextureMap:
    """A statement that names a texture file.

    keyword    lower case
    head       the line up to the name: keyword and options as they are written
    file       the existing file, or its place; None for names of servers
    placement  by its options -o, -s and -clamp
    channel    by its option -imfchan; empty where it has none
    others     its options that are not applied
    """

    keyword: str
    head: str
    name: str
    file: Path | None
    placement: Placement = _PLAIN
    channel: str = ""
    others: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether the file exists."""
        return self.file is not None and self.file.is_file()

    def relocated(self, target: Path) -> str:
        """Return the line that names the same file from beside `target`; as it is written where that does so."""
        beside = file_beside(target.parent, self.name)
        if not self.found or same_file(beside, self.file):
            return f"{self.head} {self.name}"
        assert self.file is not None
        return f"{self.head} {relative_path(self.file, target)}"


@dataclass(frozen=True)
class MtlMaterial(SourceMaterial):
    """A material of an MTL: Kd is its colour and map_Kd its texture.

    lines      all its lines, without `newmtl`: a TextureMap for each that names a file, else its text
    occlusion  the file of its ambient texture (map_Ka), else of map_Kd
    """

    lines: tuple[str | TextureMap, ...] = ()
    occlusion: Path | None = None

    @property
    def maps(self) -> tuple[TextureMap, ...]:
        """The statements that name texture files."""
        return tuple(line for line in self.lines if isinstance(line, TextureMap))

    def map(self, keyword: str) -> TextureMap | None:
        """Return its last statement of a keyword; None where it has none."""
        return next((found for found in reversed(self.maps) if found.keyword == keyword), None)

    def base_color(
        self,
        uvs: Float64Array | None,
        images: ColorImages,
        occlusion: Path | None,
        corners: Float32Array | None,
    ) -> BaseColor:
        """Return its colour times its texture at the UVs of a part, unless that is the ambient occlusion.

        corners   the colours of the vertices
        """
        if self.texture is None or same_file(self.texture, occlusion) or uvs is None:
            return BaseColor(self.factor(textured=False), corners=corners)
        texture = images.get(ImageSource(str(self.texture), self.texture))
        if texture is None:
            return BaseColor(self.factor(textured=False), corners=corners)
        wraps = (self.placement.wrap, self.placement.wrap)
        texture, uvs = repeating_texture(texture, self.placement.transform(uvs), wraps)
        return BaseColor(self.factor(textured=True), texture, uvs, corners)


def library_files(search: FileSearch, statements: Iterable[str]) -> tuple[Path, ...]:
    """Return the MTL files that the `mtllib` statements of an OBJ name, existing or not."""
    names = (name for statement in statements for name in search.split(statement.strip(), ".mtl"))
    return tuple(dict.fromkeys(file for name in names if (file := search.place(name)) is not None))


def read_materials(folder: Path, libraries: Sequence[Path]) -> dict[str, MtlMaterial]:
    """Read the materials of the MTL files of an OBJ in a folder; a file that is missing or unreadable gives none.

    Textures are looked for beside the MTL, then beside the OBJ.
    """
    materials: dict[str, MtlMaterial] = {}
    for library in libraries:
        try:
            text = read_text(library)
        except (OSError, ValueError):
            continue
        search = FileSearch(library.parent, folder)
        name, lines = None, list[str]()
        for line in [*joined_lines(text).split("\n"), "newmtl"]:
            words = line.split(None, 1)
            if not words:
                continue
            if words[0].lower() != "newmtl":
                lines.append(line.strip())
                continue
            if name is not None and name not in materials:
                materials[name] = _material(search, name, lines)
            name, lines = words[1].strip() if len(words) == 2 else None, []
    return materials


def joined_lines(text: str) -> str:
    """Return the text of an OBJ or MTL with one line for each statement: a backslash at an end continues the line."""
    return text.replace("\\\r\n", " ").replace("\\\n", " ").replace("\r\n", "\n").replace("\r", "\n")


def material_files(materials: Iterable[MtlMaterial]) -> list[Path]:
    """Return the files of all textures of materials."""
    return list(dict.fromkeys(used.file for material in materials for used in material.maps if used.file is not None))


def _material(search: FileSearch, name: str, texts: Sequence[str]) -> MtlMaterial:
    lines = tuple(_line(search, text) for text in texts)
    values = dict[str, list[str]]()
    for line in lines:
        if isinstance(line, str):
            keyword, rest = _statement(line)
            values[keyword.lower()] = rest.split()
    made = MtlMaterial(name, _color(values.get("kd", [])) or (1.0, 1.0, 1.0), lines=lines)
    diffuse, ambient = made.map("map_kd"), made.map("map_ka")
    occlusion = ambient or diffuse
    return MtlMaterial(
        name,
        made.color,
        None if diffuse is None else diffuse.file,
        _PLAIN if diffuse is None else diffuse.placement,
        lines=lines,
        occlusion=None if occlusion is None else occlusion.file,
    )


def _line(search: FileSearch, text: str) -> str | TextureMap:
    keyword, rest = _statement(text)
    if not _MAP.match(keyword) or not rest:
        return text
    options, name = _options(rest)
    if not name:
        return text
    head = text.removesuffix(name).rstrip()
    scale, offset = (_numbers(options.get(option, ()), filler) for option, filler in (("-s", 1.0), ("-o", 0.0)))
    clamps = [word.lower() for word in options.get("-clamp", ())] == ["on"]
    channel = _CHANNELS.get("".join(options.get("-imfchan", ())).lower(), "")
    others = tuple(option for option in options if option in ("-mm", "-t"))
    placement = Placement(scale, offset, "clamp" if clamps else "repeat")
    return TextureMap(keyword.lower(), head, name, search.place(name), placement, channel, others)


def _options(rest: str) -> tuple[dict[str, list[str]], str]:
    """Part what follows the keyword of a map: its options, lower case, with their words; and the name of the file."""
    options = dict[str, list[str]]()
    while (found := re.match(r"(-[a-z]+)\s+", rest, re.IGNORECASE)) and (option := found[1].lower()) in {
        *_WORDS,
        *_UP_TO,
    }:
        rest = rest[found.end() :]
        options[option] = []
        is_value: Callable[[str], bool] = _is_number if option in _UP_TO else bool
        for _ in range(_UP_TO.get(option) or _WORDS[option]):
            word, *after = rest.split(None, 1) or [""]
            if not is_value(word):
                break
            options[option].append(word)
            rest = after[0] if after else ""
    return options, rest.strip()


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(words: Sequence[str], filler: float) -> tuple[float, float]:
    """Return the first two numbers of an option, the filler where it has fewer or others than finite ones."""
    numbers = [float(word) for word in words[:2]]
    u, v = (number if np.isfinite(number) else filler for number in [*numbers, filler, filler][:2])
    return u, v


def _statement(line: str) -> tuple[str, str]:
    """Split a line into its keyword and what follows."""
    keyword, *rest = line.split(None, 1) or [""]
    return keyword, rest[0] if rest else ""


def _color(words: Sequence[str]) -> tuple[float, float, float] | None:
    """Return red, green and blue, clipped to [0, 1]; one number stands for all three. None for other words."""
    all_three = [*words, *words, *words] if len(words) == 1 else words[:3]
    try:
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in all_three)
    except ValueError:
        return None
    return red, green, blue
