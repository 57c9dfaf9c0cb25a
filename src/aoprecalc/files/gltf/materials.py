"""Occlusion textures on the materials of a glTF document that is being written."""

from collections.abc import Collection, Iterator, Mapping
from copy import deepcopy

from aoprecalc.files.gltf.document import Json
from aoprecalc.files.gltf.looks import UNLIT

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
