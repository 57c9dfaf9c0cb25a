"""EXT_meshopt_compression and KHR_meshopt_compression: buffer views whose bytes are in a stream of meshoptimizer.

As specified by Arseny Kapoulkine, Jasper St. Pierre and others for the Khronos Group; KHR adds another version of the
streams and the filter COLOR to what EXT has.
"""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.builder import damaged
from aoprecalc.io.formats.gltf.compression.plain_copy import PlainCopy, has_bytes, load_library, pop_extension
from aoprecalc.io.formats.gltf.document import GltfDocument, Json

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
PACKAGE = "meshoptimizer"

MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
# The sizes of an element that a filter can be used for.
FILTERS = {
    "NONE": range(4, 257, 4),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": range(4, 257, 4),
    "COLOR": (4, 8),
}


def decode_views(copy: PlainCopy) -> None:
    """Give compressed buffer views plain bytes; raises InputError where a stream does not hold what they describe."""
    for index, view in enumerate(copy.json.get("bufferViews", [])):
        for extension in MESHOPT:
            packed = pop_extension(view, extension)
            if packed is None or (copy.prefers_plain(extension, PACKAGE) and has_bytes(copy.source, view)):
                continue
            library = load_library(copy.source.path, extension, PACKAGE)
            copy.fill_view(index, _decoded(library, copy.source, index, view["byteLength"], packed))


def _decoded(library: ModuleType, document: GltfDocument, index: int, size: int, packed: Json) -> bytes:
    """Return the `size` bytes that buffer view `index` stands for."""
    stream = _stream(document, index, packed)
    mode, name = packed["mode"], packed.get("filter", "NONE")
    count, stride = packed["count"], packed["byteStride"]
    # The decoders trust these numbers.
    if mode not in MODES or name not in FILTERS:
        raise damaged(document.path, f"buffer view {index} is compressed by {mode!a} with {name!a}, which do not exist")
    if (
        count < 0
        or count * stride != size
        or stride not in (FILTERS[name] if mode == "ATTRIBUTES" else (2, 4))
        or (mode != "ATTRIBUTES" and name != "NONE")
        or (mode == "TRIANGLES" and count % 3)
    ):
        found = f"buffer view {index} has {size} bytes, not possible with {count} x {stride} bytes of {mode} and {name}"
        raise damaged(document.path, found)
    try:
        if mode == "ATTRIBUTES":
            rows = library.decode_vertex_buffer(count, stride, stream, dtype=np.dtype((np.void, stride)))
            return _filtered(library, name, rows.view(np.uint8).reshape(count, stride)).tobytes()
        decode = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
        indices: bytes = decode(count, stride, stream).tobytes()
        return indices[:size]  # those of 16 bits fill half of what it makes room for
    except (RuntimeError, ValueError) as error:
        raise damaged(document.path, f"buffer view {index} cannot be decoded ({error})") from error


def _stream(document: GltfDocument, index: int, packed: Json) -> bytes:
    """Return the compressed bytes of buffer view `index`."""
    if not has_bytes(document, packed):
        raise damaged(document.path, f"the compressed bytes of buffer view {index} reach beyond their buffer")
    start = packed.get("byteOffset", 0)
    return document.buffers[packed["buffer"]][start : start + packed["byteLength"]]


def _filtered(library: ModuleType, name: str, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return decoded (count, stride) elements with a filter undone."""
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
    """Undo the filter COLOR, which the package lacks: luma, two chromas and alpha in K bits become RGBA in all bits."""
    size = rows.shape[1] // 4
    luma, _, _, marked = rows.view(f"<u{size}").astype(np.int64).T
    _, orange, green, _ = rows.view(f"<i{size}").astype(np.int64).T
    greatest = np.maximum((1 << np.frexp(marked)[1].astype(np.int64)) - 1, 1)  # of K bits; alpha's highest bit tells K
    alpha = marked & (greatest >> 1)
    colors = np.stack([luma + orange - green, luma + green, luma - orange - green, alpha << 1 | alpha & 1], axis=1)
    full = (1 << 8 * size) - 1
    plain = np.floor(colors * (full / greatest)[:, None] + 0.5).clip(0, full).astype(f"<u{size}")
    return np.ascontiguousarray(plain).view(np.uint8)
