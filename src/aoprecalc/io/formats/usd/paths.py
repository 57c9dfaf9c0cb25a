"""Where the root layer of a stage can change a prim: instances share a prototype, and variants hold other prims.

A prim inside an instance cannot be changed by itself. Where its instances share the texels, all of them inherit from
a class that holds the changes, and still share one prototype; else they are made ordinary prims.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain, count
from typing import Any


class EditPaths:
    """The paths at which prims of a stage are edited.

    released   the number of instances that became ordinary prims
    """

    def __init__(self, stage: Any, shared: Mapping[str, bool]) -> None:
        """Prepare a stage.

        shared   the paths of prims that are to be edited: whether those of all their instances are edited alike
        """
        self._stage = stage
        self._classes: dict[Any, Any] = {}  # path of an instance -> that of the class for what is inside it
        self.released = 0
        self._release([path for path, alike in shared.items() if not alike])
        self._inherit(path for path, alike in shared.items() if alike)

    def _instances_above(self, path: str) -> list[Any]:
        """Return the instances that a prim is inside of, the outermost first."""
        above = (self._stage.GetPrimAtPath(prefix) for prefix in _path(path).GetParentPath().GetPrefixes())
        return [prim for prim in above if prim.IsInstance()]

    def _release(self, paths: Iterable[str]) -> None:
        from pxr import Sdf

        layer, waiting = self._stage.GetRootLayer(), list(paths)
        while waiting := [path for path in waiting if self._instances_above(path)]:
            outermost = dict.fromkeys(self._instances_above(path)[0].GetPath() for path in waiting)
            with Sdf.ChangeBlock():
                for instance in outermost:
                    Sdf.CreatePrimInLayer(layer, instance).instanceable = False
            self.released += len(outermost)

    def _inherit(self, paths: Iterable[str]) -> None:
        from pxr import Usd

        of_prototype: dict[Any, Any] = {}
        for instance in chain.from_iterable(map(self._instances_above, paths)):
            real = instance.GetPrimInPrototype() if instance.IsInstanceProxy() else instance
            prototype = real.GetPrototype().GetPath()
            if prototype not in of_prototype:
                of_prototype[prototype] = self._free_class(instance.GetName(), of_prototype.values())
            self._classes[instance.GetPath()] = of_prototype[prototype]
        for path in of_prototype.values():
            self._stage.CreateClassPrim(path)
        for instance, of_class in self._classes.items():
            inherits = self._stage.OverridePrim(self.target(str(instance))).GetInherits()
            inherits.AddInherit(of_class, Usd.ListPositionFrontOfPrependList)

    def _free_class(self, name: str, taken: Iterable[Any]) -> Any:
        paths = (_path(f"/{free}") for free in _numbered(f"ao_{name}"))
        return next(path for path in paths if path not in taken and not self._stage.GetPrimAtPath(path))

    def target(self, path: str) -> Any:
        """Return the path at which a prim, or one to be made, is edited."""
        original = _path(path)
        above = (prefix for prefix in reversed(original.GetParentPath().GetPrefixes()) if prefix in self._classes)
        instance = next(above, None)
        return original if instance is None else original.ReplacePrefix(instance, self._classes[instance])

    def free(self, parent: Any, name: str) -> Any:
        """Return the path of a prim that is not there yet, below a prim that is given by its path."""
        paths = (parent.AppendChild(free) for free in _numbered(name))
        return next(
            path
            for path in paths
            if not self._stage.GetPrimAtPath(path) and not self._stage.GetPrimAtPath(self.target(str(path)))
        )

    @contextmanager
    def editing(self, path: str, *properties: str) -> Iterator[Any]:
        """Yield a prim of the root layer for changes to one that is there, in the variants that state its properties.

        So other variants, whose faces or materials may be others, do not get them.
        """
        from pxr import Usd

        target, place = self.target(path), _path(path)
        variants = self._variants(path, properties) if target == place else []
        if not variants:
            yield self._stage.OverridePrim(target)
            return
        inside = place.GetPrefixes()[0].GetParentPath()
        for prefix in place.GetPrefixes():
            inside = inside.AppendChild(prefix.name)
            for prim, name, selection in variants:
                if prim == prefix:
                    inside = inside.AppendVariantSelection(name, selection)
                    last = inside
        layer = self._stage.GetRootLayer()
        _create_variant(layer, last)
        with Usd.EditContext(self._stage, Usd.EditTarget.ForLocalDirectVariant(layer, last)):
            yield self._stage.OverridePrim(place)

    def _variants(self, path: str, properties: Iterable[str]) -> list[tuple[Any, str, str]]:
        """Return the variants in which the strongest opinions on properties stand: prim, variant set, variant."""
        prim = self._stage.GetPrimAtPath(path)
        found: dict[tuple[Any, str, str], None] = {}
        for name in properties:
            stack = prim.GetProperty(name).GetPropertyStack() if prim.HasProperty(name) else []
            for node in _nodes_above(prim, stack[0], name) if stack else ():
                place, site = prim.GetPath(), node.path
                while not site.IsAbsoluteRootPath():
                    if site.IsPrimVariantSelectionPath():
                        found[place, *site.GetVariantSelection()] = None
                    else:
                        place = place.GetParentPath()
                    site = site.GetParentPath()
        return list(reversed(found))


def _numbered(name: str) -> Iterator[str]:
    return chain([name], (f"{name}_{number}" for number in count(2)))


def _path(path: Any) -> Any:
    from pxr import Sdf

    return Sdf.Path(path)


def _nodes_above(prim: Any, spec: Any, name: str) -> Iterator[Any]:
    """Yield the node of the composition in which a property has a spec, and those through which it is reached."""
    waiting = [prim.GetPrimIndex().rootNode]
    while waiting:
        node = waiting.pop()
        waiting += node.children
        if node.path.AppendProperty(name) == spec.path and spec.layer in node.layerStack.layers:
            while node:
                yield node
                node = node.parent
            return


def _create_variant(layer: Any, path: Any) -> None:
    """Make the variants of a path in a layer."""
    from pxr import Sdf

    for prefix in path.GetPrefixes():
        if prefix.IsPrimVariantSelectionPath():
            Sdf.CreateVariantInLayer(layer, prefix.GetParentPath(), *prefix.GetVariantSelection())
        else:
            Sdf.CreatePrimInLayer(layer, prefix)
