"""Read the meshes of a USD stage, at its first frame and in world space, with what their materials do to visibility."""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.formats.base import PartSource, SourceDocument
from aoprecalc.io.formats.builder import MeshPiece, build_scene, cofactors, damaged_file
from aoprecalc.io.formats.polygons import Polygons, lost_faces, polygon_triangles
from aoprecalc.io.formats.usd.materials import UsdMaterial, UsdMaterials
from aoprecalc.progress import Note
from aoprecalc.types import Float64Array, Int64Array, Scene

_MAX_PRIMS, _MAX_MESHES = 1_000_000, 50_000  # nested instances multiply: a few kilobytes may be more than memory
_MAX_TOLD = 5  # warnings of USD that are passed on
_UV_TYPES = ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]")
_PLAIN_UVS = ("st", "st0", "st1", "uv", "UVMap", "map1")  # names of UVs that some programs write as float2[]


@dataclass(frozen=True, eq=False, kw_only=True)
class UsdPart(PartSource):
    """The faces of a Mesh prim that have one material.

    prim       the path of the Mesh
    faces      (p,) the faces of the prim that these polygons are
    corners    (sum of their counts,) the prim's face corner at each polygon corner: turned round where its winding is
    polygons   the polygons, and their triangles, which are those of the part
    uv_names   the primvar of each UV set
    linear     (3, 3) by which column vectors of the prim come into the world
    look       the material; None where it has none
    """

    prim: str
    faces: Int64Array
    corners: Int64Array
    polygons: Polygons
    uv_names: tuple[str, ...]
    linear: Float64Array
    look: UsdMaterial | None


@dataclass(frozen=True, eq=False)
class UsdDocument(SourceDocument):
    """What is kept of a stage.

    files   those that it was composed of, and its textures
    """

    files: tuple[Path, ...] = ()


@contextmanager
def usd_messages(path: Path) -> Iterator[list[str]]:
    """Collect the warnings of USD, which it would print, in a list; raises InputError for its errors."""
    from pxr import Tf, UsdUtils

    told: list[str] = []
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield told
    except (Tf.ErrorException, RuntimeError) as error:
        found = re.findall(r" : '(.*?)'$", str(error), re.MULTILINE | re.DOTALL) or [str(error)]
        raise damaged_file(path, f"cannot be read as USD ({_one_line(found[0])})") from error
    finally:
        warnings = [_one_line(entry.commentary) for entry in delegate.TakeUncoalescedDiagnostics()]
        told += dict.fromkeys(warnings)
        if len(told) > _MAX_TOLD:
            told[_MAX_TOLD:] = [f"USD has {len(told) - _MAX_TOLD} more warnings of this stage"]


def _one_line(text: str) -> str:
    """Return a message of USD without what differs from run to run."""
    text = re.sub(r"\s*\((instantiating|recomposing) stage.*", "", text, flags=re.DOTALL)
    text = re.sub(r",?@anon:0x[0-9a-f]+:[^@]*@", "", text)
    return " ".join(text.split())[:240]


def read_stage(path: Path, files: tuple[Path, ...] = ()) -> Scene:
    """Read every Mesh that is shown as a part, or as one for each of its materials; instances where they are placed.

    files   those of the stage, without itself
    Raises InputError where the stage is damaged or has no such mesh.
    """
    from pxr import Usd, UsdGeom

    with usd_messages(path) as told:
        stage = Usd.Stage.Open(str(path))
        reader = _StageReader(path, stage)
        pieces, up, unit = reader.pieces(), UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)
    messages = [*(f"{path}: {line}" for line in told), *reader.messages()]
    polygons = Polygons.concatenate(
        [Polygons.of_triangles(0), *(part_source(piece.source).polygons for piece in pieces)]
    )
    document = UsdDocument(polygons, reader.materials.sources(), files)
    if not pieces and messages:
        raise InputError(f"{path}: no mesh is shown, a surface was expected; {messages[0]}")
    if unit != 1:
        messages.append(Note(f"its unit is {unit:g} metres; its numbers are kept, and a GLB calls them metres"))
    if up == UsdGeom.Tokens.z:
        messages.append(Note("its axis Z points up; its numbers are kept, and in a GLB Y points up"))
    scene = build_scene(path, path.suffix.lower()[1:], pieces, document, messages)
    return replace(scene, up="z" if up == UsdGeom.Tokens.z else "y", unit=unit if 0 < unit < np.inf else None)


