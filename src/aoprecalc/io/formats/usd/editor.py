"""Give the meshes of a USD stage their UVs and normals, and their materials the occlusion; the rest stays as it is.

All is authored in the root layer, in the process that has opened the stage for nothing else, and exported from there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import counted, listed, one_or_many
from aoprecalc.io.formats.usd.materials import bound_material
from aoprecalc.io.formats.usd.paths import EditPaths
from aoprecalc.io.formats.usd.shading import PREVIEW_SURFACE, BakedTexture, OcclusionShading
from aoprecalc.io.formats.usd.stage import usd_messages
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.progress import Note
from aoprecalc.types import Float32Array, Int64Array

NEW_UVS = ""  # stands for the name of a new primvar


@dataclass(frozen=True, eq=False)
class MeshEdit:
    """What a Mesh prim gets.

    prim     its path
    shared   its instances share the texels, so that they keep one prototype
    corners  (k,) face corners of the prim; some may be there several times
    uvs      (k, 2) float32 there; None where it keeps its own
    normals  (k, 3) float32 there, in its own space; None where those that it has, or has not, were used
    """

    prim: str
    shared: bool
    corners: Int64Array
    uvs: Float32Array | None
    normals: Float32Array | None


@dataclass(frozen=True)
class MaterialUse:
    """Faces with one material.

    prim, owner   the paths of their Mesh, and of the Mesh or GeomSubset to which the material is bound
    uvs           the primvar of the baked texture, or NEW_UVS; None where they are not baked
    """

    prim: str
    owner: str
    uvs: str | None


@dataclass(frozen=True, eq=False)
class StageEdits:
    """What is to be changed in a stage.

    layer    the file, .usda or .usdc, that the edited layer is exported to, in a folder that the parent removes
    moved    paths of files in the root layer, as they are and as they shall be stated
    """

    meshes: tuple[MeshEdit, ...]
    uses: tuple[MaterialUse, ...]
    texture: BakedTexture
    layer: Path
    moved: dict[str, str]


@dataclass(frozen=True)
class EditedStage:
    """The bytes of an edited root layer, the materials that refer to the texture by primvar, and messages."""

    layer: bytes
    materials: dict[str, int]
    messages: tuple[str, ...]


def edit_stage(path: Path, edits: StageEdits) -> EditedStage:
    """Return the root layer of a stage with edits; raises InputError where it is damaged."""
    from pxr import Sdf, Usd, UsdUtils

    with usd_messages(path):
        stage = Usd.Stage.Open(str(path))
        editor = _StageEditor(stage, edits)
        editor.edit()
        layer = stage.GetRootLayer()
        if edits.moved:  # last, as what refers to other files is not there any more then
            UsdUtils.ModifyAssetPaths(layer, lambda name: edits.moved.get(name, name))
            for file in editor.shading.files:
                layer.GetAttributeAtPath(file).default = Sdf.AssetPath(edits.texture.path)
        layer.Export(str(edits.layer))
        return EditedStage(edits.layer.read_bytes(), editor.materials(), tuple(editor.messages(path)))


class _StageEditor:
    """Edits the root layer of a stage.

    shading   the shaders that it authors
    """

    def __init__(self, stage: Any, edits: StageEdits) -> None:
        """Prepare the stage, so that all that is to be edited can be."""
        self._stage, self._edits = stage, edits
        self._uses = [(use, bound_material(stage.GetPrimAtPath(use.owner))[0]) for use in edits.uses]
        self._paths = EditPaths(stage, dict(self._edited()))
        self._new_name = self._free_name()
        self._without: dict[str, None] = {}  # names of materials without a UsdPreviewSurface
        self._other_renderers: dict[str, None] = {}  # names of those with surfaces beside it
        self._warnings: list[str] = []
        self.shading = OcclusionShading(stage, self._paths, edits.texture)

    def _edited(self) -> Iterator[tuple[str, bool]]:
        """Yield the paths of prims that are edited, and whether their instances are edited alike."""
        shared = {mesh.prim for mesh in self._edits.meshes if mesh.shared}
        for use, material in self._uses:
            if use.uvs is not None:
                yield use.prim, use.prim in shared
                yield use.owner, use.prim in shared
                if material and (surface := _surface_of(material)):
                    yield str(surface.GetPath()), use.prim in shared

    def _free_name(self) -> str:
        """Return st1, or the first of its kind that no mesh with new UVs has."""
        prims = [self._stage.GetPrimAtPath(mesh.prim) for mesh in self._edits.meshes if mesh.uvs is not None]
        names = (f"st{number}" for number in count(1))
        return next(name for name in names if not any(prim.HasAttribute(f"primvars:{name}") for prim in prims))

    def _name(self, use: MaterialUse) -> str:
        return use.uvs or self._new_name

    def edit(self) -> None:
        """Make all edits."""
        for mesh in self._edits.meshes:
            self._edit_mesh(mesh)
        by_material: dict[Any, list[tuple[MaterialUse, Any]]] = {}
        for use, material in self._uses:
            if material:
                by_material.setdefault(self._paths.target(str(material.GetPath())), []).append((use, material))
            elif use.uvs is not None:
                owner = self._stage.GetPrimAtPath(use.owner)
                self.shading.bind(use.owner, self.shading.plain_material(owner, self._name(use)))
        elsewhere = self._used_elsewhere()
        for target, uses in by_material.items():
            baked = [use for use, _ in uses if use.uvs is not None]
            if baked:
                self._edit_material(uses[0][1].GetPath(), baked, len(baked) < len(uses) or target in elsewhere)
        for use in self._edits.uses:
            if use.uvs is not None:
                self._check(use)

    def materials(self) -> dict[str, int]:
        """Return how many materials refer to the texture, by primvar."""
        names = list(self.shading.surfaces.values())
        return {name: names.count(name) for name in dict.fromkeys(names)}

    def messages(self, path: Path) -> Iterator[str]:
        """Yield warnings and notes about the result, the stage at `path`."""
        yield from (f"{path}: {line}" for line in self._warnings)
        if names := list(self._without):
            have = one_or_many(len(names), "has", "have")
            found = f"{listed(names)} {have} no UsdPreviewSurface, so that no renderer shows the texture there"
            yield f"{path}: {found}, though the meshes have its UVs; export the materials with one"
        if names := list(self._other_renderers):
            found = "the occlusion is in the UsdPreviewSurface of materials, not in their surfaces for other renderers"
            yield Note(f"{found}: {listed(names)}")
        if number := self._paths.released:
            became = one_or_many(number, "became a prim of its own", "became separate prims")
            yield Note(f"{counted(number, 'instance')} {became} (--instances share keeps them together)")

    def _edit_mesh(self, edit: MeshEdit) -> None:
        from pxr import Sdf, Usd, UsdGeom, Vt

        mesh = UsdGeom.Mesh(self._stage.GetPrimAtPath(edit.prim))
        faces = mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()
        total = len(faces[1].Get(Usd.TimeCode.EarliestTime()))
        if any(attribute.GetNumTimeSamples() > 1 for attribute in faces):
            self._warnings.append(f"the faces of {edit.prim} change with time; its occlusion fits the first frame only")
        face_varying, normals = UsdGeom.Tokens.faceVarying, self._normals(mesh, edit, total)
        with self._paths.editing(edit.prim, *(attribute.GetName() for attribute in faces)) as prim:
            if edit.uvs is not None:
                values: Float32Array = np.zeros((total, 2), np.float32)
                values[edit.corners] = edit.uvs
                kind = Sdf.ValueTypeNames.TexCoord2fArray
                uvs = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(self._new_name, kind, face_varying)
                first, which = unique_rows(values)
                uvs.Set(Vt.Vec2fArray.FromNumpy(values[first]))
                uvs.SetIndices(Vt.IntArray.FromNumpy(which.astype(np.int32)))
            if normals is None:
                return
            if mesh.GetPrim().HasAttribute("primvars:normals"):
                kind = Sdf.ValueTypeNames.Normal3fArray
                primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("normals", kind, face_varying)
                primvar.GetAttr().Clear()  # samples in the same layer, which are stronger
                primvar.Set(normals)
                primvar.BlockIndices()
            else:
                attribute = UsdGeom.Mesh(prim).CreateNormalsAttr()
                attribute.Clear()  # as above
                attribute.Set(normals)
                attribute.SetMetadata("interpolation", face_varying)

    def _normals(self, mesh: Any, edit: MeshEdit, total: int) -> Any:
        """Return the normals to author; None for none, as on subdivision surfaces, which have those of their limit."""
        from pxr import UsdGeom, Vt

        if edit.normals is None or mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            return None
        if mesh.GetPointsAttr().GetNumTimeSamples() > 1:
            self._warnings.append(f"the points of {edit.prim} move, so that it keeps its normals instead of those used")
            return None
        normals: Float32Array = np.zeros((total, 3), np.float32)
        normals[edit.corners] = edit.normals
        return Vt.Vec3fArray.FromNumpy(normals)

    def _used_elsewhere(self) -> set[Any]:
        """Return the materials of what is not read, such as meshes that are hidden, by the paths of their edits."""
        from pxr import Usd, UsdGeom

        known = {path for use in self._edits.uses for path in (use.prim, use.owner)}
        found = set()
        for prim in Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
            shows = prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.Subset)
            if shows and str(prim.GetPath()) not in known and (material := bound_material(prim)[0]):
                found.add(self._paths.target(str(material.GetPath())))
        return found

    def _edit_material(self, path: Any, uses: list[MaterialUse], kept: bool) -> None:
        """Give a material the occlusion.

        path   of it in the stage
        uses   those with occlusion
        kept   others use it without, so that it stays, and a copy gets the occlusion
        Each further primvar needs a copy, too.
        """
        from pxr import UsdShade

        material = UsdShade.Material(self._stage.GetPrimAtPath(path))
        surface = _surface_of(material)
        if not surface:
            self._without[path.name] = None
            return
        if any(output.HasConnectedSource() for output in material.GetSurfaceOutputs()[1:]):
            self._other_renderers[path.name] = None
        inside = surface.GetPath().HasPrefix(path)
        for number, name in enumerate(dict.fromkeys(map(self._name, uses))):
            if number == 0 and not kept:
                self.shading.connect(surface.GetPath(), name)
                continue
            if not inside:
                self._warnings.append(f"{surface.GetPath()} is no part of {path} and has other uses: it stays as it is")
                continue
            copy = self.shading.copy(path)
            self.shading.connect(surface.GetPath(), name, (self._paths.target(str(path)), copy.GetPath()))
            for use in uses:
                if self._name(use) == name:
                    self.shading.bind(use.owner, copy)

    def _check(self, use: MaterialUse) -> None:
        """Warn where the stage does not show what was authored, as stronger opinions on a prim may prevent it."""
        from pxr import UsdGeom

        owner, mesh = self._stage.GetPrimAtPath(use.owner), self._stage.GetPrimAtPath(use.prim)
        material, _ = bound_material(owner)
        if not UsdGeom.PrimvarsAPI(mesh).GetPrimvar(self._name(use)).HasValue():
            self._warnings.append(f"{use.prim} did not take the UVs of the texture; flatten the stage")
        elif not material or not (surface := _surface_of(material)):
            if not material or material.GetPrim().GetName() not in self._without:
                self._warnings.append(f"{use.owner} did not take a material with the texture; flatten the stage")
        elif self.shading.surfaces.get(self._paths.target(str(surface.GetPath()))) != self._name(use):
            self._warnings.append(f"{use.owner} shows another material than that with the texture; bind it there")


def _surface_of(material: Any) -> Any:
    """Return the UsdPreviewSurface of a material; None for none."""
    surface = material.ComputeSurfaceSource()[0]
    return surface if surface and surface.GetShaderId() == PREVIEW_SURFACE else None
