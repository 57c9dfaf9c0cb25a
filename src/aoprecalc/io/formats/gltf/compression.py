"""Decompress the meshes of a glTF document when it is read: the rest of the package sees plain accessors only.

KHR_draco_mesh_compression as specified by Fan Zhang, Ondrej Stava, Frank Galligan, Kai Ninomiya and Patrick Cozzi;
EXT_meshopt_compression and KHR_meshopt_compression by Arseny Kapoulkine, Jasper St. Pierre and others, all for the
Khronos Group. (KHR_meshopt adds a version of the streams and the filter COLOR to EXT_meshopt.) The decoders are the
packages of the extra `compressed`, imported when a file needs them.
"""

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.document import COMPONENTS, WIDTHS, GltfDocument, Json, view_bytes
from aoprecalc.io.formats.gltf.references import ARRAY, ELEMENT_ARRAY, UINT, DecodedCopy

DRACO, DRACO_PACKAGE = "KHR_draco_mesh_compression", "DracoPy"
MESHOPT, MESHOPT_PACKAGE = ("EXT_meshopt_compression", "KHR_meshopt_compression"), "meshoptimizer"
EXTENSIONS = (DRACO, *MESHOPT)


def decompress(document: GltfDocument) -> GltfDocument:
    """Return the document without mesh compression extensions; the same object where it uses none.

    Compressed data are decoded into an additional buffer at the end of the list. Accessors keep their type and count,
    buffer views their length and stride; `min` and `max` become those of the decoded values. If an extension is not
    required and there are uncompressed fallback data, those are used, so that the result does not depend on what is
    installed.

    Raises InputError where a stream is damaged or does not match its accessors, or where the package that decodes it is
    missing and there are no fallback data.
    """
    if _extensions(document.json).isdisjoint(EXTENSIONS):
        return document
    copy = DecodedCopy(document)
    decode_views(copy)
    decode_primitives(copy)
    return copy.finished(without=EXTENSIONS)


def _extensions(json: Json) -> set[str]:
    """Return the names of all extensions that are listed or used by buffer views and primitives."""
    primitives = [primitive for mesh in json.get("meshes", []) for primitive in mesh.get("primitives", [])]
    used = {name for entry in (*json.get("bufferViews", []), *primitives) for name in entry.get("extensions", {})}
    return used.union(json.get("extensionsUsed", []), json.get("extensionsRequired", []))


def is_installed(package: str) -> bool:
    """Tell whether a package is installed."""
    return find_spec(package) is not None


def prefers_fallback(document: GltfDocument, extension: str, package: str) -> bool:
    """Tell whether uncompressed fallback data, where they exist, are used instead of the compressed data."""
    return extension not in document.json.get("extensionsRequired", []) or not is_installed(package)


def load_library(path: Path, extension: str, package: str) -> ModuleType:
    """Import the package that decodes an extension; raises InputError for the file at `path` where it is missing."""
    needs = f"{path}: its meshes are compressed by {extension}, which needs the package {package}"
    if not is_installed(package):
        raise InputError(f"{needs}; `pip install 'aoprecalc[compressed]'`")
    try:
        return import_module(package)
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{needs}, but that cannot be loaded ({reason}); install it again") from error


def pop_extension(entry: Json, name: str) -> Any:
    """Remove an extension from an entry of a document; return its value, None if it has none."""
    value = entry.get("extensions", {}).pop(name, None)
    if value is not None and not entry["extensions"]:
        del entry["extensions"]
    return value


def has_bytes(document: GltfDocument, view: Json) -> bool:
    """Tell whether the bytes of a view exist; the fallback buffer of a compressed document may have none."""
    document.entry("buffers", view["buffer"])
    start: int = view.get("byteOffset", 0)
    length: int = view["byteLength"]
    return min(start, length) >= 0 and start + length <= len(document.buffers[view["buffer"]])


