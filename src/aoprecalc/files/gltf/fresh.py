"""Makes a glTF document for a scene that came from another kind of file."""

from collections.abc import Sequence

import numpy as np

from aoprecalc.files.corners import split_corners
from aoprecalc.files.gltf.buffer import GltfBuffer
from aoprecalc.files.gltf.document import Json
from aoprecalc.files.gltf.materials import texture_reference
from aoprecalc.files.obj.library import Use, material_names, material_use
from aoprecalc.files.obj.materials import Material
from aoprecalc.files.obj.reader import ObjDocument
from aoprecalc.files.references import relative_uri
from aoprecalc.model import Atlas, Doubles, Floats, Part, Scene


def fresh_document(scene: Scene, atlas: Atlas, normals: Floats) -> tuple[Json, GltfBuffer, dict[tuple[int, int], int]]:
    """Return (json, buffer, sets) for a scene: a node and a mesh for each name and material among its parts.

    Positions are rounded to float32. Materials of an OBJ keep their diffuse colour and texture, the image of which has
    a URI that counts from the scene's folder. UVs that the file has are kept: before new ones where a texture lies on
    them, else after these, since plain viewers know only the first set. Parts that do not receive have the file's UVs
    and normals alone. `sets` tells for each (mesh, primitive) that receives which TEXCOORD_n is the atlas's.
    """
    json: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0, "scenes": [{"nodes": []}]}
    json |= {"nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(json)
    known = scene.document.materials if isinstance(scene.document, ObjDocument) else {}
    names = material_names(scene.parts, known)
    materials: dict[Use, int] = {}
    sets = {}
    for (name, use), parts in _groups(scene).items():
        material = known.get(use[0] or "", Material(""))
        if use not in materials:
            materials[use] = len(json["materials"])
            json["materials"].append(_material(json, names[use], material, scene))

        own, new = scene.uv_sets[:1], [atlas.uvs] if use[1] and atlas.uv_set is None else []
        uv_sets = [*own, *new] if material.picture else [*new, *own]
        primitive = _primitive(buffer, scene, parts, normals if use[1] else scene.normals, uv_sets)
        if use[1]:
            sets[len(json["meshes"]), 0] = len(own) if new and material.picture else 0
        json["scenes"][0]["nodes"].append(len(json["nodes"]))
        json["nodes"].append({"name": _clean(name), "mesh": len(json["meshes"])})
        json["meshes"].append({"name": _clean(name), "primitives": [primitive | {"material": materials[use]}]})
    return json, buffer, sets


def show_texture(json: Json, sets: dict[tuple[int, int], int], texture: int) -> None:
    """Make the baked texture the base colour as well, where a material has none: plain viewers show only that."""
    for (mesh, index), number in sets.items():
        material = json["materials"][json["meshes"][mesh]["primitives"][index]["material"]]
        material["pbrMetallicRoughness"].setdefault("baseColorTexture", texture_reference(texture, number))


def _groups(scene: Scene) -> dict[tuple[str, Use], list[Part]]:
    groups: dict[tuple[str, Use], list[Part]] = {}
    for part in scene.parts:
        groups.setdefault((part.name, material_use(part)), []).append(part)
    return groups


def _primitive(
    buffer: GltfBuffer, scene: Scene, parts: Sequence[Part], normals: Floats | None, uv_sets: Sequence[Doubles]
) -> Json:
    """Return a primitive of the faces of some parts, with these values at the corners of all faces."""
    faces = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    values = {} if normals is None else {"NORMAL": normals[faces]}
    values |= {f"TEXCOORD_{number}": _upside_down(uvs[faces]) for number, uvs in enumerate(uv_sets)}
    split = split_corners(scene.faces[faces], *values.values())
    positions = scene.positions[scene.faces[faces].reshape(-1)[split.corner]]
    attributes = {"POSITION": buffer.add_floats(positions, bounded=True)}
    for name, array in values.items():
        attributes[name] = buffer.add_floats(array.reshape(-1, array.shape[2])[split.corner])
    return {"attributes": attributes, "indices": buffer.add_triangles(split.triangles)}


def _material(json: Json, name: str, material: Material, scene: Scene) -> Json:
    color: Json = {"baseColorFactor": [*material.color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    if material.picture is not None and scene.uvs is not None:
        images, textures = json.setdefault("images", []), json.setdefault("textures", [])
        images.append({"uri": relative_uri(material.picture, scene.path)})
        textures.append({"source": len(images) - 1})
        color["baseColorTexture"] = {"index": len(textures) - 1}
    return {"name": _clean(name), "pbrMetallicRoughness": color}


def _upside_down(uvs: Doubles) -> Floats:
    return np.stack([uvs[:, :, 0], 1.0 - uvs[:, :, 1]], axis=2).astype(np.float32)


def _clean(name: str) -> str:
    """Return a name whose bytes were no UTF-8 with the replacement character in their place."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
