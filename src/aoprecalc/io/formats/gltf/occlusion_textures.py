"""Occlusion textures of glTF materials: assigned when a document is written, alone or packed as ORM, and read back."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.baked_options import EXTRAS
from aoprecalc.io.formats.base import PartOcclusion
from aoprecalc.io.formats.builder import check_indices
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, float_values
from aoprecalc.io.formats.gltf.materials import (
    UNLIT,
    TextureUse,
    coarser_materials,
    material_holders,
    texture_image,
    texture_wraps,
)
from aoprecalc.io.formats.gltf.reader import part_primitive
from aoprecalc.io.images import png_bytes
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import bilinear_taps
from aoprecalc.types import Atlas, Float32Array, Float64Array, Part, Wrap

POINTER = "KHR_animation_pointer"

PrimitiveKey = tuple[int, int]  # (mesh, primitive)


@dataclass(frozen=True)
class BakedSlot:
    """The index of a baked texture, and the n of the TEXCOORD_n that it lies on."""

    texture: int
    texcoord: int


def own_materials(
    document: Json, slots: Mapping[PrimitiveKey, BakedSlot], strength: float, names: Sequence[str]
) -> tuple[dict[int, BakedSlot], tuple[str, ...]]:
    """Give primitives materials that may get an occlusion texture.

    slots       (mesh, primitive) -> its occlusion texture
    strength    that it will have
    names       of the textures, from which copies of materials have theirs

    A material that other primitives use unchanged, or with another slot, is copied; a primitive without material
    gets one. So do its variants, and the coarser levels of detail of each. Unlit materials stay as they are. Returns
    index of a material -> its slot, and a note on occlusion textures that will be replaced.
    """
    materials: list[Json] = document.get("materials", [])
    taken = {
        holder["material"]
        for mesh_index, mesh in enumerate(document["meshes"])
        for index, primitive in enumerate(mesh["primitives"])
        if (mesh_index, index) not in slots
        for holder in material_holders(primitive)
        if "material" in holder
    }
    taken |= {other for index in taken for other in coarser_materials(materials[index])}
    made: dict[tuple[int | None, BakedSlot], int] = {}
    for (mesh_index, index), slot in slots.items():
        holders = material_holders(document["meshes"][mesh_index]["primitives"][index])
        references: list[tuple[Any, Any, int | None]] = [
            (holder, "material", holder.get("material")) for holder in holders
        ]
        for holder, place, number in references:
            key = (number, slot)
            if number is not None and UNLIT in materials[number].get("extensions", {}):
                continue
            if key not in made:
                made[key] = _own_material(materials, number, taken, names[slot.texture])
                coarser = coarser_materials(materials[made[key]])
                references += [(coarser, level, other) for level, other in enumerate(coarser)]
            holder[place] = made[key]
    if materials:  # the schema forbids empty lists
        document["materials"] = materials
    replaced = len({index for index, _ in made if index is not None and "occlusionTexture" in materials[index]})
    follow_copies(document, "materials", [(key[0], new) for key, new in made.items() if key[0] is not None])
    _describe_copies(document, made)
    still = _stop_animations(document, [f"/materials/{index}/occlusionTexture/extensions/" for index in made.values()])
    others = sorted({_strength(materials[index]) for index, _ in made if index is not None} - {strength})
    were = f"; their strength is {strength:g}, it was {', '.join(f'{other:g}' for other in others)}" if others else ""
    note = f"the occlusion textures of {counted(replaced, 'material')} were replaced{were}"
    return {made[key]: key[1] for key in made}, (*([Note(note)] if replaced else []), *still)


def replaced_references(
    document: Json, materials: Collection[int], packed: Collection[int]
) -> Iterator[tuple[Json, str]]:
    """Yield (holder, key) of the texture references of materials that `assign_textures` replaces."""
    for index in materials:
        material = document["materials"][index]
        if "occlusionTexture" in material:
            yield material, "occlusionTexture"
        if index in packed:
            yield material["pbrMetallicRoughness"]["metallicRoughnessTexture"], "index"


def assign_textures(
    document: Json,
    slots: Mapping[int, BakedSlot],
    textures: Mapping[int, int],
    packed: Collection[int],
    extras: Mapping[int, Any],
    strength: float,
) -> None:
    """Give materials their occlusion textures.

    slots       index of a material -> its slot
    textures    index of a material -> index of its texture
    packed      the materials whose texture has roughness and metalness as well
    extras      index of a material -> the `extras` of its occlusionTexture
    strength    of their occlusionTextures
    """
    for index, slot in slots.items():
        material = document["materials"][index]
        # Replaced as a whole: a KHR_texture_transform of an earlier texture could override texCoord.
        info = texture_info(textures[index], slot.texcoord)
        material["occlusionTexture"] = {**info, "texCoord": slot.texcoord, "strength": float(strength)}
        if index in extras:
            material["occlusionTexture"]["extras"] = extras[index]
        if index in packed:
            material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"] = textures[index]


def occlusion_extras(document: Json, said: Mapping[int, Json | None]) -> dict[int, Any]:
    """Return index of a material -> the `extras` of its new occlusionTexture: those of the old one, and what is said.

    said   index of a material -> what is said of the bake of its texture, see `options_document`; None for nothing
    Extras may be of any type; those that are no object are kept as they are.
    """
    found: dict[int, Any] = {}
    for index, document_of_bake in said.items():
        before = document["materials"][index].get("occlusionTexture", {}).get("extras", {})
        if isinstance(before, dict):
            own = {} if document_of_bake is None else {EXTRAS: document_of_bake}
            before = {key: value for key, value in before.items() if key != EXTRAS} | own
        if before != {}:
            found[index] = before
    return found


def roughness_texture(material: Json) -> Json | None:
    """Return a material's metallicRoughnessTexture, a textureInfo; None where it has none."""
    info: Json | None = material.get("pbrMetallicRoughness", {}).get("metallicRoughnessTexture")
    return info


