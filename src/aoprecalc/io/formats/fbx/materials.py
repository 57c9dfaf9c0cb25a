"""The materials of an FBX, as ufbx tells them: colour, opacity and their pictures."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.io.formats.base import Placement, SourceMaterial
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.formats.materials import ExaminedMaterial, examine, picture_search
from aoprecalc.texture_lookup import srgb_from_linear

# The name of a file, of a picture or its texture: in binary files its length and bytes, in others in quotes.
_FILE_NAME = re.compile(
    rb"(?:\x08File[nN]ame|\x10RelativeFile[nN]ame)S(.{4})|\b(?:Relative)?File[nN]ame\s*:\s*\"([^\"\r\n]*)\"", re.DOTALL
)

_HELD: list[Any] = []  # a reference for each time that an element was given


def held(element: Any) -> Any:
    """Return an element of ufbx (a node, a mesh, a material, a texture), or None, that will never be freed.

    ufbx 0.0.5 keeps one Python object for each element, and counts no reference when it hands it out again: without
    this it is freed while in use. It must be called on each element that an attribute or a list gives.
    """
    _HELD.append(element)
    return element


def held_each(elements: Iterable[Any]) -> Iterator[Any]:
    """Yield the elements of a list of ufbx, see `held`."""
    return map(held, elements)


@dataclass(frozen=True, eq=False)
class FbxMaterial:
    """A material, and the name of the UV set of its pictures; empty for the first."""

    examined: ExaminedMaterial[SourceMaterial]
    uv_set: str = ""

    @property
    def name(self) -> str:
        """Its name, unique in the file."""
        return self.examined.material.name


class FbxMaterials:
    """The materials of an FBX, each read once.

    messages   for the user
    """

    def __init__(self, path: Path) -> None:
        """Start without materials."""
        self._search = picture_search(path)
        self._by_element: dict[int, FbxMaterial] = {}
        self.messages: list[str] = []

    def of(self, material: Any) -> FbxMaterial:
        """Return what is read of a material of ufbx."""
        number = material.element_id
        if number not in self._by_element:
            taken = {known.name for known in self._by_element.values()}
            plain = material.name or "material"
            self._by_element[number] = self._read(material, plain if plain not in taken else f"{plain}_{number}")
            self.messages += self._by_element[number].examined.messages
        return self._by_element[number]

    def sources(self) -> dict[str, SourceMaterial]:
        """Return what other formats get of the materials, by name."""
        return {known.name: known.examined.material for known in self._by_element.values()}

    def _read(self, material: Any, name: str) -> FbxMaterial:
        pbr, uses = material.pbr, {use.material_prop: held(use.texture) for use in material.textures}
        color = held(pbr.base_color.texture)
        holes = next(filter(None, held_each(each.texture for each in _opacity_maps(pbr))), None)
        image, mask = self._image(color), self._image(holes)
        left_out = [
            f"{use} {texture.filename or texture.name}"
            for use, texture in uses.items()
            if texture not in (color, holes)
        ]
        placement, turned = _placement(color or holes)
        if turned or (color and holes and _placement(holes) != (placement, turned)):
            left_out.append(f"how the pictures of {name} are turned or placed by themselves")
        red, green, blue = srgb_from_linear(_color(pbr)).tolist()
        modern = pbr.metalness.has_value
        source = SourceMaterial(
            name,
            (red, green, blue),
            image,
            placement,
            1.0 if mask else _opacity(material),
            mask or image,
            "alpha" if mask in (None, image) else "",
            emission=_emission(pbr),
            roughness=_fraction(pbr.roughness, 1.0) if modern else 1.0,
            metalness=_fraction(pbr.metalness, 0.0),
            double_sided=bool(material.features.double_sided.enabled),
            left_out=tuple(left_out),
        )
        examined = examine(source, own_alpha=mask is None, advice="connect it to the opacity to make it so")
        shown = color or holes
        uv_set = "" if shown is None else shown.uv_set
        return FbxMaterial(examined, "" if uv_set == "default" else uv_set)

    def _image(self, texture: Any) -> ImageSource | None:
        """Return the picture of a texture, of the lowest layer of a layered one: embedded, else its file."""
        if texture is None:
            return None
        files = list(held_each(texture.file_textures))
        file = files[0] if files else texture
        names = [name for name in (file.relative_filename, file.filename, file.absolute_filename) if name]
        if file.content:
            return ImageSource(names[0] if names else file.name, data=bytes(file.content))
        found = next(filter(None, map(self._search.find, names)), None)
        place = found or (self._search.place(names[0]) if names else None)
        return None if place is None else ImageSource.of(place)


def picture_files(path: Path, data: bytes) -> list[Path]:
    """Return the pictures that an FBX names, embedded ones too, existing or not; found without ufbx."""
    names = (
        data[found.end() : found.end() + int.from_bytes(found[1], "little")] if found[1] else found[2]
        for found in _FILE_NAME.finditer(data)
    )
    search = picture_search(path)
    unique = dict.fromkeys(name.decode("utf-8", "surrogateescape").replace("&quot;", '"') for name in names)
    return [file for name in unique if name and (file := search.place(name)) is not None]


def _opacity_maps(pbr: Any) -> tuple[Any, ...]:
    """Return the maps that may say where there are holes; classic materials have the second or third."""
    return pbr.opacity, pbr.transmission_color, pbr.transmission_factor


def _placement(texture: Any) -> tuple[Placement, bool]:
    """Return how a texture lies on its UVs, and whether it is turned, which is left out."""
    if texture is None:
        return Placement(), False
    columns = np.array(texture.uv_to_texture, np.float64)
    (su, b, _), (c, sv, _) = columns[:2].tolist()
    u, v, _ = columns[3].tolist()
    return Placement((su, sv), (u, v), "clamp" if texture.wrap_u == 1 else "repeat"), bool(b or c)


def _color(pbr: Any) -> Any:
    """Return the linear colour, (3,) in [0, 1]."""
    color = np.array(pbr.base_color.value_vec4[:3]) if pbr.base_color.has_value else np.ones(3)
    return np.clip(color * (pbr.base_factor.value_vec4.x if pbr.base_factor.has_value else 1.0), 0, 1)


def _emission(pbr: Any) -> tuple[float, float, float]:
    if not pbr.emission_color.has_value:
        return 0.0, 0.0, 0.0
    factor = pbr.emission_factor.value_vec4.x if pbr.emission_factor.has_value else 1.0
    glow = np.clip(np.array(pbr.emission_color.value_vec4[:3]) * factor, 0, 1)
    red, green, blue = srgb_from_linear(glow).tolist()
    return red, green, blue


def _opacity(material: Any) -> float:
    """Return the opacity; of classic materials `Opacity`, else the complement of the colour that is let through.

    A factor alone says nothing: programs write both 0 and 1 for what is opaque, beside a colour that is black.
    """
    pbr, props = material.pbr, material.props
    if pbr.opacity.has_value:
        return float(np.clip(np.mean(pbr.opacity.value_vec4[:3]), 0, 1))
    stored = props.find_real("Opacity", -1.0)
    if stored >= 0:
        return float(min(stored, 1.0))
    if not pbr.transmission_color.has_value:
        return 1.0
    factor = pbr.transmission_factor.value_vec4.x if pbr.transmission_factor.has_value else 1.0
    return float(np.clip(1 - np.mean(pbr.transmission_color.value_vec4[:3]) * factor, 0, 1))


def _fraction(value: Any, default: float) -> float:
    return float(np.clip(value.value_vec4.x, 0.0, 1.0)) if value.has_value else default
