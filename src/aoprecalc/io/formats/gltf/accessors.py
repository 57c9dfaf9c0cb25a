"""The rows of numbers that a glTF document's accessors stand for."""

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.builder import damaged
from aoprecalc.io.formats.gltf.document import GltfDocument, Json
from aoprecalc.types import Float64Array

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

# Matrices whose columns are padded to 4 bytes: the bytes of one.
_PADDED = {("MAT2", 1): 8, ("MAT3", 1): 12, ("MAT3", 2): 24}


def raw_rows(document: GltfDocument, index: int) -> NDArray[np.uint8]:
    """Return the (count, bytes) elements of an accessor as they are in the file, sparse ones put in their places.

    Raises InputError where it reaches beyond its buffer view, or the view beyond its buffer.
    """
    accessor = document.entry("accessors", index)
    count, size = accessor["count"], element_size(accessor)
    sparse = accessor.get("sparse")
    if "bufferView" in accessor:
        rows = _view_rows(document, accessor["bufferView"], accessor.get("byteOffset", 0), count, size, strided=True)
    elif count > sum(len(buffer) for buffer in document.buffers):
        raise damaged(document.path, f"accessor {index} promises {count} elements, more than its buffers can hold")
    else:
        rows = np.zeros((count, size), dtype=np.uint8)
    if sparse is None:
        return rows

    places, values = sparse["indices"], sparse["values"]
    kind = np.dtype(COMPONENTS[places["componentType"]])
    at = _view_rows(document, places["bufferView"], places.get("byteOffset", 0), sparse["count"], kind.itemsize)
    where = at.view(kind)[:, 0]
    if where.size and where.max() >= count:
        raise damaged(document.path, f"accessor {index} changes element {where.max()}, but has {count}")
    rows[where] = _view_rows(document, values["bufferView"], values.get("byteOffset", 0), sparse["count"], size)
    return rows


def numbers(document: GltfDocument, index: int) -> NDArray[Any]:
    """Return the (count, width) elements of an accessor in their own type."""
    accessor = document.entry("accessors", index)
    rows = raw_rows(document, index)
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    if rows.shape[1] != kind.itemsize * WIDTHS[accessor["type"]]:
        raise damaged(document.path, f"accessor {index} holds small matrices, which were not expected")
    return rows.view(kind)


def doubles(document: GltfDocument, index: int) -> Float64Array:
    """Return the (count, width) elements of an accessor as float64, normalized integers as fractions."""
    values = numbers(document, index)
    if not document.entry("accessors", index).get("normalized") or values.dtype.kind == "f":
        return values.astype(np.float64)
    return np.maximum(values / np.float64(np.iinfo(values.dtype).max), -1.0)


def bounds(values: NDArray[Any]) -> Json:
    """Return `min` and `max` of (count, width) elements; nothing where there are none or JSON cannot hold them."""
    if not values.size or not np.isfinite(values).all():
        return {}
    return {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}


def element_size(accessor: Json) -> int:
    """Return the bytes of one element."""
    size = np.dtype(COMPONENTS[accessor["componentType"]]).itemsize
    return _PADDED.get((accessor["type"], size), size * WIDTHS[accessor["type"]])


def view_bytes(document: GltfDocument, index: int) -> bytes:
    """Return the bytes of a buffer view; raises InputError where it reaches beyond its buffer."""
    view = document.entry("bufferViews", index)
    start, length = view.get("byteOffset", 0), view["byteLength"]
    document.entry("buffers", view["buffer"])
    buffer = document.buffers[view["buffer"]]
    if start < 0 or length < 0 or start + length > len(buffer):
        raise damaged(document.path, f"buffer view {index} ends at byte {start + length}, its buffer at {len(buffer)}")
    return buffer[start : start + length]


def _view_rows(
    document: GltfDocument, index: int, offset: int, count: int, size: int, strided: bool = False
) -> NDArray[np.uint8]:
    """Return `count` rows of `size` bytes that begin at an offset of a buffer view."""
    data = view_bytes(document, index)
    stride = document.entry("bufferViews", index).get("byteStride", size) if strided else size
    end = offset + stride * (count - 1) + size if count else offset
    if count < 0 or offset < 0 or stride < size or end > len(data):
        found = f"{count} elements up to byte {end} were expected, but buffer view {index} has {len(data)} bytes"
        raise damaged(document.path, found)
    return np.ndarray((count, size), np.uint8, data, offset, (stride, 1)).copy()


# The one buffer of a glTF document that is being written, and the views and accessors into it.

ARRAY, ELEMENT_ARRAY = 34962, 34963
FLOAT, USHORT, UINT = 5126, 5123, 5125


class GltfBuffer:
    """Collects bytes and describes them in a document's `bufferViews` and `accessors`.

    free_accessors, free_views   entries that nothing refers to any more; new ones take their places first
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
        """Add bytes; return where they begin, at a multiple of 4."""
        self._bytes += bytes(-len(self._bytes) % 4)
        start = len(self._bytes)
        self._bytes += data
        return start

    def free_views(self, views: Collection[int]) -> None:
        """Put None in the place of buffer views that nothing refers to any more, and leave out their bytes."""
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
        """Add bytes with a buffer view of their own; return its number."""
        view = {"buffer": 0, "byteOffset": self.append(data), "byteLength": len(data), **members}
        return self._place("bufferViews", view)

    def add_rows(self, accessor: Json, rows: NDArray[np.uint8]) -> int:
        """Add vertex data as (n, bytes) elements, described as in another accessor; return the new one's number."""
        size = element_size(accessor)
        padded = np.pad(rows, ((0, 0), (0, -size % 4)))  # each vertex begins at a multiple of 4
        stride = {} if padded.shape[1] == size else {"byteStride": padded.shape[1]}
        view = self.add_view(padded.tobytes(), **stride, target=ARRAY)
        members = {key: value for key, value in accessor.items() if key not in ("byteOffset", "sparse", "min", "max")}
        if "min" in accessor or "max" in accessor:
            members |= bounds(rows.view(COMPONENTS[accessor["componentType"]])[:, : WIDTHS[accessor["type"]]])
        return self._place("accessors", members | {"bufferView": view, "count": len(rows)})

    def add_floats(self, values: NDArray[Any], bounded: bool = False) -> int:
        """Add (n, 2 or 3) vertex data as float32; return the number of its accessor."""
        rows = np.ascontiguousarray(values, dtype="<f4")
        accessor: Json = {"componentType": FLOAT, "type": f"VEC{rows.shape[1]}"}
        if bounded:
            accessor |= {"min": [], "max": []}
        return self.add_rows(accessor, rows.view(np.uint8))

    def add_triangles(self, triangles: NDArray[Any]) -> int:
        """Add (f, 3) vertex numbers, in 16 bits where they fit; return the number of the accessor."""
        # The greatest number of a type is not a vertex but starts a new strip.
        component = USHORT if triangles.max() < 0xFFFF else UINT
        view = self.add_view(triangles.astype(COMPONENTS[component]).tobytes(), target=ELEMENT_ARRAY)
        accessor = {"bufferView": view, "componentType": component, "count": triangles.size, "type": "SCALAR"}
        return self._place("accessors", accessor)

    def _place(self, kind: str, entry: Json) -> int:
        entries = self._document.setdefault(kind, [])
        if self._free[kind]:
            index = self._free[kind].pop(0)
            entries[index] = entry
            return index
        entries.append(entry)
        return len(entries) - 1
