"""Occlusion textures on the materials of a glTF document that is being written."""

from collections.abc import Iterator, Mapping
from copy import deepcopy

from aoprecalc.files.gltf.document import Json

VARIANTS = "KHR_materials_variants"


def occlude(document: Json, sets: Mapping[tuple[int, int], int], texture: int) -> tuple[str, ...]:
    """Give the materials of some primitives a texture as their occlusion texture.

    sets      (mesh, primitive) -> which TEXCOORD_n of that primitive the texture is for
    texture   its number in the document

    A material that other primitives need without it, or with another set, is doubled; a primitive without a
    material gets one. Returns what the user should know: how many occlusion textures were replaced.
    """
    materials: list[Json] = document.setdefault("materials", [])
    taken = {
        holder["material"]
        for mesh_index, mesh in enumerate(document["meshes"])
        for index, primitive in enumerate(mesh["primitives"])
        if (mesh_index, index) not in sets
        for holder in _holders(primitive)
        if "material" in holder
    }
    occluded = {index for index, material in enumerate(materials) if "occlusionTexture" in material}
    made: dict[tuple[int | None, int], int] = {}
    for (mesh_index, index), number in sets.items():
        for holder in _holders(document["meshes"][mesh_index]["primitives"][index]):
            key = (holder.get("material"), number)
            if key not in made:
                made[key] = _own_material(materials, key[0], taken)
                # Nothing of an earlier one is kept: its KHR_texture_transform could choose another set than texCoord.
                materials[made[key]]["occlusionTexture"] = texture_reference(texture, number)
            holder["material"] = made[key]
    replaced = len(occluded & {index for index, _ in made})
    return (f"{replaced} materials had an occlusion texture of their own, which was replaced",) if replaced else ()


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
