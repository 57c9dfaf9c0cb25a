"""A glTF 2.0 document as it is in the file: its JSON as plain values, and the bytes of its buffers.

The JSON is kept as it is, rather than as pygltflib's classes, because those leave out members that they do not know,
add the defaults of those that are missing and put their own name in place of the document's generator.
"""

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from aoprecalc.errors import InputError
from aoprecalc.io.formats.builder import damaged

Json = dict[str, Any]

MAGIC = b"glTF"
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, eq=False)
class GltfDocument:
    """A document and its buffers; not to be changed by anyone.

    path      of the file; the URIs of images count from its folder
    json      the whole document
    buffers   the bytes of each buffer; empty for one that the file does not hold
    """

    path: Path
    json: Json
    buffers: tuple[bytes, ...]

    def files(self) -> list[Path]:
        """Return the files that its buffers and images refer to, there or not."""
        return _files(self.path, self.json)

    def entry(self, kind: str, index: int) -> Json:
        """Return entry `index` of the document's array `kind`; raises InputError where there is none."""
        entries = self.json.get(kind, [])
        if not 0 <= index < len(entries):
            raise damaged(self.path, f"it refers to entry {index} of {kind}, but there are {len(entries)}")
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
    """Return the file that a URI of the document at `path` stands for; None for data URIs and other places."""
    if urlsplit(uri).scheme or uri.startswith("//"):
        return None
    return path.parent / unquote(uri)


def _files(path: Path, document: Json) -> list[Path]:
    uris = [entry["uri"] for kind in ("buffers", "images") for entry in document.get(kind, []) if "uri" in entry]
    return [file for uri in uris if (file := local_file(path, uri)) is not None]


def _parse_json(path: Path, data: bytes) -> tuple[Json, bytes | None]:
    """Return the document, and the binary chunk of a GLB."""
    text, binary = _split_glb(path, data) if data.startswith(MAGIC) else (data, None)
    try:
        document: Json = json.loads(text)
        version = str(document["asset"]["version"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise damaged(path, f"a JSON document with asset.version was expected ({error})") from error
    if not version.startswith("2."):
        raise InputError(f"{path}: is glTF {version[:8]!a}, version 2.0 was expected; convert it")
    return document, binary


def _split_glb(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary chunk of a GLB."""
    if len(data) < 20:
        raise damaged(path, f"it has {len(data)} bytes, a GLB header was expected")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise InputError(f"{path}: is GLB version {version}, version 2 was expected; convert it to glTF 2.0")
    if length > len(data):
        raise damaged(path, f"{length} bytes were expected, but it has {len(data)}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise damaged(path, f"a chunk of {size} bytes was expected, but {length - at - 8} are left")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if JSON_CHUNK not in chunks:
        raise damaged(path, "a JSON chunk was expected and is not there")
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK)


def _buffer(path: Path, index: int, buffer: Json, binary: bytes | None) -> bytes:
    """Return the bytes of one buffer, as many as it announces."""
    uri = buffer.get("uri")
    if uri is None:
        if index or binary is None:
            return b""  # the stand-in of a compressed buffer; who reads from it finds it too short
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
            data = file.read_bytes()
        except OSError as error:
            raise InputError(
                f"{path}: its buffer {uri[:60]!a} cannot be read ({error.strerror}); put the file beside it"
            ) from error
    if len(data) < buffer["byteLength"]:
        raise damaged(path, f"buffer {index} of {buffer['byteLength']} bytes was expected, but it has {len(data)}")
    return data[: buffer["byteLength"]]


def data_uri(path: Path, uri: str) -> bytes:
    """Return the bytes that a data URI of the document at `path` stands for; raises InputError."""
    head, _, body = uri.partition(",")
    try:
        return base64.b64decode(unquote(body), validate=True) if head.endswith(";base64") else unquote(body).encode()
    except binascii.Error as error:
        raise damaged(path, f"a data URI is not base64 ({error})") from error
