"""The binary data of a glTF document, and its entries: add and remove textures, images, samplers and buffer views.

New buffers: the one that a writer fills, and the one that holds decompressed data. All references stay valid: a removed
entry becomes None, so that no other index changes. New entries reuse such slots first; `compact` finally renumbers what
is left.
"""

import re
from collections.abc import Collection, Iterable, Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.baked_options import EXTRAS
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.document import (
    COMPONENTS,
    WIDTHS,
    GltfDocument,
    Json,
    bounds,
    element_size,
    raw_values,
)

ARRAY, ELEMENT_ARRAY = 34962, 34963
FLOAT, USHORT, UINT = 5126, 5123, 5125

_PLACED = ("bufferView", "byteOffset", "sparse", "min", "max")  # what an accessor says of its data, not of their type

_TABLES = {"EXT_structural_metadata", "EXT_feature_metadata"}


class GltfBuffer:
    """The buffer of a document that is written, with its `bufferViews` and `accessors`.

    free_accessors, free_views   indices of entries without references, to be reused first
    """

    def __init__(self, document: Json, free_accessors: tuple[int, ...] = (), free_views: tuple[int, ...] = ()) -> None:
        """Start with no bytes."""
        # Tables of EXT_structural_metadata may hold 64-bit numbers.
        self._alignment = 8 if _TABLES & set(document.get("extensionsUsed", [])) else 4
        self._document = document
        self._bytes = bytearray()
        self._free = {"accessors": list(free_accessors), "bufferViews": list(free_views)}

    @property
    def data(self) -> bytes:
        """All bytes so far."""
        return bytes(self._bytes)

    def append(self, data: bytes | bytearray) -> int:
        """Append bytes at a multiple of 4, or of 8 where extensions need that; return their offset."""
        self._bytes += bytes(-len(self._bytes) % self._alignment)
        start = len(self._bytes)
        self._bytes += data
        return start

    def free_views(self, views: Collection[int]) -> None:
        """Drop the bytes of buffer views without references, and set these views to None."""
        if not views:
            return
        entries = self._document["bufferViews"]
        for index in views:
            entries[index] = None
        self._free["bufferViews"] += sorted(views)
        before, self._bytes = self._bytes, bytearray()
        for view in filter(None, entries):
            start = view["byteOffset"]
            view["byteOffset"] = self.append(before[start : start + view["byteLength"]])

    def add_view(self, data: bytes, **members: int) -> int:
        """Append bytes with a new buffer view; return its index."""
        view = {"buffer": 0, "byteOffset": self.append(data), "byteLength": len(data), **members}
        return self._add_entry("bufferViews", view)

    def add_rows(self, accessor: Json, rows: NDArray[np.uint8]) -> int:
        """Append (n, bytes) vertex data of the type that `accessor` describes; return the index of the new accessor."""
        size = element_size(accessor)
        padded = np.pad(rows, ((0, 0), (0, -size % 4)))  # each vertex starts at a multiple of 4
        stride = {} if padded.shape[1] == size else {"byteStride": padded.shape[1]}
        view = self.add_view(padded.tobytes(), **stride, target=ARRAY)
        return self._add_entry("accessors", _described(accessor, rows) | {"bufferView": view})

    def add_sparse_rows(self, accessor: Json, rows: NDArray[np.uint8]) -> int:
        """Do the same for rows of which most are zero, as in morph targets: only the others are stored."""
        changed = np.flatnonzero(rows.any(axis=1))
        described = _described(accessor, rows)
        if changed.size:
            component = USHORT if len(rows) <= 0xFFFF else UINT
            indices = self.add_view(changed.astype(COMPONENTS[component]).tobytes())
            described["sparse"] = {
                "count": len(changed),
                "indices": {"bufferView": indices, "componentType": component},
                "values": {"bufferView": self.add_view(rows[changed].tobytes())},
            }
        return self._add_entry("accessors", described)

    def add_ids(self, numbers: NDArray[Any]) -> int:
        """Append (n,) whole numbers as vertex data, 16-bit where they fit, else float32; return the index as above."""
        component = USHORT if numbers.max(initial=0) <= 0xFFFF else FLOAT
        rows = numbers.astype(COMPONENTS[component])[:, None]
        return self.add_rows({"componentType": component, "type": "SCALAR"}, rows.view(np.uint8))

    def add_floats(self, values: NDArray[Any], bounded: bool = False) -> int:
        """Append (n, 1 to 3) vertex data as float32; return the index of its accessor."""
        rows = np.ascontiguousarray(values, dtype="<f4")
        accessor: Json = {"componentType": FLOAT, "type": f"VEC{rows.shape[1]}" if rows.shape[1] > 1 else "SCALAR"}
        if bounded:
            accessor |= {"min": [], "max": []}
        return self.add_rows(accessor, rows.view(np.uint8))

    def add_indices(self, vertices: NDArray[Any]) -> int:
        """Append (f, 3) or (e, 2) vertex indices, 16-bit where they fit; return the index of the accessor."""
        # The largest value of the type is the primitive restart index.
        component = USHORT if vertices.max(initial=0) < 0xFFFF else UINT
        view = self.add_view(vertices.astype(COMPONENTS[component]).tobytes(), target=ELEMENT_ARRAY)
        accessor = {"bufferView": view, "componentType": component, "count": vertices.size, "type": "SCALAR"}
        return self._add_entry("accessors", accessor)

    def inherit(self, index: int, document: GltfDocument, predecessor: int | None) -> int:
        """Give accessor `index` and its view the names and extras of those of a document; return its index."""
        if predecessor is not None:
            old, new = document.entry("accessors", predecessor), self._document["accessors"][index]
            new |= _named(old)
            if "bufferView" in old and "bufferView" in new:
                self._document["bufferViews"][new["bufferView"]] |= _named(
                    document.entry("bufferViews", old["bufferView"])
                )
        return index

    def _add_entry(self, kind: str, entry: Json) -> int:
        entries = self._document.setdefault(kind, [])
        if self._free[kind]:
            index = self._free[kind].pop(0)
            entries[index] = entry
            return index
        entries.append(entry)
        return len(entries) - 1


