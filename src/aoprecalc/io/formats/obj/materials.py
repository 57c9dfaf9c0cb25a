"""MTL files, the material libraries of OBJ: read, and written again."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from aoprecalc.io.formats.base import WHITE, Placement, SourceMaterial
from aoprecalc.io.formats.files import (
    ColorImages,
    FileSearch,
    ImageSource,
    TextureCopies,
    are_numbers,
    file_beside,
    read_utf8,
    same_file,
)
from aoprecalc.io.formats.materials import ExaminedMaterial, base_color, examine
from aoprecalc.io.images import is_baked
from aoprecalc.io.outputs import relative_path
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
        return self.file is not None and os.path.isfile(self.file)

    @property
    def left_out(self) -> list[str]:
        """What of it reaches neither a bake nor another format."""
        if self.keyword not in ("map_kd", "map_d", "map_ka"):
            return [f"{self.head.split()[0]} {self.name}"]
        return [f"{option} of {self.head.split()[0]} {self.name}" for option in self.others]

    def relocated(self, target: Path, copies: TextureCopies | None) -> str:
        """Return the line that names the same file from beside `target`; as it is written where that does so.

        copies   names the file; None: by its place
        """
        beside = file_beside(target.parent, self.name)
        if not self.found or same_file(beside, self.file):
            return f"{self.head} {self.name}"
        assert self.file is not None
        return f"{self.head} {relative_path(self.file, target) if copies is None else copies.name(self.file)}"


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
        file = None if self.texture is None else self.texture.path
        is_occlusion = file is not None and (same_file(file, occlusion) or is_baked(file))
        return base_color(self, None if is_occlusion else uvs, images, corners)


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
            text = read_utf8(library)
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
            values[keyword.lower()] = rest.partition("#")[0].split()
    made = MtlMaterial(
        name,
        _color(values.get("kd", [])) or WHITE,
        lines=lines,
        opacity=_opacity(values),
        emission=_color(values.get("ke", [])) or (0.0, 0.0, 0.0),
        roughness=_fraction(values.get("pr", []), 1.0),
        metalness=_fraction(values.get("pm", []), 0.0),
    )
    made = replace(made, left_out=tuple(what for used in made.maps for what in used.left_out))
    diffuse, ambient, holes = (made.map(keyword) for keyword in ("map_kd", "map_ka", "map_d"))
    if diffuse is not None:
        made = replace(made, texture=_image(diffuse), placement=diffuse.placement, occlusion=diffuse.file)
    if ambient is not None:
        made = replace(made, occlusion=ambient.file)
    if holes is not None and holes.found:
        itself = diffuse is not None and same_file(holes.file, diffuse.file)  # whose luminance is no opacity
        made = replace(made, opacity_map=_image(holes), opacity_channel=holes.channel or ("alpha" if itself else ""))
        return made if diffuse is not None else replace(made, placement=holes.placement)
    return made if diffuse is None else replace(made, opacity_map=_image(diffuse), opacity_channel="alpha")


def _image(named: TextureMap) -> ImageSource | None:
    return None if named.file is None else ImageSource.of(named.file)


def _fraction(words: Sequence[str], default: float) -> float:
    """Return a number clipped to [0, 1]; the default for other words."""
    return min(max(float(words[0]), 0.0), 1.0) if words and are_numbers(words[:1]) else default


def _opacity(values: Mapping[str, Sequence[str]]) -> float:
    """Return the opacity by `d`, else by its complement `Tr`, which some programs write beside it in another sense."""
    for keyword, sign in (("d", 1.0), ("tr", -1.0)):
        words = values.get(keyword, ())
        if words and are_numbers(words[-1:]):  # after -halo, which depends on the angle of view
            return min(max(float(words[-1]) if sign > 0 else 1.0 - float(words[-1]), 0.0), 1.0)
    return 1.0


def examine_maps(material: MtlMaterial) -> ExaminedMaterial[MtlMaterial]:
    """Look at the pictures of a material: which is a baked texture, and what its opacity makes of it.

    A baked texture is no colour.
    """
    label, messages = f"the material {material.name!a}", list[str]()
    if material.texture is not None and material.texture.path is not None and is_baked(material.texture.path):
        itself = material.opacity_map == material.texture
        material = replace(material, texture=None, opacity_map=None if itself else material.opacity_map)
    diffuse, holes = material.map("map_kd"), material.map("map_d")
    own_alpha = holes is None or not holes.found
    if holes is not None and not holes.found:
        messages.append(f"{label} is taken as opaque where its map_d says: {holes.name!a} is not there")
    if own_alpha and (diffuse is None or not diffuse.found):
        material = replace(material, opacity_map=None)
    elif diffuse is not None and holes is not None and not own_alpha and diffuse.placement != holes.placement:
        messages.append(f"{label} places its map_d and its map_Kd differently: map_d is left out")
        material = replace(material, opacity_map=None)
    name = material.opacity_map.file_name if material.opacity_map else ""
    examined = examine(material, own_alpha=own_alpha, advice=f"map_d {name} would make it so")
    return replace(examined, messages=(*messages, *examined.messages))


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
        is_number = option in _UP_TO
        for _ in range(_UP_TO.get(option) or _WORDS[option]):
            word, *after = rest.split(None, 1) or [""]
            if not word or (is_number and not are_numbers([word])):
                break
            options[option].append(word)
            rest = after[0] if after else ""
    return options, rest.strip()


def _numbers(words: Sequence[str], filler: float) -> tuple[float, float]:
    """Return the first two numbers of an option, the filler where it has fewer."""
    u, v = [*(float(word) for word in words), filler, filler][:2]
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
