"""What is in a Draco stream, as the package DracoPy tells it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.damage import damaged
from aoprecalc.files.gltf.accessors import view_bytes
from aoprecalc.files.gltf.compression.library import load_library
from aoprecalc.files.gltf.document import GltfDocument

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
