"""What a glTF file holds, its numbers followed to what they stand for; read apart from the code under test."""

import base64
import json
import struct
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import numpy as np

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6
VARIANTS = "KHR_materials_variants"


class GltfValues:
    """A document's `json`, and what its numbers stand for."""

    def __init__(self, path: Path):
        self.path = path
        data = path.read_bytes()
        self._binary = b""
        if path.suffix == ".glb":
            length = struct.unpack_from("<I", data, 12)[0]
            self._binary, data = data[28 + length :], data[20 : 20 + length]
        self.json = json.loads(data)
        self.array = cache(self.array)
        self.bytes_at = cache(self.bytes_at)

    def bytes_at(self, uri):
        if uri is None:
            return self._binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (self.path.parent / unquote(uri)).read_bytes()

    def array(self, index):
        """(count, width) elements of an accessor, in their own type."""
        accessor = self.json["accessors"][index]
        kind, width = np.dtype(COMPONENTS[accessor["componentType"]]), WIDTHS[accessor["type"]]
        values = np.zeros((accessor["count"], width), kind)
        if "bufferView" in accessor:
            values = self._elements(accessor, accessor["count"], kind, width)
        if "sparse" in accessor:
            count, places, changes = (accessor["sparse"][key] for key in ("count", "indices", "values"))
            at = self._elements(places, count, np.dtype(COMPONENTS[places["componentType"]]), 1)[:, 0]
            values[at] = self._elements(changes, count, kind, width)
        return values

    def _elements(self, reference, count, kind, width):
        view = self.json["bufferViews"][reference["bufferView"]]
        start = view.get("byteOffset", 0) + reference.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        data = self.bytes_at(self.json["buffers"][view["buffer"]].get("uri"))
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize)).copy()

    def image(self, index):
        """(bytes of the file, what else is said about it)."""
        image = self.json["images"][index]
        said = {key: value for key, value in image.items() if key not in ("uri", "bufferView", "mimeType")}
        if "bufferView" not in image:
            return self.bytes_at(image["uri"]), said
        view = self.json["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        data = self.bytes_at(self.json["buffers"][view["buffer"]].get("uri"))
        return data[start : start + view["byteLength"]], said

    def texture(self, index):
        """A texture with its image and sampler in place of their numbers."""
        texture = dict(self.json["textures"][index])
        if "sampler" in texture:
            texture["sampler"] = self.json["samplers"][texture["sampler"]]
        if "source" in texture:
            texture["source"] = self.image(texture["source"])
        return texture

    def followed(self, value):
        """A part of a material with textures in place of their numbers."""
        if not isinstance(value, dict):
            return value
        members = {key: self.followed(member) for key, member in value.items()}
        return members | {"index": self.texture(value["index"])} if "index" in value else members

    def material(self, holder):
        """The material that a primitive or a variant's mapping names; one without any is the default, {}."""
        return self.json["materials"][holder["material"]] if "material" in holder else {}

    def corners(self, primitive):
        """(3 f,) the vertices at the corners of a primitive's triangles; those of strips repeat none."""
        count = self.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
        run = self.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(count)
        mode = primitive.get("mode", TRIANGLES)
        if mode == TRIANGLES:
            return run
        if mode == FAN:
            return np.stack([run[:1].repeat(len(run) - 2), run[1:-1], run[2:]], axis=1).reshape(-1)
        triangles = np.stack([run[:-2], run[1:-1], run[2:]], axis=1)
        triangles[1::2] = triangles[1::2][:, [1, 0, 2]]
        return triangles[[len(set(triangle)) == 3 for triangle in triangles.tolist()]].reshape(-1)


def holders(primitive):
    """What names a material: the primitive itself and the mappings of its variants."""
    return [primitive, *primitive.get("extensions", {}).get(VARIANTS, {}).get("mappings", [])]


def is_surface(primitive):
    return primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN)