def stage_files(path: Path) -> tuple[Path, ...]:
    """Return the files that a stage is composed of or refers to, without itself, existing or not."""
    from pxr import Ar, UsdUtils

    layers, assets, missing = UsdUtils.ComputeAllDependencies(str(path))
    names = [*(layer.realPath for layer in layers), *map(str, assets), *map(str, missing)]
    plain = (Ar.SplitPackageRelativePathOuter(name)[0] if "[" in name else name for name in names if name)
    files = dict.fromkeys(path.parent / name for name in plain)
    return tuple(file for file in files if file.absolute() != path.absolute())


class _StageReader:
    """Reads the meshes of a stage.

    materials   those that are bound to them
    """

    def __init__(self, path: Path, stage: Any) -> None:
        """Read at the first frame, or the only one."""
        from pxr import Usd, UsdGeom

        self._path, self._stage, self._time = path, stage, Usd.TimeCode.EarliestTime()
        self._transforms = UsdGeom.XformCache(self._time)
        self._counts: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._warnings: list[str] = []
        self.materials = UsdMaterials(path, self._time)

    def messages(self) -> list[str]:
        """Return what the user should know of the stage."""
        count = self._counts
        lines = [*self._warnings, *self.materials.messages()]
        if self._kinds:
            kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(self._kinds.items()))
            advice = "make meshes of shapes, and add lights and cameras to the result"
            lines.append(f"{self._path}: only meshes are read, not {kinds}; {advice}")
        if number := count["hidden"]:
            lines.append(Note(f"{counted(number, 'invisible mesh', 'invisible meshes')} left out"))
        if number := count["purpose"]:
            lines.append(Note(f"{counted(number, 'mesh', 'meshes')} of the purpose guide or proxy left out"))
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
        from pxr import Usd, UsdGeom, UsdLux

        meshes = []
        prims = Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
        walk = iter(prims)
        for number, prim in enumerate(walk):
            if number > _MAX_PRIMS:
                raise InputError(f"{self._path}: more than {_MAX_PRIMS:,} prims; use a smaller scene")
            if prim.IsA(UsdGeom.PointInstancer):
                self._kinds["PointInstancer"] += 1
                walk.PruneChildren()
            elif prim.IsA(UsdGeom.Mesh):
                meshes.append(prim)
            elif prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.Camera) or prim.HasAPI(UsdLux.LightAPI):
                self._kinds[prim.GetTypeName()] += self._shown(prim)
        self._kinds += Counter()  # without those of which none is shown
        if len(meshes) > _MAX_MESHES:
            raise InputError(f"{self._path}: more than {_MAX_MESHES:,} meshes; join them, or use a smaller scene")
        return [piece for prim in meshes for piece in self._mesh(prim)]

    def _shown(self, prim: Any) -> bool:
        from pxr import UsdGeom

        imageable = UsdGeom.Imageable(prim)
        is_mesh = prim.IsA(UsdGeom.Mesh)
        if imageable.ComputeVisibility(self._time) == UsdGeom.Tokens.invisible:
            self._counts["hidden"] += is_mesh
            return False
        if imageable.ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            self._counts["purpose"] += is_mesh
            return False
        return True

    def _mesh(self, prim: Any) -> list[MeshPiece]:
        """Return the faces of a Mesh, by material."""
        from pxr import UsdGeom, UsdShade

        mesh = UsdGeom.Mesh(prim)
        points: Float64Array = self._array(mesh.GetPointsAttr(), np.float64).reshape(-1, 3)
        counts: Int64Array = self._array(mesh.GetFaceVertexCountsAttr(), np.int64)
        indices: Int64Array = self._array(mesh.GetFaceVertexIndicesAttr(), np.int64)
        if not len(counts) or not self._shown(prim):
            return []
        self._check(prim, counts, indices, len(points))
        self._count(prim, mesh)
        matrix = np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64)
        linear: Float64Array = matrix[:3, :3].T
        left = mesh.GetOrientationAttr().Get(self._time) == UsdGeom.Tokens.leftHanded
        turned = left != (np.linalg.det(linear) < 0)
        world: Float64Array = points @ linear.T + matrix[3, :3]
        values = _MeshValues(self, prim, counts, indices, _corner_order(counts, turned), world, linear)

        assigned = np.full(len(counts), -1)
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        for number, subset in enumerate(subsets):
            chosen = self._array(subset.GetIndicesAttr(), np.int64)
            known = chosen[(chosen >= 0) & (chosen < len(counts))]
            if len(known) < len(chosen):
                self.warn(f"{subset.GetPath()} names faces that {prim.GetPath()} has not; they are ignored")
            assigned[known[assigned[known] < 0]] = number
        holes = self._array(mesh.GetHoleIndicesAttr(), np.int64)
        assigned[holes[(holes >= 0) & (holes < len(counts))]] = len(subsets)
        owners = [prim, *(subset.GetPrim() for subset in subsets)]
        self._warnings += (f"{self._path}: {line}" for line in lost_faces(counts))
        groups = ((owner, np.flatnonzero(assigned == number - 1)) for number, owner in enumerate(owners))
        return [values.piece(owner, faces) for owner, faces in groups if len(faces)]

    def _array(self, attribute: Any, kind: type) -> NDArray[Any]:
        """Return the value of an attribute as an array; empty where it has none."""
        value = attribute.Get(self._time)
        return np.array([] if value is None else value, kind)

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


