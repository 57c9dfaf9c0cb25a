"""What light does at the primitives of a glTF document, as their materials say."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.files.damage import check_indices
from aoprecalc.files.gltf.accessors import doubles
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.files.gltf.textures import TextureUse, texture_picture, texture_wraps
from aoprecalc.files.pictured import Picture
from aoprecalc.model import SWAPPED, Cutout, Doubles, Floats, Look

TRANSMISSION, UNLIT = "KHR_materials_transmission", "KHR_materials_unlit"

_OPAQUE: Floats = np.ones((1, 1), np.float32)


class Looks:
    """The looks of a document's primitives; every picture is read once.

    warnings   what the user should know: the pictures that are missing
    """

    def __init__(self, document: GltfDocument) -> None:
        """Read nothing yet."""
        self._document = document
        self._alphas: dict[Picture, Floats] = {}
        self.warnings: list[str] = []

    def name(self, primitive: Json) -> str | None:
        """Return the name of a primitive's material."""
        name: str | None = self._material(primitive).get("name")
        return name

    def look(self, primitive: Json, vertices: NDArray[np.int64]) -> Look:
        """Return the look of a primitive whose triangles are the (f, 3) vertices."""
        material = self._material(primitive)
        extensions, mode = material.get("extensions", {}), material.get("alphaMode", "OPAQUE")
        return Look(
            glass=mode == "BLEND" or extensions.get(TRANSMISSION, {}).get("transmissionFactor", 0) > 0,
            unlit=UNLIT in extensions,
            leafy=mode == "MASK" and bool(material.get("doubleSided")),
            cutout=self._cutout(primitive, material, vertices) if mode == "MASK" else None,
        )

    def _material(self, primitive: Json) -> Json:
        return self._document.entry("materials", primitive["material"]) if "material" in primitive else {}

    def _cutout(self, primitive: Json, material: Json, vertices: NDArray[np.int64]) -> Cutout:
        """Return the holes of a material: where picture, factor and vertex colour together are below the cutoff."""
        attributes, color = primitive["attributes"], material.get("pbrMetallicRoughness", {})
        factors = np.full(vertices.shape, color.get("baseColorFactor", (1, 1, 1, 1))[3], np.float64)
        if "COLOR_0" in attributes:
            colors = self._corners(attributes["COLOR_0"], vertices)
            factors *= colors[:, :, 3] if colors.shape[2] == 4 else 1.0
        cutoff = float(material.get("alphaCutoff", 0.5))
        solid = Cutout(_OPAQUE, np.zeros((*vertices.shape, 2)), factors, cutoff)
        if "baseColorTexture" not in color:
            return solid
        use = TextureUse.of(color["baseColorTexture"])
        if f"TEXCOORD_{use.uv_set}" not in attributes:
            return solid
        uvs = use.places(self._corners(attributes[f"TEXCOORD_{use.uv_set}"], vertices))
        wraps = texture_wraps(self._document, use.index)
        return Cutout(self._alpha(use.index), uvs, factors, cutoff, wraps)

    def _corners(self, accessor: int, vertices: NDArray[np.int64]) -> Doubles:
        values = doubles(self._document, accessor)
        check_indices(self._document.path, vertices, len(values))
        return values[vertices]

    def _alpha(self, texture: int) -> Floats:
        """Return the alpha of a texture's picture; 1 where it has none."""
        try:
            picture = texture_picture(self._document, texture)
            if picture not in self._alphas:
                pixels = picture.pixels()
                has_alpha = pixels.shape[2] in (2, 4)
                self._alphas[picture] = np.ascontiguousarray(pixels[:, :, -1]) if has_alpha else _OPAQUE
            return self._alphas[picture]
        except InputError as error:
            warning = f"holes are not known and left out: {error}"
            if warning not in self.warnings:
                self.warnings.append(warning)
            return _OPAQUE


def mirrored_look(look: Look) -> Look:
    """Return a look whose corners 1 and 2 are exchanged."""
    if look.cutout is None:
        return look
    cutout = replace(look.cutout, uvs=look.cutout.uvs[:, SWAPPED], factors=look.cutout.factors[:, SWAPPED])
    return replace(look, cutout=cutout)