def _named(entry: Json) -> Json:
    return {key: entry[key] for key in ("name", "extras") if key in entry}


def _described(accessor: Json, rows: NDArray[np.uint8]) -> Json:
    """Return what `accessor` says of its type, with the count and, where it has them, the bounds of other rows."""
    members = {key: value for key, value in accessor.items() if key not in _PLACED}
    if "min" in accessor or "max" in accessor:
        members |= bounds(rows.view(COMPONENTS[accessor["componentType"]])[:, : WIDTHS[accessor["type"]]])
    return members | {"count": len(rows)}


class DecodedCopy:
    """A copy of a document in which plain data replace compressed data; they go to one more buffer.

    source   the document as it is in the file
    json     the JSON of the copy
    """

    def __init__(self, source: GltfDocument) -> None:
        """Start with a copy of the JSON and an empty buffer."""
        self.source = source
        self.json: Json = deepcopy(source.json)
        self._bytes = bytearray()
        self._views: set[int] = set()
        self._accessors: set[int] = set()

    def fill_view(self, index: int | None, data: bytes, **members: int) -> int:
        """Store decoded bytes, at a multiple of 4, as a buffer view; return its index.

        index     of the view to redefine; None: a new one
        members   of the view; others of an existing view stay
        """
        views = self.json["bufferViews"]
        if index is None:
            index = len(views)
            views.append({})
        self._bytes += bytes(-len(self._bytes) % 4)
        location = {"buffer": len(self.source.buffers), "byteOffset": len(self._bytes), "byteLength": len(data)}
        views[index].update(location | members)
        self._bytes += data
        self._views.add(index)
        return index

    def fill_accessor(self, index: int | None, entry: Json) -> int:
        """Replace accessor `index`, or append if that is None or was replaced before; return the index."""
        accessors = self.json.setdefault("accessors", [])
        if index is None or index in self._accessors:
            index = len(accessors)
            accessors.append(entry)
        else:
            accessors[index] = entry
        self._accessors.add(index)
        return index

    def finished(self, without: Collection[str]) -> GltfDocument:
        """Return the document, `without` listing some extensions; the copy must not be changed any more."""
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


