"""Read the meshes of a USD stage, at its first frame and in world space, with what their materials do to visibility."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.formats.builder import MeshPiece, build_scene, cofactors, damaged_file
from aoprecalc.io.formats.polygons import Polygons, corner_order, lost_faces, polygon_triangles
from aoprecalc.io.formats.usd.materials import UsdMaterial, UsdMaterials
from aoprecalc.io.formats.usd.stage import UsdDocument, UsdPart, part_source, usd_messages
from aoprecalc.io.formats.usd.walk import PlacedMesh, StageWalk, array_of
from aoprecalc.progress import Note
from aoprecalc.types import REVERSED_WINDING, Float64Array, Int64Array, Part, Scene

_UV_TYPES = ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]")
_PLAIN_UVS = ("st", "st0", "st1", "uv", "UVMap", "map1")  # names of UVs that some programs write as float2[]


def read_stage(path: Path, files: tuple[Path, ...] = ()) -> Scene:
    """Read every Mesh that is shown as a part, or as one for each of its materials; instances where they are placed.

    files   those of the stage, without itself
    Raises InputError where the stage is damaged or has no such mesh.
    """
    from pxr import Usd, UsdGeom, UsdUtils

    names: dict[str, None] = {}
    with usd_messages(path) as told:
        stage = Usd.Stage.Open(str(path))
        reader = _StageReader(path, stage)
        pieces, up, unit = reader.pieces(), UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)
        UsdUtils.ModifyAssetPaths(stage.GetRootLayer(), lambda name: names.setdefault(name) or name)
    messages = [*(f"{path}: {line}" for line in told), *reader.messages()]
    polygons = Polygons.concatenate(
        [Polygons.of_triangles(0), *(part_source(piece.source).polygons for piece in pieces)]
    )
    z_up, frame = up == UsdGeom.Tokens.z, list[Note]()
    if unit != 1:
        frame.append(Note(f"its unit is {unit:g} metres; its numbers are kept, and a GLB calls them metres"))
    if z_up:
        frame.append(Note("its axis Z points up; its numbers are kept, and in a GLB Y points up"))
    document = UsdDocument(polygons, reader.materials.sources(), files, tuple(names), frame=tuple(frame))
    if not pieces and messages:
        raise InputError(f"{path}: no mesh is shown, a surface was expected; {messages[0]}")
    scene = build_scene(path, path.suffix.lower()[1:], pieces, document, messages)
    return replace(
        scene,
        parts=_instances(scene.parts),
        polygons=polygons.owners.astype(np.int32),
        up="z" if z_up else "y",
        unit=unit if 0 < unit < np.inf else None,
    )


def _instances(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """Set instance_of and duplicate_of: the first part of the same prototype, and of the same prim."""
    first: dict[tuple[str, ...], int] = {}
    result = []
    for index, part in enumerate(parts):
        source = part_source(part.source)
        subset = source.owner.removeprefix(source.prim)
        anywhere = first.setdefault((source.original, subset), index)
        same_prim = first.setdefault((source.prim, source.owner), index)
        earlier = [None if other == index else other for other in (anywhere, same_prim)]
        result.append(replace(part, instance_of=earlier[0], duplicate_of=earlier[1]))
    return tuple(result)


class _StageReader:
    """Reads the meshes of a stage.

    materials   those that are bound to them
    """

    def __init__(self, path: Path, stage: Any) -> None:
        """Read at the first frame, or the only one."""
        from pxr import Usd

        self._path, self._time = path, Usd.TimeCode.EarliestTime()
        self._walk = StageWalk(path, stage, self._time)
        self._counts: Counter[str] = Counter()
        self._warnings: list[str] = []
        self.materials = UsdMaterials(path, self._time)

    def messages(self) -> list[str]:
        """Return what the user should know of the stage."""
        count = self._counts
        lines = [*self._warnings, *self.materials.messages(), *self._walk.messages()]
        if number := count["subdivided"]:
            are = one_or_many(number, "subdivision surface is", "subdivision surfaces are")
            lines.append(Note(f"{number} {are} read as the control cage"))
        if number := count["skinned"]:
            are = one_or_many(number, "skinned mesh is", "skinned meshes are")
            lines.append(Note(f"{number} {are} read in the bind pose"))
        if number := count["animated"]:
            lines.append(Note(f"{counted(number, 'animated mesh', 'animated meshes')} read at the first frame"))
        return lines

    def pieces(self) -> list[MeshPiece]:
        """Return the faces of all meshes that are shown."""
        meshes = list(self._walk.meshes())
        return [piece for placed in meshes for piece in self._mesh(placed)]

    def _mesh(self, placed: PlacedMesh) -> list[MeshPiece]:
        """Return the faces of a Mesh, by material."""
        from pxr import UsdGeom, UsdShade

        prim = placed.prim
        mesh = UsdGeom.Mesh(prim)
        points: Float64Array = array_of(mesh.GetPointsAttr(), self._time, np.float64).reshape(-1, 3)
        counts: Int64Array = array_of(mesh.GetFaceVertexCountsAttr(), self._time, np.int64)
        indices: Int64Array = array_of(mesh.GetFaceVertexIndicesAttr(), self._time, np.int64)
        if not len(counts):
            return []
        self._check(prim, counts, indices, len(points))
        self._count(prim, mesh)
        left = mesh.GetOrientationAttr().Get(self._time) == UsdGeom.Tokens.leftHanded
        values = _MeshValues(self, placed, counts, indices, points, bool(left))

        assigned = np.full(len(counts), -1)
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        for number, subset in enumerate(subsets):
            chosen = array_of(subset.GetIndicesAttr(), self._time, np.int64)
            known = chosen[(chosen >= 0) & (chosen < len(counts))]
            if len(known) < len(chosen):
                self.warn(f"{subset.GetPath()} names faces that {prim.GetPath()} has not; they are ignored")
            assigned[known[assigned[known] < 0]] = number
        holes = array_of(mesh.GetHoleIndicesAttr(), self._time, np.int64)
        assigned[holes[(holes >= 0) & (holes < len(counts))]] = len(subsets)
        owners = [prim, *(subset.GetPrim() for subset in subsets)]
        self._warnings += (f"{self._path}: {line}" for line in lost_faces(counts))
        groups = ((owner, np.flatnonzero(assigned == number - 1)) for number, owner in enumerate(owners))
        return [values.piece(owner, faces) for owner, faces in groups if len(faces)]

    def warn(self, line: str) -> None:
        """Add a warning about the stage, once."""
        if (warning := f"{self._path}: {line}") not in self._warnings:
            self._warnings.append(warning)

    def _check(self, prim: Any, counts: Int64Array, indices: Int64Array, points: int) -> None:
        """Raise InputError unless the faces of a mesh have the corners that they say, at points that are there."""
        where = prim.GetPath()
        if counts.min() < 0 or counts.sum() != len(indices):
            found = f"{where} has {len(indices)} face vertex indices, {counts.sum()} were expected by its counts"
            raise damaged_file(self._path, found)
        wrong = indices[(indices < 0) | (indices >= points)]
        if len(wrong):
            raise damaged_file(self._path, f"{where}: a face refers to point {wrong[0]}, but there are {points}")

    def _count(self, prim: Any, mesh: Any) -> None:
        from pxr import UsdGeom

        self._counts["subdivided"] += mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none
        self._counts["skinned"] += prim.HasAttribute("primvars:skel:jointIndices")
        moves = mesh.GetPointsAttr().GetNumTimeSamples() > 1 or mesh.TransformMightBeTimeVarying()
        self._counts["animated"] += moves


@dataclass(frozen=True, eq=False)
class _MeshValues:
    """A Mesh prim and its values.

    local   (n, 3) float64 points in its own space
    left    its orientation is left-handed
    """

    reader: _StageReader
    placed: PlacedMesh
    counts: Int64Array
    indices: Int64Array
    local: Float64Array
    left: bool

    @property
    def prim(self) -> Any:
        """The Mesh prim."""
        return self.placed.prim

    @cached_property
    def linear(self) -> Float64Array:
        """(3, 3) by which column vectors come into the world."""
        return self.placed.matrix[:3, :3].T

    @cached_property
    def points(self) -> Float64Array:
        """(n, 3) float64 in the world; one array for all pieces."""
        return self.local @ self.placed.matrix[:3, :3] + self.placed.matrix[3, :3]

    @property
    def mirrored(self) -> bool:
        """Whether the way into the world is a reflection."""
        return bool(np.linalg.det(self.linear) < 0)

    def _polygons(self, faces: Int64Array) -> tuple[Polygons, Int64Array]:
        """Return the polygons of some faces, counter-clockwise in the world, and the face corner at each of theirs.

        They are cut in the prim's own space, so that the triangles of all its instances are the same ones.
        """
        chosen = np.zeros(len(self.counts), bool)
        chosen[faces] = True
        corners, counts = np.flatnonzero(np.repeat(chosen, self.counts)), self.counts[faces]
        order = corner_order(counts, self.left)
        triangles, owners = polygon_triangles(counts, self.indices[corners[order]], self.local)
        if self.mirrored:
            back = corner_order(counts, True)
            triangles, order = back[triangles][:, REVERSED_WINDING], order[back]
        return Polygons(counts, triangles, owners), corners[order]

    def piece(self, owner: Any, faces: Int64Array) -> MeshPiece:
        """Return some faces, to which a material is bound at the prim `owner`: the mesh, or a subset of it."""
        from pxr import UsdGeom

        polygons, corners = self._polygons(faces)
        vertices = self.indices[corners]
        at = _Corners(vertices[polygons.triangles], corners[polygons.triangles], faces[polygons.owners])
        path, look = self.prim.GetPath(), self.reader.materials.bound_to(owner)
        uvs, normals = self._uv_sets(at, look), self._normals(at)
        source = UsdPart(
            material=None if look is None else look.name,
            prim=str(path),
            owner=str(owner.GetPath()),
            original=str(self.prim.GetPrimInPrototype().GetPath() if self.prim.IsInstanceProxy() else path),
            faces=faces,
            corners=corners,
            polygons=polygons,
            normals=normals is not None,
            uv_names=tuple(uvs),
            linear=self.linear,
            look=look,
        )
        both = bool(UsdGeom.Mesh(self.prim).GetDoubleSidedAttr().Get())
        material = self.reader.materials.visibility(look, uvs, len(at.vertices), double_sided=both)
        material = replace(material, double_sided=both)
        mesh, is_subset = self.prim.GetName(), owner != self.prim
        names = [*str(path).strip("/").split("/"), str(path), source.material, owner.GetName()]
        names += [word for name in self.placed.instancers for word in (name, *name.strip("/").split("/"))]
        name = f"{mesh}/{owner.GetName()}" if is_subset else mesh
        return MeshPiece(name, self.points, at.vertices, normals, tuple(uvs.values()), source, names, material)

    def _normals(self, at: "_Corners") -> NDArray[Any] | None:
        from pxr import UsdGeom

        primvar = UsdGeom.PrimvarsAPI(self.prim).GetPrimvar("normals")
        mesh = UsdGeom.Mesh(self.prim)
        if primvar and primvar.HasValue():
            values, interpolation = primvar.ComputeFlattened(self.reader._time), primvar.GetInterpolation()
        else:
            values, interpolation = mesh.GetNormalsAttr().Get(self.reader._time), mesh.GetNormalsInterpolation()
        normals = self._at_corners("normals", values, interpolation, at, 3)
        if normals is None:
            return None
        sign = -1 if self.mirrored else 1
        return np.asarray(normals @ cofactors(self.linear).T * sign)

    def _uv_sets(self, at: "_Corners", look: UsdMaterial | None) -> dict[str, Float64Array]:
        """Return the UVs at the corners by primvar: those of the material's textures first, then `st`."""
        from pxr import UsdGeom

        found: dict[str, Float64Array] = {}
        for primvar in UsdGeom.PrimvarsAPI(self.prim).GetPrimvarsWithValues():
            kind, name = str(primvar.GetTypeName()), str(primvar.GetPrimvarName())
            if kind in _UV_TYPES or (kind in ("float2[]", "double2[]") and name in _PLAIN_UVS):
                values = primvar.ComputeFlattened(self.reader._time)
                uvs = self._at_corners(name, values, primvar.GetInterpolation(), at, 2)
                if uvs is not None:
                    found[name] = uvs
        first = [*(() if look is None else look.uv_names), "st"]
        return {name: found[name] for name in dict.fromkeys([*first, *found]) if name in found}

    def _at_corners(self, name: str, values: Any, interpolation: str, at: "_Corners", size: int) -> Float64Array | None:
        """Return values at the corners of triangles, (t, 3, size); None, and a warning, where they do not fit."""
        if values is None or not len(values):
            return None
        array = np.array(values, np.float64).reshape(-1, size)
        index, expected = {
            "faceVarying": (at.corners, len(self.indices)),
            "uniform": (np.repeat(at.faces[:, None], 3, axis=1), len(self.counts)),
            "constant": (np.zeros_like(at.vertices), 1),
        }.get(interpolation, (at.vertices, len(self.points)))
        if len(array) < expected:
            found = f"the {name} of {self.prim.GetPath()} are {len(array)}, {expected} were expected"
            self.reader.warn(f"{found} ({interpolation}); they are left out")
            return None
        return np.asarray(array[index])


@dataclass(frozen=True)
class _Corners:
    """What the corners of t triangles are: (t, 3) points and face corners, and (t,) the face of each triangle."""

    vertices: Int64Array
    corners: Int64Array
    faces: Int64Array
