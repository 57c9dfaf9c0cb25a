"""The packages that decode; they are extras, and loaded when a file needs them."""

from collections.abc import Collection
from copy import deepcopy
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from aoprecalc.errors import InputError
from aoprecalc.io.formats.gltf.accessors import bounds, numbers
from aoprecalc.io.formats.gltf.document import GltfDocument, Json


def is_installed(package: str) -> bool:
    """Tell whether a package is there."""
    return find_spec(package) is not None


def load_library(path: Path, extension: str, package: str) -> ModuleType:
    """Return the package that decodes an extension; raises InputError, which names the file at `path`, without it."""
    needs = f"{path}: its meshes are compressed by {extension}, which needs the package {package}"
    if not is_installed(package):
        raise InputError(f"{needs}; `pip install 'aoprecalc[compressed]'`")
    try:
        return import_module(package)
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{needs}, but that cannot be loaded ({reason}); install it again") from error


# The copy of a glTF document in which plain data take the place of compressed ones.


class PlainCopy:
    """A copy to be changed, and the bytes of one more buffer, until it is finished.

    source   the document as it is in the file, from which compressed data are read
    json     the copy of its JSON
    """

    def __init__(self, source: GltfDocument) -> None:
        """Start with a copy of everything and no bytes."""
        self.source = source
        self.json: Json = deepcopy(source.json)
        self._bytes = bytearray()
        self._views: set[int] = set()
        self._accessors: set[int] = set()

    def prefers_plain(self, extension: str, package: str) -> bool:
        """Tell whether plain data, where there are any, are to be used rather than what an extension compresses."""
        return extension not in self.source.json.get("extensionsRequired", []) or not is_installed(package)

    def fill_view(self, index: int | None, data: bytes, **members: int) -> int:
        """Let a buffer view, or a new one if None, stand for decoded bytes; return its number.

        The bytes begin at a multiple of 4. Members of the view that are not named stay.
        """
        views = self.json["bufferViews"]
        if index is None:
            index = len(views)
            views.append({})
        self._bytes += bytes(-len(self._bytes) % 4)
        place = {"buffer": len(self.source.buffers), "byteOffset": len(self._bytes), "byteLength": len(data)}
        views[index].update(place | members)
        self._bytes += data
        self._views.add(index)
        return index

    def fill_accessor(self, index: int | None, entry: Json) -> int:
        """Put an accessor in the place of another, or at the end if that is None or was filled; return its number."""
        accessors = self.json.setdefault("accessors", [])
        if index is None or index in self._accessors:
            index = len(accessors)
            accessors.append(entry)
        else:
            accessors[index] = entry
        self._accessors.add(index)
        return index

    def finished(self, without: Collection[str]) -> GltfDocument:
        """Return the copy as a document that does not list some extensions; the copy is not to be used after that."""
        for key in ("extensionsUsed", "extensionsRequired"):
            names = [name for name in self.json.pop(key, []) if name not in without]
            if names:  # the schema has no empty lists
                self.json[key] = names
        buffers = self.source.buffers
        if self._views:
            self.json["buffers"].append({"byteLength": len(self._bytes)})
            buffers += (bytes(self._bytes),)
        document = replace(self.source, json=self.json, buffers=buffers)
        for index, accessor in enumerate(self.json.get("accessors", [])):
            if accessor.get("bufferView") in self._views:
                accessor.update(_bounds(document, index, accessor))
        return document


def pop_extension(entry: Json, name: str) -> Any:
    """Take an extension away from an entry of a document; return its value, or None where it has none."""
    value = entry.get("extensions", {}).pop(name, None)
    if value is not None and not entry["extensions"]:
        del entry["extensions"]
    return value


def has_bytes(document: GltfDocument, view: Json) -> bool:
    """Tell whether the bytes of a view are there; the stand-in for a compressed buffer has none."""
    document.entry("buffers", view["buffer"])
    start: int = view.get("byteOffset", 0)
    length: int = view["byteLength"]
    return min(start, length) >= 0 and start + length <= len(document.buffers[view["buffer"]])


def _bounds(document: GltfDocument, index: int, accessor: Json) -> Json:
    """Return what `min` and `max` of an accessor, if it has them, are after coding, which may lose bits."""
    stated = {"min", "max"} & accessor.keys()
    if not stated or accessor["type"].startswith("MAT"):
        return {}
    found = bounds(numbers(document, index))
    return {key: found[key] for key in stated & found.keys()}
