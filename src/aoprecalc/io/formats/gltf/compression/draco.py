"""What is in a Draco stream, as the package DracoPy tells it."""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.builder import damaged
from aoprecalc.io.formats.gltf.accessors import ARRAY, COMPONENTS, ELEMENT_ARRAY, UINT, WIDTHS, view_bytes
from aoprecalc.io.formats.gltf.compression.plain_copy import PlainCopy, has_bytes, load_library, pop_extension
from aoprecalc.io.formats.gltf.document import GltfDocument, Json

DRACO = "KHR_draco_mesh_compression"
DRACO_PACKAGE = "DracoPy"

_MAGIC, _KIND, _MESH = b"DRACO", 7, 1  # how a stream begins; where it says what it holds; a mesh
_WITH_FRACTIONS = (9, 10)  # Draco's numbers for float32 and float64


@dataclass(frozen=True, eq=False)
class DracoNumbers:
    """The numbers of an attribute or of the faces.

    values       (n, width): uint8 or uint32, or float32 for numbers with fractions and, oddly, for signed integers
    is_integer   they are integers in the stream; then float32 may hold them divided by the greatest of their type
    """

    values: NDArray[Any]
    is_integer: bool


@dataclass(frozen=True, eq=False)
class DracoStream:
    """A decoded mesh.

    corners      (3 f, 1) uint32: the vertices of its triangles
    attributes   by their unique ids
    """

    corners: DracoNumbers
    attributes: dict[int, DracoNumbers]


def read_stream(document: GltfDocument, view: int) -> DracoStream:
    """Decode the stream in a buffer view; raises InputError where it is damaged or DracoPy is not installed."""
    library = load_library(document.path, DRACO, DRACO_PACKAGE)
    data = view_bytes(document, view)
    # Draco bounds a mesh's counts by its bytes, but makes room for as many points as a damaged point cloud promises.
    if not data.startswith(_MAGIC) or data[_KIND : _KIND + 1] != bytes([_MESH]):
        raise damaged(document.path, f"a Draco mesh was expected, but buffer view {view} begins {data[:8]!a}")
    try:
        mesh = library.decode(data)
    except MemoryError:
        raise
    except Exception as error:  # it has a class for each way to fail, and no common one
        raise damaged(document.path, f"the Draco mesh in buffer view {view} cannot be decoded") from error

    corners = mesh.faces if hasattr(mesh, "faces") else np.empty(0, np.uint32)  # one of no faces comes as a point cloud
    attributes = {
        entry["unique_id"]: DracoNumbers(entry["data"], entry["data_type"] not in _WITH_FRACTIONS)
        for entry in mesh.attributes
        if entry["data"] is not None
    }
    return DracoStream(DracoNumbers(corners.reshape(-1, 1), True), attributes)


# KHR_draco_mesh_compression: primitives whose attributes and triangles are in a Draco stream.
#
# As specified by Fan Zhang, Ondrej Stava, Frank Galligan, Kai Ninomiya and Patrick Cozzi for the Khronos Group.

STRIP = 5


def decode_primitives(copy: PlainCopy) -> None:
    """Give compressed primitives plain accessors; raises InputError where a stream does not hold what they describe."""
    decoder = _Decoder(copy)
    for primitive in chain.from_iterable(mesh.get("primitives", []) for mesh in copy.json.get("meshes", [])):
        packed = pop_extension(primitive, DRACO)
        if packed is not None and not _is_plain(copy, primitive, packed):
            decoder.decode(primitive, packed)


def _is_plain(copy: PlainCopy, primitive: Json, packed: Json) -> bool:
    """Tell whether everything that is compressed is there in plain form too, and to be preferred."""
    document, attributes = copy.source, primitive["attributes"]
    used = [attributes[name] for name in packed["attributes"] if name in attributes]
    used += [primitive["indices"]] if "indices" in primitive else []
    views = [document.entry("accessors", index).get("bufferView") for index in used]
    return copy.prefers_plain(DRACO, DRACO_PACKAGE) and all(
        view is not None and has_bytes(document, document.entry("bufferViews", view)) for view in views
    )


