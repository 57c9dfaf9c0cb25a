"""The textures of a glTF document that was read: their pictures, and how they lie on a surface."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.files.damage import damaged
from aoprecalc.files.gltf.accessors import view_bytes
from aoprecalc.files.gltf.document import GltfDocument, Json, data_uri, local_file
from aoprecalc.files.pictured import Picture
from aoprecalc.model import Doubles, Wrap

TRANSFORM = "KHR_texture_transform"

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}


@dataclass(frozen=True, eq=False)
class TextureUse:
    """How a material uses a texture (a textureInfo).

    index      of the texture
    uv_set     the n of the TEXCOORD_n that it is for
    scale      (2,), and then
    rotation   radians, counter-clockwise as seen with v downwards, and then
    offset     (2,) are applied to the UVs first
    """

    index: int
    uv_set: int
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, info: Json) -> "TextureUse":
        """Read a textureInfo, with its transform if it has one, whose texCoord counts more than the outer one."""
        transform: Json = info.get("extensions", {}).get(TRANSFORM, {})
        uv_set: int = transform["texCoord"] if "texCoord" in transform else info.get("texCoord", 0)
        return cls(
            info["index"],
            uv_set,
            tuple(transform.get("scale", (1.0, 1.0))),
            transform.get("rotation", 0.0),
            tuple(transform.get("offset", (0.0, 0.0))),
        )

    def places(self, uvs: Doubles) -> Doubles:
        """Return where (..., 2) UVs, v downwards as in the file, lie in the texture, v upwards."""
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        turn = np.array([[cos, sin], [-sin, cos]])
        moved: Doubles = uvs * self.scale @ turn.T + self.offset
        return moved * (1, -1) + (0, 1)


def texture_picture(document: GltfDocument, index: int) -> Picture:
    """Return the picture of texture `index`; raises InputError where there is none, KeyError in a damaged document."""
    texture = document.entry("textures", index)
    # Formats that glTF itself does not know have their image in an extension.
    others = [entry["source"] for entry in texture.get("extensions", {}).values() if "source" in entry]
    if "source" not in texture and not others:
        raise damaged(document.path, f"texture {index} has no picture (no source), one was expected")
    number = texture["source"] if "source" in texture else others[0]
    image = document.entry("images", number)
    name = f"image {number} of {document.path}"
    if "bufferView" in image:
        return Picture(name, data=view_bytes(document, image["bufferView"]))
    if image["uri"].startswith("data:"):
        return Picture(name, data=data_uri(document.path, image["uri"]))
    file = local_file(document.path, image["uri"])
    return Picture(name) if file is None else Picture(str(file), file)


def texture_wraps(document: GltfDocument, index: int) -> tuple[Wrap, Wrap]:
    """Return what texture `index` does beyond [0, 1] along u and v."""
    texture = document.entry("textures", index)
    sampler = document.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    return _WRAPS[sampler.get("wrapS", 10497)], _WRAPS[sampler.get("wrapT", 10497)]
