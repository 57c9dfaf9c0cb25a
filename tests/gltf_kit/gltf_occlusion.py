"""Whether a baked glTF document has its occlusion texture where it was baked, and there alone."""

from aoprecalc.types import Baked
from gltf_kit.gltf_values import GltfValues, holders

TRANSFORM, UNLIT = "KHR_texture_transform", "KHR_materials_unlit"


def receivers(baked: Baked) -> set[tuple[int, int]]:
    """(node, primitive) of those that have a place in the texture."""
    return {
        (part.source.node, part.source.primitive)
        for part in baked.scene.parts
        if part.receives and (part.uv_owner is not None or baked.atlas.mapped[part.faces].any())
    }


def occlusion_faults(
    before: GltfValues, after: GltfValues, picture: bytes, receiving: set[tuple[int, int]]
) -> list[str]:
    """What is wrong with occlusion textures and UV sets in a baked document, each as a path and words.

    picture     the baked file
    receiving   (node, primitive) of those that it was baked for
    """
    found = []
    for node, index, primitive in _primitives(after):
        at = f"/nodes/{node}/mesh/primitives/{index}"
        sets = {name for name in primitive["attributes"] if name.startswith("TEXCOORD_")}
        if sets != {f"TEXCOORD_{place}" for place in range(len(sets))}:
            found.append(f"{at}: has {sorted(sets)}")
        earlier = before.json["meshes"][before.json["nodes"][node]["mesh"]]["primitives"][index]
        for old, new in zip(holders(earlier), holders(primitive), strict=True):
            was, now = before.material(old).get("occlusionTexture"), after.material(new).get("occlusionTexture")
            if (node, index) in receiving and UNLIT not in after.material(new).get("extensions", {}):
                found += [f"{at}: its occlusionTexture {fault}" for fault in _faults(after, now, picture, sets)]
            elif before.followed(was) != after.followed(now):
                found.append(f"{at}: is not baked, but has another occlusionTexture than before")
    return found


def _primitives(document):
    for number, node in enumerate(document.json["nodes"]):
        if "mesh" in node:
            for index, primitive in enumerate(document.json["meshes"][node["mesh"]]["primitives"]):
                yield number, index, primitive


def _faults(document, info, picture, sets):
    if info is None:
        return ["is missing"]
    faults = {
        "shows another picture": document.texture(info["index"])["source"][0] != picture,
        "names a set that is not there": f"TEXCOORD_{info.get('texCoord', 0)}" not in sets,
        "is transformed": TRANSFORM in info.get("extensions", {}),
    }
    return [fault for fault, there in faults.items() if there]