# Draco: the attributes and triangles of a primitive are in one stream.

_MAGIC, _TYPE_OFFSET, _MESH_TYPE = (
    b"DRACO",
    7,
    1,
)  # start of a stream, offset of its type, a mesh
_TRIANGLE_STRIP = 5  # a primitive's mode
_FLOAT_TYPES = (9, 10)  # Draco's data types float32 and float64


@dataclass(frozen=True, eq=False)
class DracoValues:
    """The values of an attribute or of the faces, as DracoPy returns them.

    values       (n, width): uint8 or uint32; float32 for floats and for signed integers
    is_integer   they are integers in the stream; float32 values may then be divided by the maximum of their type
    """

    values: NDArray[Any]
    is_integer: bool


@dataclass(frozen=True, eq=False)
class DracoStream:
    """A decoded mesh.

    corners      (3 f, 1) uint32: the vertex indices of the triangles
    attributes   by unique id
    """

    corners: DracoValues
    attributes: dict[int, DracoValues]


def read_stream(document: GltfDocument, view: int) -> DracoStream:
    """Decode the stream in a buffer view; raises InputError where it is damaged or DracoPy is not installed."""
    library = load_library(document.path, DRACO, DRACO_PACKAGE)
    data = view_bytes(document, view)
    # Draco bounds the counts of a mesh by its bytes, but allocates whatever a damaged point cloud announces.
    if not data.startswith(_MAGIC) or data[_TYPE_OFFSET : _TYPE_OFFSET + 1] != bytes([_MESH_TYPE]):
        raise damaged_file(document.path, f"a Draco mesh was expected, but buffer view {view} begins {data[:8]!a}")
    try:
        mesh = library.decode(data)
    except MemoryError:
        raise
    except Exception as error:  # DracoPy has no common class of errors
        raise damaged_file(document.path, f"the Draco mesh in buffer view {view} cannot be decoded") from error

    corners = mesh.faces if hasattr(mesh, "faces") else np.empty(0, np.uint32)  # a mesh without faces is a point cloud
    attributes = {
        entry["unique_id"]: DracoValues(entry["data"], entry["data_type"] not in _FLOAT_TYPES)
        for entry in mesh.attributes
        if entry["data"] is not None
    }
    return DracoStream(DracoValues(corners.reshape(-1, 1), True), attributes)


def decode_primitives(copy: DecodedCopy) -> None:
    """Decode Draco-compressed primitives; raises InputError where a stream does not match its accessors."""
    decoder = _Decoder(copy)
    for primitive in chain.from_iterable(mesh.get("primitives", []) for mesh in copy.json.get("meshes", [])):
        packed = pop_extension(primitive, DRACO)
        if packed is not None and not _has_fallback(copy, primitive, packed):
            decoder.decode(primitive, packed)


def _has_fallback(copy: DecodedCopy, primitive: Json, packed: Json) -> bool:
    """Tell whether all compressed data have uncompressed fallback data, and these are to be used."""
    document, attributes = copy.source, primitive["attributes"]
    used = [attributes[name] for name in packed["attributes"] if name in attributes]
    used += [primitive["indices"]] if "indices" in primitive else []
    views = [document.entry("accessors", index).get("bufferView") for index in used]
    return prefers_fallback(copy.source, DRACO, DRACO_PACKAGE) and all(
        view is not None and has_bytes(document, document.entry("bufferViews", view)) for view in views
    )


