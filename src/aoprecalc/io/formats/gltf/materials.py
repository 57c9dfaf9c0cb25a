"""Textures and materials of a glTF document that is read: images, UV transforms, alpha masks, transparency, colours.

And the UV sets that they need, so that new UVs get another one.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted
from aoprecalc.io.formats.builder import check_indices, damaged_file
from aoprecalc.io.formats.files import ColorImages, ImageSource
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, data_uri, float_values, local_file, view_bytes
from aoprecalc.texture_lookup import repeating_texture
from aoprecalc.types import (
    REVERSED_WINDING,
    AlphaMask,
    BaseColor,
    Float32Array,
    Float64Array,
    Material,
    UInt8Array,
    Wrap,
)

TRANSFORM = "KHR_texture_transform"

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}


@dataclass(frozen=True, eq=False)
class TextureUse:
    """A texture of a material (textureInfo), with its KHR_texture_transform.

    index      of the texture
    texcoord   the n of its TEXCOORD_n
    scale      of the UVs, applied first
    rotation   radians, counter-clockwise with v downwards, applied second
    offset     applied last
    """

    index: int
    texcoord: int
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, info: Json) -> "TextureUse":
        """Read a textureInfo and its transform, whose texCoord overrides the outer one."""
        transform: Json = info.get("extensions", {}).get(TRANSFORM, {})
        texcoord: int = transform["texCoord"] if "texCoord" in transform else info.get("texCoord", 0)
        return cls(
            info["index"],
            texcoord,
            tuple(transform.get("scale", (1.0, 1.0))),
            transform.get("rotation", 0.0),
            tuple(transform.get("offset", (0.0, 0.0))),
        )

    def transform(self, uvs: Float64Array) -> Float64Array:
        """Transform (..., 2) UVs, v downwards as in the file, to UVs of the texture, v upwards."""
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        rotation = np.array([[cos, sin], [-sin, cos]])
        transformed: Float64Array = uvs * self.scale @ rotation.T + self.offset
        return transformed * (1, -1) + (0, 1)


def texture_image(document: GltfDocument, index: int) -> ImageSource:
    """Return the image of texture `index`; raises InputError where it has none, KeyError in a damaged document."""
    texture = document.entry("textures", index)
    # Extensions for other image formats have a source of their own.
    alternatives = [entry["source"] for entry in texture.get("extensions", {}).values() if "source" in entry]
    if "source" not in texture and not alternatives:
        raise damaged_file(document.path, f"texture {index} has no image (no source), one was expected")
    number = texture["source"] if "source" in texture else alternatives[0]
    image = document.entry("images", number)
    name = f"image {number} of {document.path}"
    if "bufferView" in image:
        return ImageSource(name, data=view_bytes(document, image["bufferView"]))
    if image["uri"].startswith("data:"):
        return ImageSource(name, data=data_uri(document.path, image["uri"]))
    file = local_file(document.path, image["uri"])
    return ImageSource(name) if file is None else ImageSource.of(file)


def texture_wraps(document: GltfDocument, index: int) -> tuple[Wrap, Wrap]:
    """Return the wrap modes of texture `index` along u and v."""
    texture = document.entry("textures", index)
    sampler = document.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    return _WRAPS[sampler.get("wrapS", 10497)], _WRAPS[sampler.get("wrapT", 10497)]


LOD = "MSFT_lod"
TRANSMISSION, UNLIT, VARIANTS = "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_variants"
METADATA = "EXT_structural_metadata"


def material_holders(primitive: Json) -> Iterator[Json]:
    """Yield the objects that refer to a material: the primitive itself and the mappings of its variants."""
    yield primitive
    yield from primitive.get("extensions", {}).get(VARIANTS, {}).get("mappings", [])


def coarser_materials(material: Json) -> list[int]:
    """Return the indices of a material's coarser levels of detail (MSFT_lod), which the same primitives show."""
    ids: list[int] = material.get("extensions", {}).get(LOD, {}).get("ids", [])
    return ids


_OPAQUE: Float32Array = np.ones((1, 1), np.float32)