def texture_info(texture: int, texcoord: int) -> Json:
    """Return a textureInfo: the index of a texture and the n of its TEXCOORD_n."""
    return {"index": texture, **({"texCoord": texcoord} if texcoord else {})}


# KHR_animation_pointer: channels whose target is any value of the document.


def follow_copies(document: Json, kind: str, copies: Iterable[tuple[int, int]]) -> None:
    """Animate copies of entries as the entries are.

    kind     materials or meshes
    copies   (index, index of the copy); equal ones are none
    """
    copied = [(f"/{kind}/{index}/", f"/{kind}/{copy}/") for index, copy in copies if copy != index]
    for animation in document.get("animations", []):
        for channel in filter(_pointer, list(animation["channels"])):
            for before, after in copied:
                if _pointer(channel).startswith(before):
                    another = deepcopy(channel)
                    another["target"]["extensions"][POINTER]["pointer"] = _pointer(channel).replace(before, after, 1)
                    animation["channels"].append(another)


def _describe_copies(document: Json, made: Mapping[tuple[int | None, BakedSlot], int]) -> None:
    """Describe new materials in the list of VRM 0, which has an entry for each, as those they are copies of."""
    described = document.get("extensions", {}).get("VRM", {}).get("materialProperties")
    for (index, _), new in sorted(made.items(), key=lambda item: item[1]):
        if described and new == len(described):
            described.append(deepcopy(described[index or 0]))


def _stop_animations(document: Json, prefixes: Collection[str]) -> tuple[str, ...]:
    """Remove the channels whose pointers have these prefixes, and animations without others; return a warning."""
    animations, stopped = document.get("animations", []), 0
    for animation in animations:
        stay = [one for one in animation["channels"] if not _pointer(one).startswith(tuple(prefixes))]
        stopped += len(animation["channels"]) - len(stay)
        animation["channels"] = stay
    if not stopped:
        return ()
    document["animations"] = [animation for animation in animations if animation["channels"]]
    if not document["animations"]:  # the schema forbids empty lists
        del document["animations"]
    gone = f"{counted(stopped, 'animation channel')} {one_or_many(stopped, 'is', 'are')} gone"
    return (f"{gone}: the transforms of occlusion textures that were replaced",)


def _pointer(channel: Json) -> str:
    pointer: str = channel["target"].get("extensions", {}).get(POINTER, {}).get("pointer", "")
    return pointer


def _strength(material: Json) -> float:
    strength: float = material.get("occlusionTexture", {}).get("strength", 1.0)
    return strength


def _own_material(materials: list[Json], index: int | None, taken: set[int], texture: str) -> int:
    """Return the index of a material that may be changed: this one if it is not taken, else a copy.

    texture   its name, that of one of several, is added to that of a copy
    """
    if index is not None and index not in taken:
        taken.add(index)
        return index
    materials.append({} if index is None else deepcopy(materials[index]))
    if texture:
        materials[-1]["name"] = f"{materials[-1].get('name', 'baked')}_{texture}"
    taken.add(len(materials) - 1)
    return len(materials) - 1


# ORM: occlusion, roughness and metalness in the R, G and B channels of one image, from which glTF reads them.


@dataclass(frozen=True, eq=False)
class OrmImage:
    """A packed image.

    data      an 8-bit PNG, linear
    sampler   of the texture with roughness and metalness; None for the default
    """

    data: bytes
    sampler: Json | None