class _Decoder:
    """Decodes primitives; shared streams and accessors are decoded once."""

    def __init__(self, copy: DecodedCopy) -> None:
        self._copy = copy
        self._streams: dict[int, DracoStream] = {}  # by buffer view
        self._accessors: dict[tuple[int | None, int, int | None], int] = {}  # by the arguments of `_accessor`

    def decode(self, primitive: Json, packed: Json) -> None:
        """Replace the accessors of a primitive's attributes and indices by decoded ones."""
        view, ids, attributes = packed["bufferView"], packed["attributes"], primitive["attributes"]
        for name, described in attributes.items():
            if name in ids:
                attributes[name] = self._accessor(described, view, ids[name])
        # Draco stores triangles; the accessor of a strip's indices does not describe them.
        if primitive.get("mode") == _TRIANGLE_STRIP:
            del primitive["mode"]
            primitive.pop("indices", None)
        primitive["indices"] = self._accessor(primitive.get("indices"), view, None)

    def _accessor(self, described: int | None, view: int, unique_id: int | None) -> int:
        """Return the index of an accessor of decoded values.

        described   the accessor with their count and type; None if there is none
        view        the buffer view of the stream
        unique_id   of the attribute in the stream; None for the vertex indices
        """
        key = described, view, unique_id
        if key not in self._accessors:
            self._accessors[key] = self._decoded(*key)
        return self._accessors[key]

    def _decoded(self, described: int | None, view: int, unique_id: int | None) -> int:
        source, free_view = self._copy.source, None
        if view not in self._streams:
            self._streams[view] = read_stream(source, view)
            self._copy.json["bufferViews"][view].clear()
            free_view = view  # nothing refers to it any more
        stream = self._streams[view]
        numbers = stream.corners if unique_id is None else stream.attributes.get(unique_id)
        if numbers is None:
            found = f"attribute {unique_id} was expected, but the Draco mesh in buffer view {view} does not have it"
            raise damaged_file(source.path, found)

        if described is None:
            accessor: Json = {"componentType": UINT, "type": "SCALAR", "count": len(numbers.values)}
        else:
            accessor = dict(source.entry("accessors", described))
        values = _convert(source.path, f"accessor {described}", accessor, numbers)
        if unique_id is None:
            filled = self._copy.fill_view(free_view, values.tobytes(), target=ELEMENT_ARRAY)
        else:
            rows = values.view(np.uint8)
            padded = np.pad(rows, ((0, 0), (0, -rows.shape[1] % 4)))  # each vertex starts at a multiple of 4
            stride = {} if padded.shape == rows.shape else {"byteStride": padded.shape[1]}
            filled = self._copy.fill_view(free_view, padded.tobytes(), **stride, target=ARRAY)
        kept = {member: value for member, value in accessor.items() if member not in ("byteOffset", "sparse")}
        return self._copy.fill_accessor(described, kept | {"bufferView": filled})


def _convert(path: Path, name: str, accessor: Json, numbers: DracoValues) -> NDArray[Any]:
    """Convert (count, width) values to the type of an accessor; raises InputError where they do not fit."""
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    values, expected = numbers.values, (accessor["count"], WIDTHS[accessor["type"]])
    if values.shape != expected:
        found = f"{name} describes {expected[0]} elements of {expected[1]} numbers, its Draco mesh has {values.shape}"
        raise damaged_file(path, found)
    if kind.kind == "f":
        fits = not numbers.is_integer
    else:
        if values.dtype.kind == "f":
            is_fraction = accessor.get("normalized") and np.abs(values).max(initial=0) <= 1
            values = np.rint(values * np.iinfo(kind).max if is_fraction else values)
        limits = np.iinfo(kind)
        fits = numbers.is_integer and values.min(initial=0) >= limits.min and values.max(initial=0) <= limits.max
    if not fits:
        raise damaged_file(path, f"{name} describes numbers of type {kind.name}, its Draco mesh has others")
    return values.astype(kind)


# meshopt: the bytes of one buffer view are in one stream.

_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
# The element sizes in bytes that each filter accepts.
_FILTER_SIZES = {
    "NONE": range(4, 257, 4),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": range(4, 257, 4),
    "COLOR": (4, 8),
}


