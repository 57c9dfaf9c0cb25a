"""A glTF 2.0 document as it is in the file: its JSON as plain values, the bytes of its buffers, and its accessors.

The JSON is kept as plain values rather than as pygltflib's classes, because those drop unknown members, add defaults
and replace the document's generator.
"""

import base64
import binascii
import json
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.files import FileSearch, file_beside, read_file
from aoprecalc.system import may_name_a_file
from aoprecalc.types import Float64Array

Json = dict[str, Any]

MAGIC = b"glTF"
BINARY_EXTENSIONS = (".glb", ".vrm")  # of documents in one file
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, eq=False)
class GltfDocument:
    """A document and its buffers, read-only.

    path      of the file; URIs are relative to its folder
    json      the whole document
    buffers   the bytes of each buffer; empty for one without data
    """

    path: Path
    json: Json
    buffers: tuple[bytes, ...]

    def files(self) -> list[Path]:
        """Return the files that its buffers and images refer to, existing or not."""
        return _files(self.path, self.json)

    def entry(self, kind: str, index: int) -> Json:
        """Return entry `index` of the array `kind`; raises InputError where there is none."""
        entries = self.json.get(kind, [])
        if not 0 <= index < len(entries):
            raise damaged_file(self.path, f"it refers to entry {index} of {kind}, but there are {len(entries)}")
        entry: Json = entries[index]
        return entry


def parse_gltf(path: Path, data: bytes) -> GltfDocument:
    """Read a glTF or GLB file of the given bytes, and its buffers.

    Raises InputError where it is not glTF 2.0 or a buffer is missing or cut off.
    """
    document, binary = _parse_json(path, data)
    buffers = [_buffer(path, index, buffer, binary) for index, buffer in enumerate(document.get("buffers", []))]
    return GltfDocument(path, document, tuple(buffers))


def gltf_files(path: Path, data: bytes) -> list[Path]:
    """Return the files that a glTF or GLB file of the given bytes refers to; raises InputError where it is not glTF."""
    return _files(path, _parse_json(path, data)[0])


def local_file(path: Path, uri: str) -> Path | None:
    """Return the file that a URI of the document at `path` names; None for data URIs, remote, absolute and wrong ones.

    The specification allows relative ones alone; of an absolute one, Windows would ask a server that it names. Where
    there is no such file, another that is there may be meant: see `misnamed_files`.
    """
    named = _named_file(path, unquote(uri, errors="surrogateescape")) if _is_relative(uri) else None
    if named is None or os.path.exists(named):  # which, unlike Path.exists, takes names of any length
        return named
    found = map(FileSearch(path.parent).find, (unquote(uri), uri, unquote(re.split("[?#]", uri)[0])))
    return next(filter(None, found), named)


def misnamed_files(path: Path, document: Json) -> list[tuple[str, Path]]:
    """Return (URI, file) for each file of buffers and images that is not quite at its URI, but was found.

    Its name is not percent-encoded, has backslashes or is written in other capitals, as Windows accepts them, has a
    query behind it, or lacks its folder.
    """
    found = [(uri, local_file(path, uri)) for uri in _uris(document)]
    return [(uri, file) for uri, file in found if file is not None and is_misnamed(path, uri, file)]


def is_misnamed(path: Path, uri: str, file: Path) -> bool:
    """Tell whether a URI of the document at `path` names another file than the one that was found for it."""
    return file != _named_file(path, unquote(uri, errors="surrogateescape"))


def _is_relative(uri: str) -> bool:
    return not (re.match(r"[a-zA-Z][a-zA-Z0-9+.-]*:", uri) or re.search(r"[\ud800-\udfff]", uri))


def _named_file(path: Path, name: str) -> Path | None:
    """Return the file that a decoded URI names; None if it is absolute: a name such as a:b is not."""
    parts = [part for part in re.split(r"[/\\]", name) if part not in ("", ".", "..")]
    is_absolute = bool(PureWindowsPath(name).root)
    return file_beside(path.parent, name) if not is_absolute and all(map(may_name_a_file, parts)) else None


