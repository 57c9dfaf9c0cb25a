"""Makes a glTF document for a scene that came from another kind of file."""

import numpy as np

from aoprecalc.files.corners import split_corners
from aoprecalc.files.gltf.buffer import GltfBuffer
from aoprecalc.files.gltf.document import Json
from aoprecalc.files.gltf.materials import texture_reference
from aoprecalc.files.obj.materials import Material
from aoprecalc.files.obj.reader import ObjDocument, Section
from aoprecalc.files.references import relative_uri
from aoprecalc.model import Atlas, Floats, Part, Scene


def fresh_document(scene: Scene, atlas: Atlas, normals: Floats) -> tuple[Json, GltfBuffer, dict[tuple[int, int], int]]:
    """Return (json, buffer, sets) for a scene: a node and a mesh for each name and material among its parts.

    Positions are rounded to float32. Materials of an OBJ keep their diffuse colour and texture, the image of which has
    a URI that counts from the scene's folder. `sets` tells for each (mesh, primitive) which TEXCOORD_n is the atlas's.
    """
    json: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0, "scenes": [{"nodes": []}]}
    json |= {"nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(json)
    known = scene.document.materials if isinstance(scene.document, ObjDocument) else {}
    materials: dict[str, int] = {}
    sets = {}
    for (name, material_name), parts in _groups(scene).items():
        material = known.get(material_name, Material(material_name))
        if material_name not in materials:
            materials[material_name] = len(json["materials"])
            json["materials"].append(_material(json, material, scene))
        textured = material.picture is not None and scene.uvs is not None

        faces = np.concatenate([np.arange(part.start, part.stop) for part in parts])
        uv_sets = [atlas.uvs] if not textured or atlas.method == "keep" else [scene.uvs, atlas.uvs]
        uvs = [_upside_down(values[faces]) for values in uv_sets if values is not None]
        split = split_corners(scene.faces[faces], normals[faces], *uvs)
        corners = split.corner
        attributes = {
            "POSITION": buffer.add_floats(scene.positions[scene.faces[faces].reshape(-1)[corners]], bounds=True),
            "NORMAL": buffer.add_floats(normals[faces].reshape(-1, 3)[corners]),
        }
        for number, values in enumerate(uvs):
            attributes[f"TEXCOORD_{number}"] = buffer.add_floats(values.reshape(-1, 2)[corners])

        indices = buffer.add_triangles(split.triangles)
        primitive = {"attributes": attributes, "indices": indices, "material": materials[material_name]}
        sets[len(json["meshes"]), 0] = len(uvs) - 1
        json["scenes"][0]["nodes"].append(len(json["nodes"]))
        json["nodes"].append({"name": _clean(name), "mesh": len(json["meshes"])})
        json["meshes"].append({"name": _clean(name), "primitives": [primitive]})
    return json, buffer, sets


def show_texture(json: Json, sets: dict[tuple[int, int], int], texture: int) -> None:
    """Make the baked texture the base colour as well, where a material has none: plain viewers show only that."""
    for (mesh, index), number in sets.items():
        material = json["materials"][json["meshes"][mesh]["primitives"][index]["material"]]
        material["pbrMetallicRoughness"].setdefault("baseColorTexture", texture_reference(texture, number))


def _groups(scene: Scene) -> dict[tuple[str, str], list[Part]]:
    groups: dict[tuple[str, str], list[Part]] = {}
    for part in scene.parts:
        material = part.source.material if isinstance(part.source, Section) else None
        groups.setdefault((part.name, material or ""), []).append(part)
    return groups


def _material(json: Json, material: Material, scene: Scene) -> Json:
    color: Json = {"baseColorFactor": [*material.color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    if material.picture is not None and scene.uvs is not None:
        images, textures = json.setdefault("images", []), json.setdefault("textures", [])
        images.append({"uri": relative_uri(material.picture, scene.path)})
        textures.append({"source": len(images) - 1})
        color["baseColorTexture"] = {"index": len(textures) - 1}
    return {"name": _clean(material.name or "baked"), "pbrMetallicRoughness": color}


def _upside_down(uvs: Floats) -> Floats:
    return np.stack([uvs[:, :, 0], 1.0 - uvs[:, :, 1]], axis=2).astype(np.float32)


def _clean(name: str) -> str:
    """Return a name whose bytes were no UTF-8 with the replacement character in their place."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
