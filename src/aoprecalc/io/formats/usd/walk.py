"""Walk over the meshes of a USD stage that are shown: prims, instances of prims, point instances."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.progress import Note
from aoprecalc.types import Float64Array

_MAX_PRIMS, _MAX_MESHES = 1_000_000, 50_000  # nested instances multiply: a few kilobytes may be more than memory


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """A Mesh, or a PointInstancer, where it is shown.

    matrix      (4, 4) float64 by which row vectors come into the world
    prototype   the root of the prototype of a point instancer that it belongs to; None for none
    instancers  the names of those around it
    """

    prim: Any
    matrix: Float64Array
    prototype: Any = None
    instancers: tuple[str, ...] = ()


class StageWalk:
    """Finds what is shown at a time, and counts what is not."""

    def __init__(self, path: Path, stage: Any, time: Any) -> None:
        """Start at no prim."""
        from pxr import UsdGeom

        self._path, self._stage, self._time = path, stage, time
        self._transforms = UsdGeom.XformCache(time)
        self._prims = self._meshes = 0
        self._counts: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()

    def messages(self) -> Iterator[str]:
        """Yield what the user should know of what is left out, and of point instances."""
        if kinds := ", ".join(f"{number} {kind}" for kind, number in sorted(self._kinds.items()) if number):
            advice = "make meshes of shapes, and add lights and cameras to the result"
            yield f"{self._path}: only meshes are read, not {kinds}; {advice}"
        if number := self._counts["hidden"]:
            yield Note(f"{counted(number, 'invisible mesh', 'invisible meshes')} left out")
        if number := self._counts["purpose"]:
            yield Note(f"{counted(number, 'mesh', 'meshes')} of the purpose guide or proxy left out")
        if number := self._counts["point instance"]:
            shares = one_or_many(number, "shares", "share")
            found = f"{counted(number, 'point instance')} {shares} the texels of their prototypes"
            yield Note(f"{found}, which hold the mean of their values")

    def meshes(self) -> Iterator[PlacedMesh]:
        """Yield all meshes that are shown and have faces."""
        from pxr import Usd

        yield from self._placed(Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))

    def _placed(self, prims: Any, around: PlacedMesh | None = None) -> Iterator[PlacedMesh]:
        """Yield the meshes of some prims, those in `around`, the instance of a prototype, placed by its matrix."""
        from pxr import UsdGeom, UsdLux

        prototype, instancers = (None, ()) if around is None else (around.prototype, around.instancers)
        walk = iter(prims)
        for prim in walk:
            self._prims += 1
            if self._prims > _MAX_PRIMS:
                raise InputError(f"{self._path}: more than {_MAX_PRIMS:,} prims; use a smaller scene")
            if prim.IsA(UsdGeom.PointInstancer):
                walk.PruneChildren()
                yield from self._point_instances(PlacedMesh(prim, self._to_world(prim, around), prototype, instancers))
            elif prim.IsA(UsdGeom.Mesh):
                if not prim.GetAttribute("faceVertexCounts").HasValue() or not self._shown(prim, prototype):
                    continue
                self._meshes += 1
                if self._meshes > _MAX_MESHES:
                    found = f"more than {_MAX_MESHES:,} meshes; join them, or use a smaller scene"
                    raise InputError(f"{self._path}: {found}")
                yield PlacedMesh(prim, self._to_world(prim, around), prototype, instancers)
            elif prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.Camera) or prim.HasAPI(UsdLux.LightAPI):
                self._kinds[prim.GetTypeName()] += self._shown(prim, prototype)

    def _to_world(self, prim: Any, around: PlacedMesh | None) -> Float64Array:
        if around is None:
            return np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64)
        inside, _ = self._transforms.ComputeRelativeTransform(prim, around.prototype)
        return np.array(inside, np.float64) @ around.matrix

    def _point_instances(self, placed: PlacedMesh) -> Iterator[PlacedMesh]:
        """Yield the meshes of a PointInstancer that is shown, at its instances."""
        from pxr import Usd, UsdGeom

        name, instancer = str(placed.prim.GetPath()), UsdGeom.PointInstancer(placed.prim)
        if not self._shown(placed.prim, placed.prototype):
            return
        if name in placed.instancers:
            raise damaged_file(self._path, f"{name} is a prototype of itself")
        roots = [self._stage.GetPrimAtPath(target) for target in instancer.GetPrototypesRel().GetForwardedTargets()]
        indices = array_of(instancer.GetProtoIndicesAttr(), self._time, np.int64)
        include, every = UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        matrices = instancer.ComputeInstanceTransformsAtTime(self._time, self._time, include, every)
        wrong = [index for index in indices.tolist() if not (0 <= index < len(roots) and roots[index])]
        if wrong or len(matrices) != len(indices):
            missing = f"prototype {wrong[0]}" if wrong else f"some of {len(indices)} positions"
            raise damaged_file(self._path, f"{name}: {missing} cannot be found")
        mask = instancer.ComputeMaskAtTime(self._time) or [True] * len(indices)
        shown = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract)
        for index, matrix, is_shown in zip(indices.tolist(), matrices, mask, strict=True):
            if is_shown:
                self._counts["point instance"] += 1
                world = np.array(matrix, np.float64) @ placed.matrix
                around = PlacedMesh(placed.prim, world, roots[index], (*placed.instancers, name))
                yield from self._placed(Usd.PrimRange(roots[index], shown), around)

    def _shown(self, prim: Any, prototype: Any = None) -> bool:
        """Tell whether a prim is shown; prims above the prototype that it belongs to do not count."""
        from pxr import UsdGeom

        imageable = UsdGeom.Imageable(prim)
        is_mesh = prim.IsA(UsdGeom.Mesh)
        if prototype is None:
            hidden = imageable.ComputeVisibility(self._time) == UsdGeom.Tokens.invisible
        else:
            above = takewhile(lambda each: each != prototype.GetParent(), _and_above(prim))
            hidden = any(
                UsdGeom.Imageable(each).GetVisibilityAttr().Get(self._time) == UsdGeom.Tokens.invisible
                for each in above
                if each.IsA(UsdGeom.Imageable)
            )
        if hidden:
            self._counts["hidden"] += is_mesh
            return False
        if imageable.ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            self._counts["purpose"] += is_mesh
            return False
        return True


def array_of(attribute: Any, time: Any, kind: type) -> NDArray[Any]:
    """Return the value of an attribute as an array; empty where it has none."""
    value = attribute.Get(time)
    return np.array([] if value is None else value, kind)


def _and_above(prim: Any) -> Iterator[Any]:
    while prim:
        yield prim
        prim = prim.GetParent()
