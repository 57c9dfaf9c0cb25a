"""Says what Blender reads from glTF documents with a baked occlusion texture.

    python blender_check.py out/car.glb [...]          (needs pip's bpy)

For each mesh: its UV layers, which image and UV layer are connected to the
"glTF Material Output" group's Occlusion, and whether the layer's corners are
those of the document, v turned over as Blender does. Exits with 1 if not.
"""

import json
import struct
import sys
from pathlib import Path

import bpy
import numpy as np

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_glb(path):
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def accessor(document, blob, number):
    a = document["accessors"][number]
    view = document["bufferViews"][a["bufferView"]]
    width, dtype = WIDTHS[a["type"]], np.dtype(TYPES[a["componentType"]])
    at = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    stride = view.get("byteStride", width * dtype.itemsize)
    return np.ndarray((a["count"], width), dtype, blob, at, (stride, dtype.itemsize))


def upstream(socket, kind):
    """Nodes of a kind from which the socket gets its value, nearest first."""
    found, todo = [], [socket]
    while todo:
        for link in todo.pop(0).links:
            if link.from_node.bl_idname == kind:
                found.append(link.from_node)
            todo += link.from_node.inputs
    return found


def occlusion(material):
    """(image, UV layer) of the material's occlusion, or (None, None)."""
    if not material or not material.node_tree:
        return None, None
    for node in material.node_tree.nodes:
        if node.bl_idname != "ShaderNodeGroup" or not node.node_tree:
            continue
        if not node.node_tree.name.startswith("glTF Material Output"):
            continue
        for texture in upstream(node.inputs["Occlusion"], "ShaderNodeTexImage"):
            maps = upstream(texture.inputs["Vector"], "ShaderNodeUVMap")
            # Without a UV Map node it is the layer that renders: the first.
            return texture.image, maps[0].uv_map if maps else "UVMap"
    return None, None


def check(path):
    document, blob = read_glb(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path.resolve()))
    good = True
    for mesh in bpy.data.meshes:
        definition = next(m for m in document["meshes"] if m["name"] == mesh.name)
        (primitive,) = definition["primitives"]  # one each in what is checked here
        material = document["materials"][primitive["material"]]
        wanted = material["occlusionTexture"]
        image, layer = occlusion(mesh.materials[0])
        expected = document["images"][document["textures"][wanted["index"]]["source"]].get("name")
        names = [each.name for each in mesh.uv_layers]

        # Each triangle's corners, in the document's order.
        order = accessor(document, blob, primitive["indices"])[:, 0].astype(int)
        number = wanted.get("texCoord", 0)
        uv = accessor(document, blob, primitive["attributes"][f"TEXCOORD_{number}"]).astype(float)
        uv = np.stack([uv[:, 0], 1 - uv[:, 1]], 1)[order]
        got = np.empty(len(mesh.loops) * 2, np.float32)
        mesh.uv_layers[number].data.foreach_get("uv", got)
        got = got.reshape(-1, 2)
        same_order = len(got) == len(uv)
        worst = np.abs(got - uv).max() if same_order else None
        if not same_order:  # Blender drops degenerate faces
            have = {tuple(r) for r in np.round(uv, 4)}
            worst = 0 if all(tuple(r) in have for r in np.round(got, 4)) else 1
        right = names[number] == layer and image is not None and image.name.split(".")[0] == expected and worst < 1e-5
        good &= right
        print(
            f"{path.name} {mesh.name}: layers {names}; occlusion of {material['name']}: "
            f"{image and image.name} {image and tuple(image.size)} "
            f"{image and image.colorspace_settings.name} by {layer}; texCoord {number}; "
            f"{len(got)} corners of {len(uv)}, worst difference {worst:.2g}"
            f"{'' if same_order else ' (as a set)'}; first {got[0].round(5).tolist()} "
            f"{uv[0].round(5).tolist()} -> {'right' if right else 'WRONG'}"
        )
    return good


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    print("Blender", bpy.app.version_string)
    results = [check(Path(name)) for name in sys.argv[1:]]
    sys.exit(not all(results))
