"""New buffers of glTF documents: the one that a writer fills, and the one that holds decompressed data."""

from collections.abc import Collection
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


class GltfBuffer:
    """The buffer of a document that is written, with its `bufferViews` and `accessors`.

    free_accessors, free_views   indices of entries without references, to be reused first
    """

    def __init__(self, document: Json, free_accessors: tuple[int, ...] = (), free_views: tuple[int, ...] = ()) -> None:
        """Start with no bytes."""
        self._document = document
        self._bytes = bytearray()
        self._free = {"accessors": list(free_accessors), "bufferViews": list(free_views)}

    @property
    def data(self) -> bytes:
        """All bytes so far."""
        return bytes(self._bytes)

    def append(self, data: bytes | bytearray) -> int:
        """Append bytes at a multiple of 4; return their offset."""
        self._bytes += bytes(-len(self._bytes) % 4)
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
        members = {key: value for key, value in accessor.items() if key not in ("byteOffset", "sparse", "min", "max")}
        if "min" in accessor or "max" in accessor:
            members |= bounds(rows.view(COMPONENTS[accessor["componentType"]])[:, : WIDTHS[accessor["type"]]])
        return self._add_entry("accessors", members | {"bufferView": view, "count": len(rows)})

    def add_floats(self, values: NDArray[Any], bounded: bool = False) -> int:
        """Append (n, 2 or 3) vertex data as float32; return the index of its accessor."""
        rows = np.ascontiguousarray(values, dtype="<f4")
        accessor: Json = {"componentType": FLOAT, "type": f"VEC{rows.shape[1]}"}
        if bounded:
            accessor |= {"min": [], "max": []}
        return self.add_rows(accessor, rows.view(np.uint8))

    def add_triangles(self, triangles: NDArray[Any]) -> int:
        """Append (f, 3) vertex indices, 16-bit where they fit; return the index of the accessor."""
        # The largest value of the type is the primitive restart index.
        component = USHORT if triangles.max() < 0xFFFF else UINT
        view = self.add_view(triangles.astype(COMPONENTS[component]).tobytes(), target=ELEMENT_ARRAY)
        accessor = {"bufferView": view, "componentType": component, "count": triangles.size, "type": "SCALAR"}
        return self._add_entry("accessors", accessor)

    def _add_entry(self, kind: str, entry: Json) -> int:
        entries = self._document.setdefault(kind, [])
        if self._free[kind]:
            index = self._free[kind].pop(0)
            entries[index] = entry
            return index
        entries.append(entry)
        return len(entries) - 1


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
