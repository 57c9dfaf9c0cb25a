"""Occlusion textures on the materials of a glTF document that is being written."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.formats.base import PartOcclusion
from aoprecalc.io.formats.builder import check_indices
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, doubles
from aoprecalc.io.formats.gltf.materials import UNLIT, TextureUse, texture_picture, texture_wraps
from aoprecalc.io.formats.gltf.reader import PrimitiveSource
from aoprecalc.io.images import png_bytes
from aoprecalc.texture_lookup import wrapped
from aoprecalc.types import Atlas, Float32Array, Float64Array, Part, Wrap

VARIANTS = "KHR_materials_variants"

Place = tuple[int, int]


def own_materials(document: Json, sets: Mapping[Place, int]) -> tuple[dict[int, int], tuple[str, ...]]:
    """Give some primitives materials that may be changed for them.

    sets   (mesh, primitive) -> which TEXCOORD_n of that primitive its occlusion texture is for

    A material that other primitives need as it is, or for another set, is doubled; a primitive without a material gets
    one. Unlit variants stay as they are. Returns number of a material -> its TEXCOORD_n, and what the user should know:
    how many have an occlusion texture, which is to be replaced.
    """
    materials: list[Json] = document.get("materials", [])
    taken = {
        holder["material"]
        for mesh_index, mesh in enumerate(document["meshes"])
        for index, primitive in enumerate(mesh["primitives"])
        if (mesh_index, index) not in sets
        for holder in _holders(primitive)
        if "material" in holder
    }
    made: dict[tuple[int | None, int], int] = {}
    for (mesh_index, index), number in sets.items():
        for holder in _holders(document["meshes"][mesh_index]["primitives"][index]):
            key = (holder.get("material"), number)
            if key[0] is not None and UNLIT in materials[key[0]].get("extensions", {}):
                continue
            if key not in made:
                made[key] = _own_material(materials, key[0], taken)
            holder["material"] = made[key]
    if materials:  # the schema has no empty lists
        document["materials"] = materials
    replaced = len({index for index, _ in made if index is not None and "occlusionTexture" in materials[index]})
    said = (f"{replaced} materials had an occlusion texture of their own, which was replaced",) if replaced else ()
    return {made[key]: key[1] for key in made}, said


def replaced_references(document: Json, sets: Mapping[int, int], packed: Collection[int]) -> Iterator[tuple[Json, str]]:
    """Yield what materials have now in the place of textures that `occlude` gives them, as (holder, key)."""
    for index in sets:
        material = document["materials"][index]
        if "occlusionTexture" in material:
            yield material, "occlusionTexture"
        if index in packed:
            yield material["pbrMetallicRoughness"]["metallicRoughnessTexture"], "index"


def occlude(document: Json, sets: Mapping[int, int], textures: Mapping[int, int], packed: Collection[int]) -> None:
    """Give materials their occlusion textures.

    sets       number of a material -> which TEXCOORD_n its texture is for
    textures   number of a material -> that of its texture
    packed     those materials whose texture holds roughness and metalness as well
    """
    for index, number in sets.items():
        material = document["materials"][index]
        # Nothing of an earlier one is kept: its KHR_texture_transform could choose another set than texCoord.
        material["occlusionTexture"] = {"index": textures[index], "texCoord": number, "strength": 1.0}
        if index in packed:
            material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"] = textures[index]


def roughness_texture(material: Json) -> Json | None:
    """Return a material's metallicRoughnessTexture, a textureInfo; None where it has none."""
    info: Json | None = material.get("pbrMetallicRoughness", {}).get("metallicRoughnessTexture")
    return info


def texture_reference(texture: int, number: int) -> Json:
    """Return a textureInfo: a texture, and the TEXCOORD_n it is for."""
    return {"index": texture, **({"texCoord": number} if number else {})}


def _own_material(materials: list[Json], index: int | None, taken: set[int]) -> int:
    """Return the number of a material that may be changed: this one if nobody else has taken it, else a copy."""
    if index is not None and index not in taken:
        taken.add(index)
        return index
    materials.append({} if index is None else deepcopy(materials[index]))
    return len(materials) - 1


def _holders(primitive: Json) -> Iterator[Json]:
    """Yield what refers to a material: the primitive itself and the mappings of its variants."""
    yield primitive
    yield from primitive.get("extensions", {}).get(VARIANTS, {}).get("mappings", [])


# Pictures of occlusion, roughness and metalness in one: the R, G and B that glTF reads these from.


@dataclass(frozen=True, eq=False)
class OrmPicture:
    """A packed picture.

    data      a PNG of 8 bits, linear
    sampler   that of the texture with roughness and metalness; None for the default
    """

    data: bytes
    sampler: Json | None