class MaterialReader:
    """Reads the materials of a document's primitives; every image is decoded once.

    warnings   for the user, about images that cannot be read
    """

    def __init__(self, document: GltfDocument) -> None:
        """Start without images."""
        self._document = document
        self._alphas: dict[ImageSource, Float32Array] = {}
        self.warnings: list[str] = []

    def name(self, primitive: Json) -> str | None:
        """Return the name of a primitive's material."""
        name: str | None = self._material(primitive).get("name")
        return name

    def material(self, primitive: Json, vertices: NDArray[np.int64]) -> Material:
        """Return the material of a primitive whose triangles are the (f, 3) vertices."""
        material = self._material(primitive)
        extensions, mode = material.get("extensions", {}), material.get("alphaMode", "OPAQUE")
        return Material(
            transparent=mode == "BLEND" or extensions.get(TRANSMISSION, {}).get("transmissionFactor", 0) > 0,
            unlit=all(UNLIT in self._material(each).get("extensions", {}) for each in material_holders(primitive)),
            foliage=mode == "MASK" and bool(material.get("doubleSided")),
            double_sided=bool(material.get("doubleSided")),
            alpha_mask=self._alpha_mask(primitive, material, vertices) if mode == "MASK" else None,
        )

    def _material(self, primitive: Json) -> Json:
        return self._document.entry("materials", primitive["material"]) if "material" in primitive else {}

    def _alpha_mask(self, primitive: Json, material: Json, vertices: NDArray[np.int64]) -> AlphaMask:
        """Return the alpha mask of a material: the product of base colour texture, factor and vertex colour."""
        attributes, color = primitive["attributes"], material.get("pbrMetallicRoughness", {})
        factors = np.full(vertices.shape, color.get("baseColorFactor", (1, 1, 1, 1))[3], np.float64)
        if "COLOR_0" in attributes:
            colors = self._corners(attributes["COLOR_0"], vertices)
            factors *= colors[:, :, 3] if colors.shape[2] == 4 else 1.0
        cutoff = float(material.get("alphaCutoff", 0.5))
        untextured = AlphaMask(_OPAQUE, np.zeros((*vertices.shape, 2)), factors, cutoff)
        if "baseColorTexture" not in color:
            return untextured
        use = TextureUse.of(color["baseColorTexture"])
        if f"TEXCOORD_{use.texcoord}" not in attributes:
            return untextured
        uvs = use.transform(self._corners(attributes[f"TEXCOORD_{use.texcoord}"], vertices))
        wraps = texture_wraps(self._document, use.index)
        return AlphaMask(self._alpha(use.index), uvs, factors, cutoff, wraps)

    def _corners(self, accessor: int, vertices: NDArray[np.int64]) -> Float64Array:
        values = float_values(self._document, accessor)
        check_indices(self._document.path, vertices, len(values))
        return values[vertices]

    def _alpha(self, texture: int) -> Float32Array:
        """Return the alpha channel of a texture, (h, w) float32; 1 where it has none."""
        try:
            image = texture_image(self._document, texture)
            if image not in self._alphas:
                pixels = image.pixels()
                has_alpha = pixels.shape[2] in (2, 4)
                self._alphas[image] = np.ascontiguousarray(pixels[:, :, -1]) if has_alpha else _OPAQUE
            return self._alphas[image]
        except InputError as error:
            warning = f"an alpha mask cannot be read and is taken as opaque: {error}"
            if warning not in self.warnings:
                self.warnings.append(warning)
            return _OPAQUE


def mirrored_material(material: Material) -> Material:
    """Return a material with corners 1 and 2 of each face exchanged."""
    if material.alpha_mask is None:
        return material
    alpha_mask = replace(
        material.alpha_mask,
        uvs=material.alpha_mask.uvs[:, REVERSED_WINDING],
        factors=material.alpha_mask.factors[:, REVERSED_WINDING],
    )
    return replace(material, alpha_mask=alpha_mask)


SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"


def base_color(document: GltfDocument, primitive: Json, vertices: NDArray[np.int32], images: ColorImages) -> BaseColor:
    """Return the base colour of a primitive whose corners are the (f, 3) vertices: texture, factor and vertex colours.

    A texture that is missing or damaged is left out; `images` warns of it.
    """
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    specular = material.get("extensions", {}).get(SPECULAR_GLOSSINESS)
    if specular is None:
        pbr = material.get("pbrMetallicRoughness", {})
        factor, info = pbr.get("baseColorFactor"), pbr.get("baseColorTexture")
    else:
        factor, info = specular.get("diffuseFactor"), specular.get("diffuseTexture")
    red, green, blue = (min(max(float(value), 0.0), 1.0) for value in (factor or (1, 1, 1))[:3])

    def at_corners(name: str) -> Float64Array | None:
        if name not in primitive["attributes"]:
            return None
        values = float_values(document, primitive["attributes"][name])
        check_indices(document.path, vertices, len(values))
        return values[vertices]

    colors = at_corners("COLOR_0")
    corners = None if colors is None else np.clip(colors[..., :3], 0, 1).astype(np.float32)
    use = None if info is None else TextureUse.of(info)
    uvs = None if use is None else at_corners(f"TEXCOORD_{use.texcoord}")
    texture = None if use is None or uvs is None else _base_texture(document, use.index, images)
    if use is None or uvs is None or texture is None:
        return BaseColor((red, green, blue), corners=corners)
    texture, uvs = repeating_texture(texture, use.transform(uvs), texture_wraps(document, use.index))
    return BaseColor((red, green, blue), texture, uvs, corners)


