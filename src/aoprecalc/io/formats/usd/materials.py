"""UsdPreviewSurface: what the materials of a USD stage do to visibility, their colours and their occlusion."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import InputError, listed
from aoprecalc.io.formats.base import AlphaMode, Placement, SourceMaterial
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.texture_lookup import srgb_from_linear
from aoprecalc.types import AlphaMask, Float32Array, Float64Array, Material, Wrap

_WRAPS: dict[str, Wrap] = {"clamp": "clamp", "black": "clamp", "mirror": "mirror"}
BAKED = "aoprecalc"  # the customData of a baked texture: the options of its bake, as JSON
_OPAQUE = 1 - 1 / 255
_INPUTS_LEFT_OUT = (
    "emissiveColor",
    "specularColor",
    "metallic",
    "roughness",
    "clearcoat",
    "clearcoatRoughness",
    "normal",
    "displacement",
    "ior",
)
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3, "rgb": 0}


@dataclass(frozen=True, eq=False)
class TextureUse:
    """A UsdUVTexture that an input of a surface is connected to.

    channel       r, g, b, a or rgb
    uv_name       the primvar of its UVs
    matrix        (2, 3): by which column vectors (u, v, 1) become those of the texture
    scale, bias   (4,) of the values
    baked         the options of the bake that made it, as JSON; empty where the stage says none
    """

    image: ImageSource
    channel: str
    uv_name: str
    matrix: Float64Array
    wraps: tuple[Wrap, Wrap]
    scale: Float64Array
    bias: Float64Array
    baked: str = ""

    def transform(self, uvs: Float64Array) -> Float64Array:
        """Return (..., 2) UVs of the texture."""
        return np.asarray(uvs @ self.matrix[:, :2].T + self.matrix[:, 2])

    @property
    def factor(self) -> tuple[float, float, float]:
        """What its colours are multiplied by, linear, from 0 to 1; 1 where no such factor does what it says."""
        if not self.is_plain:
            return 1.0, 1.0, 1.0
        red, green, blue = self.scale[:3].tolist()
        return red, green, blue

    @property
    def is_plain(self) -> bool:
        """Whether its colours are those of the image times a factor from 0 to 1."""
        return not self.bias[:3].any() and bool(((self.scale[:3] >= 0) & (self.scale[:3] <= 1)).all())

    def values(self) -> Float32Array:
        """Return the values of its channel, (h, w) float32; raises InputError where the image cannot be read."""
        pixels, number = self.image.pixels(), _CHANNELS.get(self.channel, 0)
        if number == 3 and pixels.shape[2] not in (2, 4):
            return np.ones((1, 1), np.float32)
        channel = -1 if number == 3 else min(number, pixels.shape[2] - 1)
        return np.asarray(pixels[:, :, channel] * self.scale[number] + self.bias[number], np.float32)


@dataclass(frozen=True, eq=False)
class UsdMaterial:
    """A Material prim; without a UsdPreviewSurface it is white and opaque.

    name        unique among those of the stage
    prim        its path
    color       linear
    threshold   of the opacity: above 0, there are holes where it is less
    emission    linear
    others      further inputs that have textures
    """

    name: str
    prim: str
    color: tuple[float, float, float] = (0.18, 0.18, 0.18)
    color_texture: TextureUse | None = None
    opacity: float = 1.0
    threshold: float = 0.0
    opacity_texture: TextureUse | None = None
    occlusion: TextureUse | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roughness: float = 0.5
    metalness: float = 0.0
    others: tuple[str, ...] = ()

    @property
    def uv_names(self) -> tuple[str, ...]:
        """The primvars of its textures, without that of its occlusion."""
        uses = (self.color_texture, self.opacity_texture)
        return tuple(dict.fromkeys(use.uv_name for use in uses if use is not None))


def bound_material(prim: Any) -> tuple[Any, str]:
    """Return the material that previews show on a prim, and the purpose of its binding; (None, "") for none.

    The purpose is `preview`, or empty where the binding is for all purposes.
    """
    from pxr import UsdShade

    material, relationship = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
    if not material:
        return None, ""
    of_all = len(relationship.SplitName()) == (4 if ":collection:" in relationship.GetName() else 2)
    return material, "" if of_all else UsdShade.Tokens.preview


class UsdMaterials:
    """The materials of a stage, each read once.

    warnings   for the user, about textures that cannot be read
    """

    def __init__(self, path: Path, time: Any) -> None:
        """Start without materials, to be read at a time."""
        self._path, self._time = path, time
        self._by_prim: dict[str, UsdMaterial] = {}
        self._opacities: dict[str, Float32Array | None] = {}
        self._unknown: list[str] = []  # the names of those with a surface of another kind
        self.warnings: list[str] = []

    def bound_to(self, prim: Any) -> UsdMaterial | None:
        """Return the material that is bound to a prim; None where there is none."""
        material, _ = bound_material(prim)
        if material is None:
            return None
        path = str(material.GetPath())
        if path not in self._by_prim:
            taken = {known.name for known in self._by_prim.values()}
            name = material.GetPrim().GetName()
            free = name if name not in taken else path
            self._by_prim[path] = self._read(material, free, path)
        return self._by_prim[path]

    def messages(self) -> list[str]:
        """Return warnings about all that cannot be read of the materials."""
        lines = list(self.warnings)
        if self._unknown:
            found = f"materials without a UsdPreviewSurface are read as opaque and white: {listed(self._unknown)}"
            lines.append(f"{self._path}: {found}; export them with one")
        uses = {look.name: look.color_texture for look in self._by_prim.values()}
        if names := [name for name, use in uses.items() if use is not None and not use.is_plain]:
            found = f"the scale and bias of colour textures are ignored in {listed(names)}"
            lines.append(f"{self._path}: {found}; apply them to the images")
        return lines

    def sources(self) -> dict[str, SourceMaterial]:
        """Return what other formats get of the materials, by name."""
        return {material.name: self._source(material) for material in self._by_prim.values()}

    def visibility(
        self, look: UsdMaterial | None, uvs: Mapping[str, Float64Array], faces: int, *, double_sided: bool = False
    ) -> Material:
        """Return what matters to visibility, of faces with UVs by primvar."""
        if look is None:
            return Material()
        use = look.opacity_texture
        if use is None:
            hidden = look.opacity < look.threshold
            return Material(transparent=look.opacity < 1 and (look.threshold <= 0 or hidden))
        values = self._opacity(look)
        if values is None or use.uv_name not in uvs:
            return Material()
        if look.threshold <= 0:
            return Material(transparent=bool(values.min() < _OPAQUE))
        mask = AlphaMask(values, use.transform(uvs[use.uv_name]), np.ones((faces, 3)), look.threshold, use.wraps)
        return Material(foliage=double_sided, alpha_mask=mask)

    def _opacity(self, look: UsdMaterial) -> Float32Array | None:
        """Return the values of a material's opacity texture; None, and a warning, where they cannot be read."""
        assert look.opacity_texture is not None
        if look.prim not in self._opacities:
            self._opacities[look.prim] = None
            try:
                self._opacities[look.prim] = look.opacity_texture.values()
            except InputError as error:
                self.warnings.append(f"the material {look.name} is taken as opaque: {error}")
        return self._opacities[look.prim]

    def _source(self, look: UsdMaterial) -> SourceMaterial:
        color, opacity = look.color_texture, look.opacity_texture
        red, green, blue = srgb_from_linear(np.clip(color.factor if color else look.color, 0, 1)).tolist()
        left_out = [f"the texture of {name}" for name in look.others]
        glow_red, glow_green, glow_blue = srgb_from_linear(np.clip(look.emission, 0, 1)).tolist()
        mode: AlphaMode = "OPAQUE"
        if opacity is not None:
            values = self._opacity(look)
            if values is not None and values.min() < _OPAQUE:
                mode = "MASK" if look.threshold > 0 else "BLEND"
        elif look.opacity < 1 and look.threshold <= 0:
            mode = "BLEND"
        texture = None if color is None else color.image
        placement = Placement()
        if color is not None:
            (a, b, u), (c, d, v) = color.matrix.tolist()
            placement = Placement((a, d), (u, v), color.wraps[0])
            if b or c:
                left_out.append("the rotation of textures")
        return SourceMaterial(
            look.name,
            (red, green, blue),
            texture,
            placement,
            look.opacity if mode == "BLEND" else 1.0,
            None if mode == "OPAQUE" or opacity is None else opacity.image,
            {"a": "alpha", "r": "red", "g": "green", "b": "blue"}.get(opacity.channel, "") if opacity else "",
            mode,
            emission=(glow_red, glow_green, glow_blue),
            roughness=min(max(look.roughness, 0.0), 1.0),
            metalness=min(max(look.metalness, 0.0), 1.0),
            left_out=tuple(left_out),
        )

    # Shading networks.

    def _read(self, material: Any, name: str, path: str) -> UsdMaterial:
        surface = material.ComputeSurfaceSource()[0]
        if not surface or surface.GetShaderId() != "UsdPreviewSurface":
            if surface or any(output.HasConnectedSource() for output in material.GetSurfaceOutputs()):
                self._unknown.append(name)
            return UsdMaterial(name, path, (1.0, 1.0, 1.0))
        color, color_texture = self._input(surface, "diffuseColor", (0.18, 0.18, 0.18))
        opacity, opacity_texture = self._input(surface, "opacity", 1.0)
        red, green, blue = (float(value) for value in color)
        emitted = self._input(surface, "emissiveColor", (0.0, 0.0, 0.0))[0]
        others = [one for one in _INPUTS_LEFT_OUT if self._input(surface, one, 0.0)[1] is not None]
        return UsdMaterial(
            name,
            path,
            (red, green, blue),
            color_texture,
            float(opacity),
            float(self._input(surface, "opacityThreshold", 0.0)[0]),
            opacity_texture,
            self._input(surface, "occlusion", 1.0)[1],
            (float(emitted[0]), float(emitted[1]), float(emitted[2])),
            float(self._input(surface, "roughness", 0.5)[0]),
            float(self._input(surface, "metallic", 0.0)[0]),
            tuple(others),
        )

    def _input(self, shader: Any, name: str, default: Any) -> tuple[Any, TextureUse | None]:
        """Return the value of an input of a shader, and the texture that it is connected to."""
        value, source, output = self._value(shader, name, default)
        return value, None if source is None else self._texture(source, output)

    def _value(self, shader: Any, name: str, default: Any) -> tuple[Any, Any, str]:
        """Return the value of an input, else the shader that makes it and the name of its output."""
        from pxr import UsdShade

        given = shader.GetInput(name)
        attributes = UsdShade.Utils.GetValueProducingAttributes(given) if given else ()
        if not attributes:
            return default, None, ""
        attribute = attributes[0]
        if UsdShade.Output.IsOutput(attribute):
            return default, UsdShade.Shader(attribute.GetPrim()), attribute.GetBaseName()
        value = attribute.Get(self._time)
        return default if value is None else value, None, ""

    def _texture(self, shader: Any, output: str) -> TextureUse | None:
        if shader.GetShaderId() != "UsdUVTexture":
            return None
        asset = self._value(shader, "file", None)[0]
        if asset is None or not asset.path:
            return None
        reader, matrix = self._value(shader, "st", None)[1], np.eye(3)
        if reader and reader.GetShaderId() == "UsdTransform2d":
            matrix = self._matrix(reader)
            reader = self._value(reader, "in", None)[1]
        uv_name = str(self._value(reader, "varname", "st")[0]) if reader else "st"
        u, v = (str(self._value(shader, name, "useMetadata")[0]) for name in ("wrapS", "wrapT"))
        scale, bias = (
            np.array(self._value(shader, name, default)[0], np.float64)
            for name, default in (("scale", (1, 1, 1, 1)), ("bias", (0, 0, 0, 0)))
        )
        wraps = _WRAPS.get(u, "repeat"), _WRAPS.get(v, "repeat")
        baked = str(shader.GetPrim().GetCustomDataByKey(BAKED) or "")
        return TextureUse(self._image(asset), output, uv_name, matrix[:2], wraps, scale, bias, baked)

    def _matrix(self, shader: Any) -> Float64Array:
        """Return the (3, 3) matrix of a UsdTransform2d: scale, then rotation, then translation."""
        angle = np.radians(float(self._value(shader, "rotation", 0.0)[0]))
        scale, move = (np.array(self._value(shader, *each)[0]) for each in (("scale", (1, 1)), ("translation", (0, 0))))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        matrix = np.eye(3)
        matrix[:2, :2], matrix[:2, 2] = turn * scale, move
        return matrix

    def _image(self, asset: Any) -> ImageSource:
        from pxr import Ar

        if not asset.resolvedPath:
            return ImageSource(asset.path, self._path.parent / asset.path)
        if not Ar.IsPackageRelativePath(asset.resolvedPath):
            return ImageSource.of(Path(asset.resolvedPath))
        opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath))
        return ImageSource(asset.resolvedPath, None, bytes(opened.GetBuffer()) if opened else b"")
