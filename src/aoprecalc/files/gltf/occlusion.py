"""The occlusion textures of a glTF document that was read."""

import numpy as np

from aoprecalc.files.damage import check_indices
from aoprecalc.files.gltf.accessors import doubles, view_bytes
from aoprecalc.files.gltf.document import GltfDocument, Json, data_uri, local_file
from aoprecalc.files.gltf.reader import GltfSource
from aoprecalc.files.pictured import Picture, Pictured
from aoprecalc.model import Doubles, Part

TRANSFORM = "KHR_texture_transform"


def gltf_occlusion(document: GltfDocument, part: Part) -> Pictured:
    """Return the occlusion texture of a part's material, with the TEXCOORD_n it is for, its transform applied.

    Raises InputError, or what a dictionary or list does, where the document is damaged.
    """
    assert isinstance(part.source, GltfSource)  # the reader made it
    primitive = document.entry("meshes", part.source.mesh)["primitives"][part.source.primitive]
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    use: Json = material.get("occlusionTexture", {})
    transform: Json = use.get("extensions", {}).get(TRANSFORM, {})
    number = transform.get("texCoord", use.get("texCoord", 0))
    uvs = _uvs(document, part, primitive["attributes"].get(f"TEXCOORD_{number}"), transform)
    strength = use.get("strength", 1.0)
    note = f"the occlusion texture has a strength of {strength:g}, which is not applied" if strength != 1 else ""
    return Pictured(_picture(document, use["index"]) if use else None, uvs, note)


def _uvs(document: GltfDocument, part: Part, accessor: int | None, transform: Json) -> Doubles | None:
    if accessor is None:
        return None
    values = doubles(document, accessor)
    check_indices(document.path, part.vertices, len(values))
    angle = transform.get("rotation", 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    # Scaled, turned counter-clockwise as seen, with v downwards, then moved.
    turn = np.array([[cos, sin], [-sin, cos]])
    values = values * transform.get("scale", (1.0, 1.0)) @ turn.T + transform.get("offset", (0.0, 0.0))
    uvs: Doubles = values[part.vertices] * (1, -1) + (0, 1)
    return uvs


def _picture(document: GltfDocument, index: int) -> Picture:
    texture = document.entry("textures", index)
    # Formats that glTF itself does not know have their image in an extension.
    others = [entry["source"] for entry in texture.get("extensions", {}).values() if "source" in entry]
    number = texture["source"] if "source" in texture else others[0]
    image = document.entry("images", number)
    name = f"image {number} of {document.path}"
    if "bufferView" in image:
        return Picture(name, data=view_bytes(document, image["bufferView"]))
    if image["uri"].startswith("data:"):
        return Picture(name, data=data_uri(document.path, image["uri"]))
    file = local_file(document.path, image["uri"])
    return Picture(name) if file is None else Picture(str(file), file)
