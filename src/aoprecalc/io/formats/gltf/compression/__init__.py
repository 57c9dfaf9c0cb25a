"""Compressed glTF, decoded at the door: whatever comes after it sees plain accessors and buffer views only."""

from aoprecalc.io.formats.gltf.compression.draco import DRACO, decode_primitives
from aoprecalc.io.formats.gltf.compression.meshopt import MESHOPT, decode_views
from aoprecalc.io.formats.gltf.compression.plain_copy import PlainCopy
from aoprecalc.io.formats.gltf.document import GltfDocument, Json

__all__ = ["EXTENSIONS", "decompressed"]

EXTENSIONS = (DRACO, *MESHOPT)


def decompressed(document: GltfDocument) -> GltfDocument:
    """Return the document without the extensions that compress meshes; the same one where it uses none.

    What is only there in compressed form is decoded into one more buffer, at the end of the list: accessors keep their
    type and count, buffer views their length and stride, `min` and `max` are those of the decoded numbers. Where plain
    data stand beside compressed ones that are not required, the plain ones are kept, so that the result does not depend
    on what is installed.

    Raises InputError where a stream is damaged or does not hold what its accessors announce, or where the package that
    decodes it is missing and there are no plain data.
    """
    if _extensions(document.json).isdisjoint(EXTENSIONS):
        return document
    copy = PlainCopy(document)
    decode_views(copy)
    decode_primitives(copy)
    return copy.finished(without=EXTENSIONS)


def _extensions(json: Json) -> set[str]:
    """Return the names of all extensions that are listed, or used where these may be."""
    primitives = [primitive for mesh in json.get("meshes", []) for primitive in mesh.get("primitives", [])]
    used = {name for entry in (*json.get("bufferViews", []), *primitives) for name in entry.get("extensions", {})}
    return used.union(json.get("extensionsUsed", []), json.get("extensionsRequired", []))