def _corner_order(counts: Int64Array, turned: bool) -> Int64Array:
    """Return the face corner at each polygon corner: the same or, turned, from the first of each face backwards."""
    order = np.arange(counts.sum())
    if not turned:
        return order
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    result: Int64Array = starts + (starts - order) % np.repeat(counts, counts)
    return result


@dataclass(frozen=True, eq=False)
class _MeshValues:
    """A Mesh prim and its values.

    order    (c,) the face corner at each polygon corner
    points   (n, 3) float64 in the world
    """

    reader: _StageReader
    prim: Any
    counts: Int64Array
    indices: Int64Array
    order: Int64Array
    points: Float64Array
    linear: Float64Array

    def piece(self, owner: Any, faces: Int64Array) -> MeshPiece:
        """Return some faces, to which a material is bound at the prim `owner`: the mesh, or a subset of it."""
        from pxr import UsdGeom

        chosen = np.zeros(len(self.counts), bool)
        chosen[faces] = True
        corners = self.order[np.repeat(chosen, self.counts)]
        counts, vertices = self.counts[faces], self.indices[corners]
        polygons = Polygons(counts, *polygon_triangles(counts, vertices, self.points))
        at = _Corners(vertices[polygons.triangles], corners[polygons.triangles], faces[polygons.owners])
        look = self.reader.materials.bound_to(owner)
        uvs = self._uv_sets(at, look)
        source = UsdPart(
            material=None if look is None else look.name,
            prim=str(self.prim.GetPath()),
            faces=faces,
            corners=corners,
            polygons=polygons,
            uv_names=tuple(uvs),
            linear=self.linear,
            look=look,
        )
        both = bool(UsdGeom.Mesh(self.prim).GetDoubleSidedAttr().Get())
        material = self.reader.materials.visibility(look, uvs, len(at.vertices), double_sided=both)
        path = self.prim.GetPath()
        mesh, is_subset = self.prim.GetName(), owner != self.prim
        names = [*str(path).strip("/").split("/"), str(path), source.material, owner.GetName()]
        name = f"{mesh}/{owner.GetName()}" if is_subset else mesh
        normals, uv_sets = self._normals(at), tuple(uvs.values())
        return MeshPiece(name, self.points, at.vertices, normals, uv_sets, source, names, material)

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
        sign = -1 if np.linalg.det(self.linear) < 0 else 1
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


def part_source(source: object) -> UsdPart:
    """Return where a part comes from."""
    assert isinstance(source, UsdPart)  # the reader made it
    return source