def pack_orm(
    document: GltfDocument, materials: Mapping[int, int], atlas: Atlas, occlusion: Float32Array, text: str
) -> tuple[dict[int, OrmImage], tuple[str, ...]]:
    """Return the packed images of the materials that allow it, and a warning about the others.

    materials   index of a material -> the n of the TEXCOORD_n of the occlusion
    occlusion   (height, width) float32, row 0 at v = 0 in glTF
    text        for the images to carry

    A material allows it if its metallicRoughnessTexture has the same UVs as the occlusion. Along each axis the image
    has the larger of both sizes. Materials with the same texture share an image.
    """
    images: dict[int, OrmImage] = {}
    of_texture: dict[int, OrmImage] = {}
    obstacles: Counter[str] = Counter()
    for index, texcoord in materials.items():
        info = roughness_texture(document.json["materials"][index])
        try:
            obstacle = _obstacle(document, info, texcoord, atlas)
            if info is not None and not obstacle:
                texture = info["index"]
                if texture not in of_texture:
                    of_texture[texture] = _pack(document, texture, atlas, occlusion, text)
                images[index] = of_texture[texture]
        except (InputError, KeyError, IndexError):
            obstacle = "with one whose image cannot be read (PNG or JPEG was expected)"
        obstacles.update([obstacle] if obstacle else [])
    if not obstacles:
        return images, ()
    reasons = ", ".join(f"{times} {obstacle}" for obstacle, times in obstacles.items())
    get = f"{counted(len(materials), 'material')} {one_or_many(obstacles.total(), 'gets', 'get')}"
    found = f"{obstacles.total()} of {get} an occlusion image that is not packed"
    return images, (f"{found}: {reasons}",)


def _obstacle(document: GltfDocument, info: Json | None, texcoord: int, atlas: Atlas) -> str:
    """Return why a metallicRoughnessTexture does not have the UVs of the occlusion; empty if it does."""
    if info is None:
        return "without a metallic-roughness texture"
    use = TextureUse.of(info)
    if atlas.uv_set is None or use.texcoord != texcoord:
        return "with one on other UVs than those of the bake"
    if (use.scale, use.rotation, use.offset) != ((1, 1), 0, (0, 0)):
        return "with one that is transformed (apply KHR_texture_transform to the UVs first)"
    if atlas.repeats and texture_wraps(document, use.index) != ("repeat", "repeat"):
        return "with one that does not repeat as the UVs do (set its sampler to REPEAT)"
    return ""


def _pack(document: GltfDocument, texture: int, atlas: Atlas, occlusion: Float32Array, text: str) -> OrmImage:
    pixels = texture_image(document, texture).pixels()
    colors = pixels[:, :, 1:3] if pixels.shape[2] >= 3 else pixels[:, :, [0, 0]]  # grey
    height, width = max(len(pixels), len(occlusion)), max(pixels.shape[1], occlusion.shape[1])
    wrap: Wrap = "repeat" if atlas.repeats else "clamp"
    layers = [
        _resize(occlusion[:, :, None], height, width, (wrap, wrap)),
        _resize(colors, height, width, texture_wraps(document, texture)),
    ]
    entry = document.entry("textures", texture)
    sampler = document.entry("samplers", entry["sampler"]) if "sampler" in entry else None
    return OrmImage(png_bytes(np.concatenate(layers, axis=2), text), sampler)


def _resize(values: Float32Array, height: int, width: int, wraps: tuple[Wrap, Wrap]) -> Float32Array:
    """Resize (h, w, channels) values to (height, width, channels) bilinearly; texel centres are at (i + 1/2) / w.

    wraps   the wrap modes along u and v
    """
    for axis, size, wrap in ((0, height, wraps[1]), (1, width, wraps[0])):
        old_size = values.shape[axis]
        if size == old_size:
            continue
        first, second, weight = bilinear_taps((np.arange(size) + 0.5) / size * old_size, old_size, wrap)
        weight = np.expand_dims(weight.astype(np.float32), (1 - axis, 2))
        values = values.take(first, axis) * (1 - weight) + values.take(second, axis) * weight
    return values


# Reading.


def gltf_occlusion(document: GltfDocument, part: Part) -> PartOcclusion:
    """Return the occlusionTexture of a part's material, and its UVs with the texture transform applied.

    Raises InputError, KeyError or another exception where the document is damaged.
    """
    primitive = part_primitive(document, part)
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    info: Json | None = material.get("occlusionTexture")
    if info is None:
        return PartOcclusion(None, _uvs(document, part, primitive, TextureUse(0, 0)))
    use, strength = TextureUse.of(info), _strength(material)
    extras = info.get("extras")
    said = extras.get(EXTRAS) if isinstance(extras, dict) else None
    return PartOcclusion(
        texture_image(document, use.index),
        _uvs(document, part, primitive, use),
        said,
        strength=float(strength) if 0 <= strength <= 1 else 1.0,
    )


def _uvs(document: GltfDocument, part: Part, primitive: Json, use: TextureUse) -> Float64Array | None:
    accessor = primitive["attributes"].get(f"TEXCOORD_{use.texcoord}")
    if accessor is None:
        return None
    values = float_values(document, accessor)
    check_indices(document.path, part.vertices, len(values))
    return use.transform(values)[part.vertices]