def _base_texture(document: GltfDocument, texture: int, images: ColorImages) -> UInt8Array | None:
    try:
        return images.get(texture_image(document, texture))
    except InputError as error:  # there is no image
        images.warn(error)
        return None


# Which UV sets are needed, and which one new UVs get.

_TEXCOORD = "TEXCOORD_"

# Viewers need to support TEXCOORD_0 and TEXCOORD_1 only.
PORTABLE_UV_SETS = 2


def new_uv_set(document: GltfDocument, primitive: Json, needed: Collection[int]) -> int:
    """Return the n of the TEXCOORD_n for new UVs: the first free one, or that of a set which nothing needs.

    needed   the n of those that any primitive may need

    A set is replaced only where all that viewers support are taken; TEXCOORD_1 rather than the first, which simple
    programs show.
    """
    attributes = primitive["attributes"]
    free = next(number for number in count() if f"TEXCOORD_{number}" not in attributes)
    if free < PORTABLE_UV_SETS:
        return free
    needed = {*needed, *uv_sets_used(document, primitive)}
    return next((number for number in reversed(range(PORTABLE_UV_SETS)) if number not in needed), free)


def replaced_uv_sets(document: GltfDocument, uses: Sequence[tuple[Json, int]]) -> Iterator[str]:
    """Yield warnings about UV sets that nothing referred to and that were replaced.

    uses   original primitives, each with the n of its new TEXCOORD_n
    """
    replaced = [
        number
        for primitive, number in uses
        if f"TEXCOORD_{number}" in primitive["attributes"]
        and number not in uv_sets_used(document, primitive, with_occlusion=True)
    ]
    for number, times in sorted(Counter(replaced).items()):
        yield f"TEXCOORD_{number} of {counted(times, 'primitive')}, to which nothing referred, was replaced"


def uv_sets_used(document: GltfDocument, primitive: Json, *, with_occlusion: bool = False) -> set[int]:
    """Return the n of each TEXCOORD_n that a primitive's materials, extensions or morph targets refer to.

    with_occlusion   also for occlusion textures, although a bake replaces them
    """
    extensions = primitive.get("extensions", {})
    holders: list[Any] = [extensions]
    numbers = [holder["material"] for holder in material_holders(primitive) if "material" in holder]
    numbers += [other for number in numbers for other in coarser_materials(document.entry("materials", number))]
    for material in (document.entry("materials", number) for number in numbers):
        stays = with_occlusion or UNLIT in material.get("extensions", {})
        holders.append({key: value for key, value in material.items() if stays or key != "occlusionTexture"})
    tables = document.json.get("extensions", {}).get(METADATA, {}).get("propertyTextures", [])
    holders += [tables[index] for index in extensions.get(METADATA, {}).get("propertyTextures", [])]
    morphed = {name for target in primitive.get("targets", []) for name in target if name.startswith(_TEXCOORD)}
    return {*_texcoords(holders), *(int(name.removeprefix(_TEXCOORD)) for name in morphed)}


def uv_sets_of_extensions(json: Json) -> set[int]:
    """Return the n of each TEXCOORD_n that extensions of the document, its scenes, nodes and meshes refer to.

    These may mean any primitive: lightmaps are an example.
    """
    entries = [json, *(entry for kind in ("scenes", "nodes", "meshes") for entry in json.get(kind, []))]
    extensions = [item for entry in entries for item in entry.get("extensions", {}).items()]
    return set(_texcoords([value for name, value in extensions if name != METADATA]))


def _texcoords(value: Any) -> Iterator[int]:
    """Yield the texCoord of every textureInfo in a JSON value, and that of its transform."""
    if isinstance(value, dict):
        if type(value.get("texCoord")) is int:
            yield value["texCoord"]
        elif "index" in value:
            yield 0
    if isinstance(value, dict | list):
        for member in value.values() if isinstance(value, dict) else value:
            yield from _texcoords(member)
