"""The occlusion textures of a glTF document that was read."""

from aoprecalc.files.damage import check_indices
from aoprecalc.files.gltf.accessors import doubles
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.files.gltf.reader import GltfSource
from aoprecalc.files.gltf.textures import TextureUse, texture_picture
from aoprecalc.files.pictured import Pictured
from aoprecalc.model import Doubles, Part


def gltf_occlusion(document: GltfDocument, part: Part) -> Pictured:
    """Return the occlusion texture of a part's material, with the TEXCOORD_n it is for, its transform applied.

    Raises InputError, or what a dictionary or list does, where the document is damaged.
    """
    assert isinstance(part.source, GltfSource)  # the reader made it
    primitive = document.entry("meshes", part.source.mesh)["primitives"][part.source.primitive]
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    info: Json | None = material.get("occlusionTexture")
    if info is None:
        return Pictured(None, _uvs(document, part, primitive, TextureUse(0, 0)))
    use, strength = TextureUse.of(info), info.get("strength", 1.0)
    note = f"the occlusion texture has a strength of {strength:g}, which is not applied" if strength != 1 else ""
    return Pictured(texture_picture(document, use.index), _uvs(document, part, primitive, use), note)


def _uvs(document: GltfDocument, part: Part, primitive: Json, use: TextureUse) -> Doubles | None:
    accessor = primitive["attributes"].get(f"TEXCOORD_{use.uv_set}")
    if accessor is None:
        return None
    values = doubles(document, accessor)
    check_indices(document.path, part.vertices, len(values))
    return use.places(values)[part.vertices]
