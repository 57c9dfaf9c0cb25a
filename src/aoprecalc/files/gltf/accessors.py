"""The rows of numbers that a glTF document's accessors stand for."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.damage import damaged
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.model import Doubles

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


def doubles(document: GltfDocument, index: int) -> Doubles:
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