def _files(path: Path, document: Json) -> list[Path]:
    return [file for uri in _uris(document) if (file := local_file(path, uri)) is not None]


def _uris(document: Json) -> list[str]:
    return [entry["uri"] for kind in ("buffers", "images") for entry in document.get(kind, []) if "uri" in entry]


def _parse_json(path: Path, data: bytes) -> tuple[Json, bytes | None]:
    """Return the document, and the binary chunk of a GLB."""
    text, binary = _split_glb(path, data) if data.startswith(MAGIC) else (data, None)
    try:
        document: Json = json.loads(text)
        version = str(document["asset"]["version"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise damaged_file(path, f"a JSON document with asset.version was expected ({error})") from error
    if not version.startswith("2."):
        raise InputError(f"{path}: is glTF {version[:8]!a}, version 2.0 was expected; convert it")
    for kind in ("buffers", "images"):  # which are looked at before and after the reader's own checks
        entries = document.get(kind, [])
        if not isinstance(entries, list) or not all(
            isinstance(entry, dict) and isinstance(entry.get("uri", ""), str) for entry in entries
        ):
            raise damaged_file(path, f"a list of {kind}, each with a text as URI if any, was expected")
    return document, binary


def _split_glb(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary chunk of a GLB."""
    if len(data) < 20:
        raise damaged_file(path, f"it has {len(data)} bytes, a GLB header was expected")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise InputError(f"{path}: is GLB version {version}, version 2 was expected; convert it to glTF 2.0")
    if length > len(data):
        raise damaged_file(path, f"{length} bytes were expected, but it has {len(data)}")
    chunks: dict[int, bytes] = {}
    for kind, chunk in _chunks(path, data[:length]):
        chunks.setdefault(kind, chunk)
    if JSON_CHUNK not in chunks:
        raise damaged_file(path, "a JSON chunk was expected and is not there")
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK)


def _chunks(path: Path, data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the type and the bytes of each chunk of a GLB."""
    at = 12
    while at + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > len(data):
            raise damaged_file(path, f"a chunk of {size} bytes was expected, but {len(data) - at - 8} are left")
        yield kind, data[at + 8 : at + 8 + size]
        at += 8 + size


def unknown_chunks(path: Path, data: bytes) -> int:
    """Return how many chunks of a file are neither of the two that the specification defines; 0 if it is no GLB."""
    if not data.startswith(MAGIC):
        return 0
    chunks = list(_chunks(path, data[: struct.unpack_from("<I", data, 8)[0]]))
    return len(chunks) - len({kind for kind, _ in chunks} & {JSON_CHUNK, BIN_CHUNK})


def _buffer(path: Path, index: int, buffer: Json, binary: bytes | None) -> bytes:
    """Return the bytes of one buffer, of its stated length."""
    uri = buffer.get("uri")
    if uri is None:
        if index or binary is None:
            return b""  # a fallback buffer without data; reading from it fails as too short
        data = binary
    elif uri.startswith("data:"):
        data = data_uri(path, uri)
    else:
        file = local_file(path, uri)
        if file is None:
            raise InputError(
                f"{path}: its buffer is at {uri[:60]!a}, a file beside it was expected; save it with its buffer"
            )
        try:
            data = read_file(file)
        except OSError as error:
            raise InputError(
                f"{path}: its buffer {uri[:60]!a} cannot be read ({error.strerror}); put the file beside it"
            ) from error
    if len(data) < buffer["byteLength"]:
        raise damaged_file(path, f"buffer {index} of {buffer['byteLength']} bytes was expected, but it has {len(data)}")
    return data[: buffer["byteLength"]]


def data_uri(path: Path, uri: str) -> bytes:
    """Return the bytes of a data URI of the document at `path`; raises InputError."""
    head, _, body = uri.partition(",")
    try:
        return base64.b64decode(unquote(body), validate=True) if head.endswith(";base64") else unquote(body).encode()
    except binascii.Error as error:
        raise damaged_file(path, f"a data URI is not base64 ({error})") from error


# Accessors.

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

# The size in bytes of matrices whose columns are padded to 4 bytes.
_PADDED_SIZES = {("MAT2", 1): 8, ("MAT3", 1): 12, ("MAT3", 2): 24}


def raw_rows(document: GltfDocument, index: int) -> NDArray[np.uint8]:
    """Return the (count, bytes) elements of an accessor as stored, with sparse values applied.

    Raises InputError where the accessor exceeds its buffer view, or the view its buffer.
    """
    accessor = document.entry("accessors", index)
    count, size = accessor["count"], element_size(accessor)
    sparse = accessor.get("sparse")
    if "bufferView" in accessor:
        rows = _view_rows(document, accessor["bufferView"], accessor.get("byteOffset", 0), count, size, strided=True)
    elif count > sum(len(buffer) for buffer in document.buffers):
        raise damaged_file(document.path, f"accessor {index} promises {count} elements, more than its buffers can hold")
    else:
        rows = np.zeros((count, size), dtype=np.uint8)
    if sparse is None:
        return rows

    indices, values = sparse["indices"], sparse["values"]
    kind = np.dtype(COMPONENTS[indices["componentType"]])
    raw = _view_rows(document, indices["bufferView"], indices.get("byteOffset", 0), sparse["count"], kind.itemsize)
    changed = raw.view(kind)[:, 0]
    if changed.size and changed.max() >= count:
        raise damaged_file(document.path, f"accessor {index} changes element {changed.max()}, but has {count}")
    rows[changed] = _view_rows(document, values["bufferView"], values.get("byteOffset", 0), sparse["count"], size)
    return rows


def raw_values(document: GltfDocument, index: int) -> NDArray[Any]:
    """Return the (count, width) values of an accessor in their own type."""
    accessor = document.entry("accessors", index)
    rows = raw_rows(document, index)
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    if rows.shape[1] != kind.itemsize * WIDTHS[accessor["type"]]:
        raise damaged_file(document.path, f"accessor {index} holds small matrices, which were not expected")
    return rows.view(kind)


def float_values(document: GltfDocument, index: int) -> Float64Array:
    """Return the (count, width) values of an accessor as float64, normalized integers as fractions."""
    values = raw_values(document, index)
    if not document.entry("accessors", index).get("normalized") or values.dtype.kind == "f":
        return values.astype(np.float64)
    return np.maximum(values / np.float64(np.iinfo(values.dtype).max), -1.0)


def bounds(values: NDArray[Any]) -> Json:
    """Return the members `min` and `max` of (count, width) values; none without values or if not all are finite."""
    if not values.size or not np.isfinite(values).all():
        return {}
    return {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}


def element_size(accessor: Json) -> int:
    """Return the size of one element in bytes."""
    size = np.dtype(COMPONENTS[accessor["componentType"]]).itemsize
    return _PADDED_SIZES.get((accessor["type"], size), size * WIDTHS[accessor["type"]])


def view_bytes(document: GltfDocument, index: int) -> bytes:
    """Return the bytes of a buffer view; raises InputError where it exceeds its buffer."""
    view = document.entry("bufferViews", index)
    start, length = view.get("byteOffset", 0), view["byteLength"]
    document.entry("buffers", view["buffer"])
    buffer = document.buffers[view["buffer"]]
    if start < 0 or length < 0 or start + length > len(buffer):
        raise damaged_file(
            document.path, f"buffer view {index} ends at byte {start + length}, its buffer at {len(buffer)}"
        )
    return buffer[start : start + length]


def _view_rows(
    document: GltfDocument, index: int, offset: int, count: int, size: int, strided: bool = False
) -> NDArray[np.uint8]:
    """Return `count` rows of `size` bytes, starting at an offset in a buffer view."""
    data = view_bytes(document, index)
    stride = document.entry("bufferViews", index).get("byteStride", size) if strided else size
    end = offset + stride * (count - 1) + size if count else offset
    if count < 0 or offset < 0 or stride < size or end > len(data):
        found = f"{count} elements up to byte {end} were expected, but buffer view {index} has {len(data)} bytes"
        raise damaged_file(document.path, found)
    return np.ndarray((count, size), np.uint8, data, offset, (stride, 1)).copy()