def _bounds(document: GltfDocument, index: int, accessor: Json) -> Json:
    """Return the `min` and `max` that an accessor has, from its decoded values: compression may be lossy."""
    stated = {"min", "max"} & accessor.keys()
    if not stated or accessor["type"].startswith("MAT"):
        return {}
    actual = bounds(raw_values(document, index))
    return {key: actual[key] for key in stated & actual.keys()}


# Entries refer to later kinds only.
KINDS = ("textures", "images", "samplers", "bufferViews")

# Extensions whose references `_kind` knows, or that have none to these kinds; others may use any index.
_KNOWN_EXTENSIONS = re.compile(
    "KHR_(materials_|texture_|mesh_quantization|lights_punctual|node_|animation_pointer|xmp).*"
    "|EXT_(texture_|mesh_gpu_instancing|mesh_features|structural_metadata|lights_image_based|instance_features).*"
    "|MSFT_texture_dds|MSFT_lod|FB_ngon_encoding|GODOT_single_root|CESIUM_primitive_outline|VRM|VRMC_.*"
)

Reference = tuple[Any, Any]  # a dictionary or list, and the key or index under which it holds the index of an entry


def release_references(document: Json, buffer: GltfBuffer, references: Iterable[Reference]) -> None:
    """Set references to None, and with them every entry that only they needed, directly or indirectly.

    Entries that were unreferenced before stay; so does everything in a document with unknown extensions.
    """
    before = _used(document)
    for holder, key in references:
        holder[key] = None
    if not _has_known_extensions(document):
        return
    for kind in KINDS:
        entries = document.get(kind, [])
        unused = (before[kind] - _used(document)[kind]) & set(range(len(entries)))
        if kind == "bufferViews":
            buffer.free_views(unused)
        for index in unused:
            entries[index] = None


def add_entry(document: Json, kind: str, entry: Json) -> int:
    """Add an entry in a removed one's slot, or at the end; return its index."""
    entries: list[Json | None] = document.setdefault(kind, [])
    if None not in entries:
        entries.append(entry)
        return len(entries) - 1
    index = entries.index(None)
    entries[index] = entry
    return index


def compact(document: Json) -> None:
    """Delete the slots of removed entries, and renumber the references to later ones."""
    if not _has_known_extensions(document):
        views = document.get("bufferViews", [])
        views[:] = [{"buffer": 0, "byteLength": 1} if view is None else view for view in views]
        return
    references = _references(document)
    for kind in KINDS:
        entries = document.get(kind, [])
        kept = [index for index, entry in enumerate(entries) if entry is not None]
        if len(kept) == len(entries):
            continue
        new_index = {index: number for number, index in enumerate(kept)}
        for holder, key in references[kind]:
            holder[key] = new_index.get(holder[key], holder[key])  # a damaged document may have invalid ones
        document[kind] = [entries[index] for index in kept]
        if not kept:  # the schema forbids empty lists
            del document[kind]


