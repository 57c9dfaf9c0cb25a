"""Pictures of occlusion, roughness and metalness in one: the R, G and B that glTF reads these from."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.files.gltf.materials import roughness_texture
from aoprecalc.files.gltf.textures import TextureUse, texture_picture, texture_wraps
from aoprecalc.files.images import png_bytes
from aoprecalc.model import Atlas, Floats, Wrap
from aoprecalc.surface.wrap import wrapped


@dataclass(frozen=True, eq=False)
class OrmPicture:
    """A packed picture.

    data      a PNG of 8 bits, linear
    sampler   that of the texture with roughness and metalness; None for the default
    """

    data: bytes
    sampler: Json | None


def orm_pictures(
    document: GltfDocument, materials: Mapping[int, int], atlas: Atlas, occlusion: Floats
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
    if atlas.wraps and texture_wraps(document, use.index) != ("repeat", "repeat"):
        return "with one that does not repeat as the UVs do (set its sampler to REPEAT)"
    return ""


def _packed(document: GltfDocument, texture: int, atlas: Atlas, occlusion: Floats) -> OrmPicture:
    pixels = texture_picture(document, texture).pixels()
    colors = pixels[:, :, 1:3] if pixels.shape[2] >= 3 else pixels[:, :, [0, 0]]  # grey is the same in all
    height, width = max(len(pixels), len(occlusion)), max(pixels.shape[1], occlusion.shape[1])
    own: Wrap = "repeat" if atlas.wraps else "clamp"
    layers = [
        _enlarged(occlusion[:, :, None], height, width, (own, own)),
        _enlarged(colors, height, width, texture_wraps(document, texture)),
    ]
    entry = document.entry("textures", texture)
    sampler = document.entry("samplers", entry["sampler"]) if "sampler" in entry else None
    return OrmPicture(png_bytes(np.concatenate(layers, axis=2)), sampler)


def _enlarged(values: Floats, height: int, width: int, wraps: tuple[Wrap, Wrap]) -> Floats:
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
