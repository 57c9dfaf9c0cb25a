"""Write the occlusion into the materials of a USD stage: a texture that a UsdPreviewSurface reads on a primvar."""

from dataclasses import dataclass
from typing import Any

from aoprecalc.io.formats.usd.materials import BAKED, bound_material
from aoprecalc.io.formats.usd.paths import EditPaths

PREVIEW_SURFACE = "UsdPreviewSurface"
_TEXTURE, _READER = "ao_texture", "ao_uvs"  # names of the shaders
_PLAIN, _SCOPE = "plain", "ao_looks"  # of the materials of meshes without one


@dataclass(frozen=True)
class BakedTexture:
    """The texture of a bake.

    path      as the stage states it
    repeats   its UVs leave [0, 1]
    options   those of the bake, as JSON
    """

    path: str
    repeats: bool
    options: str


class OcclusionShading:
    """Authors the shaders of the occlusion, and materials.

    files      the paths of the attributes that state the texture's path
    surfaces   path of a surface that is edited -> the primvar of its occlusion
    """

    def __init__(self, stage: Any, paths: EditPaths, texture: BakedTexture) -> None:
        """Start without shaders."""
        self._stage, self._paths, self._texture = stage, paths, texture
        self._plain: dict[tuple[str, ...], Any] = {}
        self.files: list[Any] = []
        self.surfaces: dict[Any, str] = {}

    def connect(self, surface: Any, name: str, inside: tuple[Any, Any] | None = None) -> None:
        """Connect the occlusion of a surface, given by its path, to the baked texture on the UVs of a primvar.

        inside   where the surface is that of a copy of a material: the paths of the material and of the copy
        """
        from pxr import Sdf, UsdShade

        types, scope = Sdf.ValueTypeNames, surface.GetParentPath()
        names = [self._own(scope.AppendChild(each)) for each in (_TEXTURE, _READER)]
        target, texture_path, reader_path = (self._paths.target(str(each)) for each in (surface, *names))
        if inside is not None:
            target, texture_path, reader_path = (
                each.ReplacePrefix(*inside) for each in (target, texture_path, reader_path)
            )
        if target in self.surfaces:
            return
        self.surfaces[target] = name
        reader = UsdShade.Shader.Define(self._stage, reader_path)
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", types.String).Set(name)
        texture = UsdShade.Shader.Define(self._stage, texture_path)
        texture.CreateIdAttr("UsdUVTexture")
        texture.GetPrim().SetCustomDataByKey(BAKED, self._texture.options)
        file = texture.CreateInput("file", types.Asset)
        file.Set(Sdf.AssetPath(self._texture.path))
        self.files.append(file.GetAttr().GetPath())
        texture.CreateInput("sourceColorSpace", types.Token).Set("raw")
        for wrap in ("wrapS", "wrapT"):
            texture.CreateInput(wrap, types.Token).Set("repeat" if self._texture.repeats else "clamp")
        texture.CreateInput("fallback", types.Float4).Set((1, 1, 1, 1))
        texture.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
        shader = UsdShade.Shader(self._stage.OverridePrim(target))
        shader.CreateInput("occlusion", types.Float).ConnectToSource(texture.CreateOutput("r", types.Float))

    def _own(self, path: Any) -> Any:
        """Return a path for one of our shaders: that of an earlier bake's, or a free one."""
        texture = self._stage.GetPrimAtPath(path.GetParentPath().AppendChild(_TEXTURE))
        ours = texture and texture.GetCustomDataByKey(BAKED) is not None
        return path if ours else self._paths.free(path.GetParentPath(), path.name)

    def copy(self, material: Any) -> Any:
        """Return a copy of a material, given by its path, that differs from it by what is authored on it."""
        from pxr import UsdShade

        free = self._paths.free(material.GetParentPath(), f"{material.name}_ao")
        self._stage.OverridePrim(self._paths.target(str(free.GetParentPath())))  # its type is that of the scope
        made = UsdShade.Material.Define(self._stage, self._paths.target(str(free)))
        made.GetPrim().GetSpecializes().AddSpecialize(self._paths.target(str(material)))
        return made

    def bind(self, owner: str, material: Any) -> None:
        """Bind a material to a Mesh or GeomSubset in the place of that which it has, for the same purpose."""
        from pxr import UsdShade

        _, purpose = bound_material(self._stage.GetPrimAtPath(owner))
        weak = UsdShade.Tokens.fallbackStrength
        with self._paths.editing(owner, f"material:binding:{purpose}".rstrip(":")) as prim:
            UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, weak, purpose)

    def plain_material(self, owner: Any, name: str) -> Any:
        """Return a material of the displayed colour and opacity of a prim without one; `name` is its primvar of UVs.

        It is below the root prim of its owner, so that it is there wherever that is referenced.
        """
        from pxr import Sdf, UsdGeom, UsdShade

        types, root = Sdf.ValueTypeNames, self._paths.target(str(owner.GetPath())).GetPrefixes()[0]
        mesh = owner if owner.IsA(UsdGeom.Gprim) else owner.GetParent()
        key, inputs = [str(root), name], []
        for shown, slot, kind in (("displayColor", "diffuseColor", "float3"), ("displayOpacity", "opacity", "float")):
            primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(shown)
            if primvar and primvar.HasValue() and len(primvar.Get()):
                one = len(primvar.Get()) == 1 and primvar.GetInterpolation() == UsdGeom.Tokens.constant
                inputs.append((shown, slot, kind, primvar.Get()[0] if one else None))
                key.append(str(inputs[-1]))
        if (made := self._plain.get(tuple(key))) is not None:
            return made
        scope = root.AppendChild(_SCOPE)
        UsdGeom.Scope.Define(self._stage, scope)
        path = self._paths.free(scope, _PLAIN)
        material = UsdShade.Material.Define(self._stage, path)
        surface = UsdShade.Shader.Define(self._stage, path.AppendChild("surface"))
        surface.CreateIdAttr(PREVIEW_SURFACE)
        material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
        for shown, slot, kind, value in inputs:
            given = surface.CreateInput(slot, types.Color3f if kind == "float3" else types.Float)
            if value is not None:
                given.Set(value)
                continue
            reader = UsdShade.Shader.Define(self._stage, path.AppendChild(shown))
            reader.CreateIdAttr(f"UsdPrimvarReader_{kind}")
            reader.CreateInput("varname", types.String).Set(shown)
            given.ConnectToSource(reader.CreateOutput("result", types.Float3 if kind == "float3" else types.Float))
        self.connect(surface.GetPath(), name)
        self._plain[tuple(key)] = material
        return material
