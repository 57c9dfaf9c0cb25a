"""Builds glTF documents in code, number by number: what a reader is given, and a writer gives back."""

import base64
import io
import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from aoprecalc.io import load_scene

ARRAY, ELEMENT_ARRAY = 34962, 34963
CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def data_uri(data: bytes, kind: str) -> str:
    return f"data:{kind};base64," + base64.b64encode(data).decode()


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


def textured_triangle(**others):
    """A glTF document of one triangle whose material shows image 0, with other members."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "color.png"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": data_uri(TRIANGLE, "application/octet-stream")}],
        **others,
    }


def png(pixels) -> bytes:
    """The (h, w), (h, w, 3) or (h, w, 4) bytes as a PNG."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "png")
    return file.getvalue()


class GltfMaker:
    """Builds a glTF document, one accessor after another."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.data = bytearray()
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": []}
        self.further_buffers = []

    def add(self, kind: str, entry: dict) -> int:
        """Append an entry to one of the document's arrays; its number."""
        self.json.setdefault(kind, []).append(entry)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **members) -> int:
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **members}
        self.data += data
        return self.add("bufferViews", view)

    def accessor(self, array, **members) -> int:
        array = np.asarray(array)
        width = 1 if array.ndim == 1 else array.shape[1]
        entry = {"componentType": CODES[array.dtype.str[1:]], "count": len(array), "type": TYPES[width]}
        if "bufferView" not in members and "sparse" not in members:
            members["bufferView"] = self.view(array.tobytes())
        return self.add("accessors", entry | members)

    def vertices(self, array, bounds=False, **members) -> int:
        """An accessor of vertex data, laid out as GPUs want it: rows of whole words, in a view that says what it is."""
        array = np.asarray(array)
        rows = array.reshape(len(array), -1)
        padded = np.pad(rows.view(np.uint8), ((0, 0), (0, -rows[:1].nbytes % 4)))
        stride = {} if padded.nbytes == rows.nbytes else {"byteStride": padded.shape[1]}
        if bounds:
            members |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.accessor(array, bufferView=self.view(padded.tobytes(), **stride, target=ARRAY), **members)

    def indices(self, array) -> int:
        array = np.asarray(array).reshape(-1)
        return self.accessor(array, bufferView=self.view(array.tobytes(), target=ELEMENT_ARRAY))

    def sparse(self, array, base, **members) -> int:
        """An accessor of vertex data that says only where `array` differs from `base`; None: from zeros."""
        array = np.asarray(array)
        changed = np.flatnonzero((array != (np.zeros_like(array) if base is None else base)).any(axis=1)).astype("<u2")
        sparse = {
            "count": len(changed),
            "indices": {"bufferView": self.view(changed.tobytes()), "componentType": CODES["u2"]},
            "values": {"bufferView": self.view(array[changed].tobytes())},
        }
        if base is not None:
            members["bufferView"] = self.view(np.asarray(base, array.dtype).tobytes(), target=ARRAY)
        return self.accessor(array, sparse=sparse, min=array.min(0).tolist(), max=array.max(0).tolist(), **members)

    def texture(self, pixels, place="view", sampler=None) -> int:
        """A texture whose PNG is in a `view`, in a `data` URI, or in a file of any other name beside the document."""
        data = png(pixels)
        if place == "view":
            image = {"bufferView": self.view(data), "mimeType": "image/png", "name": "inside"}
        elif place == "data":
            image = {"uri": data_uri(data, "image/png")}
        else:
            (self.folder / place).write_bytes(data)
            image = {"uri": place}
        entry = {"source": self.add("images", image)}
        return self.add("textures", entry if sampler is None else entry | {"sampler": self.add("samplers", sampler)})

    def mesh(self, *primitives, **members) -> int:
        return self.add("meshes", {"primitives": list(primitives), **members})

    def node(self, **members) -> int:
        return self.add("nodes", members)

    def save(self, name="made.glb", binary=None) -> Path:
        """Write the document; a .gltf has its buffer in a file of the name `binary`, or else in a data URI."""
        path = self.folder / name
        if "scenes" not in self.json:
            children = {child for node in self.json["nodes"] for child in node.get("children", [])}
            roots = [index for index in range(len(self.json["nodes"])) if index not in children]
            self.json |= {"scene": 0, "scenes": [{"nodes": roots}]}
        self.json["buffers"] = [{"byteLength": len(self.data)}, *self.further_buffers]
        if name.endswith(".gltf"):
            self.json["buffers"][0]["uri"] = binary or data_uri(self.data, "application/octet-stream")
            if binary:
                (self.folder / binary).write_bytes(self.data)
            path.write_text(json.dumps(self.json))
            return path
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + bytes(-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
        return path

    def load(self, name="made.glb"):
        return load_scene(self.save(name))