class _Decoder:
    """Decodes primitives one after another, and what they share only once."""

    def __init__(self, copy: PlainCopy) -> None:
        self._copy = copy
        self._streams: dict[int, DracoStream] = {}  # by buffer view
        self._accessors: dict[tuple[int | None, int, int | None], int] = {}  # by what `_accessor` is asked for

    def decode(self, primitive: Json, packed: Json) -> None:
        """Let a primitive's attributes and indices refer to accessors of decoded numbers."""
        view, ids, attributes = packed["bufferView"], packed["attributes"], primitive["attributes"]
        for name, described in attributes.items():
            if name in ids:
                attributes[name] = self._accessor(described, view, ids[name])
        if primitive.get("mode") == STRIP:  # Draco lists triangles, and the accessor of a strip describes no list
            del primitive["mode"]
            primitive.pop("indices", None)
        primitive["indices"] = self._accessor(primitive.get("indices"), view, None)

    def _accessor(self, described: int | None, view: int, unique_id: int | None) -> int:
        """Return the number of an accessor of decoded numbers.

        described   the accessor that says how many there are, and of what type; None if none does
        view        the buffer view of the stream
        unique_id   of the stream's attribute; None for the vertices of its triangles
        """
        key = described, view, unique_id
        if key not in self._accessors:
            self._accessors[key] = self._decoded(*key)
        return self._accessors[key]

    def _decoded(self, described: int | None, view: int, unique_id: int | None) -> int:
        source, place = self._copy.source, None
        if view not in self._streams:
            self._streams[view] = read_stream(source, view)
            self._copy.json["bufferViews"][view].clear()
            place = view  # which nothing refers to any more
        stream = self._streams[view]
        numbers = stream.corners if unique_id is None else stream.attributes.get(unique_id)
        if numbers is None:
            found = f"attribute {unique_id} was expected, but the Draco mesh in buffer view {view} does not have it"
            raise damaged(source.path, found)

        if described is None:
            accessor: Json = {"componentType": UINT, "type": "SCALAR", "count": len(numbers.values)}
        else:
            accessor = dict(source.entry("accessors", described))
        values = _as_described(source.path, f"accessor {described}", accessor, numbers)
        if unique_id is None:
            place = self._copy.fill_view(place, values.tobytes(), target=ELEMENT_ARRAY)
        else:
            rows = values.view(np.uint8)
            padded = np.pad(rows, ((0, 0), (0, -rows.shape[1] % 4)))  # each vertex begins at a multiple of 4
            stride = {} if padded.shape == rows.shape else {"byteStride": padded.shape[1]}
            place = self._copy.fill_view(place, padded.tobytes(), **stride, target=ARRAY)
        kept = {member: value for member, value in accessor.items() if member not in ("byteOffset", "sparse")}
        return self._copy.fill_accessor(described, kept | {"bufferView": place})


def _as_described(path: Path, name: str, accessor: Json, numbers: DracoNumbers) -> NDArray[Any]:
    """Return the (count, width) numbers in the type of an accessor; raises InputError where they are others."""
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    values, expected = numbers.values, (accessor["count"], WIDTHS[accessor["type"]])
    if values.shape != expected:
        found = f"{name} describes {expected[0]} elements of {expected[1]} numbers, its Draco mesh has {values.shape}"
        raise damaged(path, found)
    if kind.kind == "f":
        fits = not numbers.is_integer
    else:
        if values.dtype.kind == "f":
            is_fraction = accessor.get("normalized") and np.abs(values).max(initial=0) <= 1
            values = np.rint(values * np.iinfo(kind).max if is_fraction else values)
        limits = np.iinfo(kind)
        fits = numbers.is_integer and values.min(initial=0) >= limits.min and values.max(initial=0) <= limits.max
    if not fits:
        raise damaged(path, f"{name} describes numbers of type {kind.name}, its Draco mesh has others")
    return values.astype(kind)