def check_references(path: Path, document: Json) -> None:
    """Raise InputError for a reference to a texture, image, sampler, buffer view or coarser level that does not exist.

    An entry that the bake adds would otherwise get that index. So does one that is not a whole number, unless it is in
    an extension that is not known. Those in extras are not held to it: programs that know no extras may break them.
    """
    for names, holder, key in _scalars(document, ()):
        kind, value = None if EXTRAS in names else _kind(names), holder[key]
        if kind is not None and type(value) is not int and not unknown_extensions(_extensions_in(names)):
            raise damaged_file(path, f"it refers to entry {str(value)[:20]!r} of {kind}, a whole number was expected")
    for kind, found in _references(document, extras=False).items():
        count = len(document.get(kind, []))
        for holder, key in found:
            if not 0 <= holder[key] < count:
                raise damaged_file(path, f"it refers to entry {holder[key]} of {kind}, but there are {count}")
    for kind in ("materials", "nodes"):
        count = len(document.get(kind, []))
        for entry in document.get(kind, []):
            for level in entry.get("extensions", {}).get("MSFT_lod", {}).get("ids", []):
                if type(level) is not int or not 0 <= level < count:
                    said = f"MSFT_lod refers to entry {str(level)[:20]!r} of {kind}"
                    raise damaged_file(path, f"{said}, a whole number from 0 to {count - 1} was expected")


def unknown_extensions(names: Iterable[str]) -> list[str]:
    """Return the names of extensions that are not known here, sorted."""
    return sorted({name for name in names if not _KNOWN_EXTENSIONS.fullmatch(name)})


def numbers_of_unknown_extensions(document: Json) -> set[int]:
    """Return each whole number in unknown extensions of meshes and nodes: it may be the index of an accessor."""
    return {
        holder[key]
        for names, holder, key in _scalars(document, ())
        if type(holder[key]) is int and names[0] in ("meshes", "nodes") and unknown_extensions(_extensions_in(names))
    }


def _has_known_extensions(document: Json) -> bool:
    return not unknown_extensions(document.get("extensionsUsed", []))


def _used(document: Json) -> dict[str, set[int]]:
    """Return the referenced indices of each kind."""
    return {kind: {holder[key] for holder, key in found} for kind, found in _references(document).items()}


def _references(document: Json, *, extras: bool = True) -> dict[str, list[Reference]]:
    """Return all references to entries of each kind; `extras`: those that this program writes there, too."""
    found: dict[str, list[Reference]] = {kind: [] for kind in KINDS}
    for names, holder, key in _scalars(document, ()):
        kind = _kind(names) if extras or EXTRAS not in names else None
        if kind is not None and type(holder[key]) is int:  # not a boolean
            found[kind].append((holder, key))
    return found


def _kind(names: tuple[str, ...]) -> str | None:
    """Return the kind of entry that the integer at a path of names is the index of; None if of none of KINDS."""
    last, owner = names[-1], names[-2] if len(names) > 1 else ""
    # Any textureInfo, in extensions as well; EXT_structural_metadata has some under arbitrary names.
    if last == "index" and (owner.lower().endswith("texture") or "propertyTextures" in names):
        return "textures"
    if "textureProperties" in names or names[-3:] == ("VRM", "meta", "texture"):  # avatars of VRM 0
        return "textures"
    # Extensions of a texture have a source; specularImages is of EXT_lights_image_based, thumbnailImage of VRM 1.
    if (last == "source" and names[0] == "textures") or last in ("specularImages", "thumbnailImage"):
        return "images"
    if names == ("textures", "sampler"):
        return "samplers"
    # EXT_structural_metadata again.
    if last == "bufferView" or ("propertyTables" in names and last in ("values", "arrayOffsets", "stringOffsets")):
        return "bufferViews"
    return None


def _extensions_in(names: tuple[str, ...]) -> list[str]:
    """Return the extensions that a path of names leads through."""
    return [name for before, name in pairwise(names) if before == "extensions"]


def _scalars(value: Any, names: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield (names, holder, key) for every number or text in a JSON value: the path of names to it, and its place.

    What is in extras is left out, as its meaning is unknown, but for what this program writes there.
    """
    for key, member in list(value.items() if isinstance(value, dict) else enumerate(value)):
        path = (*names, key) if isinstance(value, dict) else names
        if not isinstance(member, dict | list):
            if path:
                yield path, value, key
        elif key != "extras":
            yield from _scalars(member, path)
        elif isinstance(member, dict) and isinstance(member.get(EXTRAS), dict):
            yield from _scalars(member[EXTRAS], (*path, EXTRAS))