def decode_views(copy: DecodedCopy) -> None:
    """Decode meshopt-compressed buffer views; raises InputError where a stream does not match its view."""
    for index, view in enumerate(copy.json.get("bufferViews", [])):
        for extension in MESHOPT:
            packed = pop_extension(view, extension)
            if packed is None or (
                prefers_fallback(copy.source, extension, MESHOPT_PACKAGE) and has_bytes(copy.source, view)
            ):
                continue
            library = load_library(copy.source.path, extension, MESHOPT_PACKAGE)
            copy.fill_view(index, _decoded(library, copy.source, index, view["byteLength"], packed))


def _decoded(library: ModuleType, document: GltfDocument, index: int, size: int, packed: Json) -> bytes:
    """Return the `size` bytes of buffer view `index`, decoded."""
    stream = _stream(document, index, packed)
    mode, name = packed["mode"], packed.get("filter", "NONE")
    count, stride = packed["count"], packed["byteStride"]
    # The decoders do not check these numbers.
    if mode not in _MODES or name not in _FILTER_SIZES:
        raise damaged_file(
            document.path, f"buffer view {index} is compressed by {mode!a} with {name!a}, which do not exist"
        )
    if (
        count < 0
        or count * stride != size
        or stride not in (_FILTER_SIZES[name] if mode == "ATTRIBUTES" else (2, 4))
        or (mode != "ATTRIBUTES" and name != "NONE")
        or (mode == "TRIANGLES" and count % 3)
    ):
        found = f"buffer view {index} has {size} bytes, not possible with {count} x {stride} bytes of {mode} and {name}"
        raise damaged_file(document.path, found)
    try:
        if mode == "ATTRIBUTES":
            rows = library.decode_vertex_buffer(count, stride, stream, dtype=np.dtype((np.void, stride)))
            return _filtered(library, name, rows.view(np.uint8).reshape(count, stride)).tobytes()
        decode = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
        indices: bytes = decode(count, stride, stream).tobytes()
        return indices[:size]  # 16-bit indices fill half of the allocated bytes
    except (RuntimeError, ValueError) as error:
        raise damaged_file(document.path, f"buffer view {index} cannot be decoded ({error})") from error


def _stream(document: GltfDocument, index: int, packed: Json) -> bytes:
    """Return the compressed bytes of buffer view `index`."""
    if not has_bytes(document, packed):
        raise damaged_file(document.path, f"the compressed bytes of buffer view {index} reach beyond their buffer")
    start = packed.get("byteOffset", 0)
    return document.buffers[packed["buffer"]][start : start + packed["byteLength"]]


def _filtered(library: ModuleType, name: str, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the filter of decoded (count, stride) elements."""
    if name == "NONE":
        return rows
    if name == "COLOR":
        return _colors(rows)
    decode = {
        "OCTAHEDRAL": library.decode_filter_oct,
        "QUATERNION": library.decode_filter_quat,
        "EXPONENTIAL": library.decode_filter_exp,
    }[name]
    plain: NDArray[np.uint8] = decode(rows, *rows.shape)
    return plain


def _colors(rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the filter COLOR, which the package lacks: luma, two chromas and alpha of K bits become RGBA of all bits."""
    size = rows.shape[1] // 4
    luma, _, _, tagged_alpha = rows.view(f"<u{size}").astype(np.int64).T
    _, orange, green, _ = rows.view(f"<i{size}").astype(np.int64).T
    maximum = np.maximum(
        (1 << np.frexp(tagged_alpha)[1].astype(np.int64)) - 1, 1
    )  # of K bits; the highest bit of the stored alpha encodes K
    alpha = tagged_alpha & (maximum >> 1)
    colors = np.stack([luma + orange - green, luma + green, luma - orange - green, alpha << 1 | alpha & 1], axis=1)
    full = (1 << 8 * size) - 1
    plain = np.floor(colors * (full / maximum)[:, None] + 0.5).clip(0, full).astype(f"<u{size}")
    return np.ascontiguousarray(plain).view(np.uint8)