def orm_pictures(
    document: GltfDocument, materials: Mapping[int, int], atlas: Atlas, occlusion: Float32Array
) -> tuple[dict[int, OrmPicture], tuple[str, ...]]:
    """Return the packed pictures of those materials that can have one, and what the user should know of the others.

    materials   number of a material -> which TEXCOORD_n the occlusion is for
    occlusion   (height, width) float32, the first row is that of v = 0 in glTF

    A material can if its metallicRoughnessTexture lies on the surface as the occlusion does. The larger of both sizes
    is used along each axis. Materials with the same texture have the same picture.
    """
    pictures: dict[int, OrmPicture] = {}
    of_texture: dict[int, OrmPicture] = {}
    apart: Counter[str] = Counter()
    for index, number in materials.items():
        info = roughness_texture(document.json["materials"][index])
        try:
            obstacle = _obstacle(document, info, number, atlas)
            if info is not None and not obstacle:
                texture = info["index"]
                if texture not in of_texture:
                    of_texture[texture] = _packed(document, texture, atlas, occlusion)
                pictures[index] = of_texture[texture]
        except (InputError, KeyError, IndexError):
            obstacle = "with one whose picture cannot be read (PNG or JPEG was expected)"
        apart.update([obstacle] if obstacle else [])
    if not apart:
        return pictures, ()
    reasons = ", ".join(f"{times} {obstacle}" for obstacle, times in apart.items())
    found = f"{apart.total()} of {len(materials)} materials have the occlusion in a picture of its own, not packed"
    return pictures, (f"{found}: {reasons}",)


def _obstacle(document: GltfDocument, info: Json | None, number: int, atlas: Atlas) -> str:
    """Return why a metallicRoughnessTexture does not lie on the surface as the occlusion does, or nothing."""
    if info is None:
        return "without a metallic-roughness texture"
    use = TextureUse.of(info)
    if atlas.uv_set is None or use.uv_set != number:
        return "with one on other UVs than the bake's"
    if (use.scale, use.rotation, use.offset) != ((1, 1), 0, (0, 0)):
        return "with one that is transformed (apply KHR_texture_transform to the UVs first)"
    if atlas.repeats and texture_wraps(document, use.index) != ("repeat", "repeat"):
        return "with one that does not repeat as the UVs do (set its sampler to REPEAT)"
    return ""


def _packed(document: GltfDocument, texture: int, atlas: Atlas, occlusion: Float32Array) -> OrmPicture:
    pixels = texture_picture(document, texture).pixels()
    colors = pixels[:, :, 1:3] if pixels.shape[2] >= 3 else pixels[:, :, [0, 0]]  # grey is the same in all
    height, width = max(len(pixels), len(occlusion)), max(pixels.shape[1], occlusion.shape[1])
    own: Wrap = "repeat" if atlas.repeats else "clamp"
    layers = [
        _enlarged(occlusion[:, :, None], height, width, (own, own)),
        _enlarged(colors, height, width, texture_wraps(document, texture)),
    ]
    entry = document.entry("textures", texture)
    sampler = document.entry("samplers", entry["sampler"]) if "sampler" in entry else None
    return OrmPicture(png_bytes(np.concatenate(layers, axis=2)), sampler)


def _enlarged(values: Float32Array, height: int, width: int, wraps: tuple[Wrap, Wrap]) -> Float32Array:
    """Return (h, w, channels) values as (height, width, channels), bilinearly; texel centres are at (i + 1/2) / w.

    wraps   what lies beyond [0, 1] along u and v
    """
    for axis, size, wrap in ((0, height, wraps[1]), (1, width, wraps[0])):
        before = values.shape[axis]
        if size == before:
            continue
        at = (np.arange(size) + 0.5) / size * before - 0.5
        first = np.floor(at).astype(np.int64)
        share = np.expand_dims((at - first).astype(np.float32), (1 - axis, 2))
        ends = (values.take(wrapped(index, before, wrap), axis) for index in (first, first + 1))
        values = next(ends) * (1 - share) + next(ends) * share
    return values


# The occlusion textures of a glTF document that was read.


def gltf_occlusion(document: GltfDocument, part: Part) -> PartOcclusion:
    """Return the occlusion texture of a part's material, with the TEXCOORD_n it is for, its transform applied.

    Raises InputError, or what a dictionary or list does, where the document is damaged.
    """
    assert isinstance(part.source, PrimitiveSource)  # the reader made it
    primitive = document.entry("meshes", part.source.mesh)["primitives"][part.source.primitive]
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    info: Json | None = material.get("occlusionTexture")
    if info is None:
        return PartOcclusion(None, _uvs(document, part, primitive, TextureUse(0, 0)))
    use, strength = TextureUse.of(info), info.get("strength", 1.0)
    note = f"the occlusion texture has a strength of {strength:g}, which is not applied" if strength != 1 else ""
    return PartOcclusion(texture_picture(document, use.index), _uvs(document, part, primitive, use), note)


def _uvs(document: GltfDocument, part: Part, primitive: Json, use: TextureUse) -> Float64Array | None:
    accessor = primitive["attributes"].get(f"TEXCOORD_{use.uv_set}")
    if accessor is None:
        return None
    values = doubles(document, accessor)
    check_indices(document.path, part.vertices, len(values))
    return use.places(values)[part.vertices]
