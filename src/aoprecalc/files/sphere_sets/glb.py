"""Sphere sets as GLB: the mesh, and one translucent ball that as many nodes as there are spheres place and scale."""

import json

import numpy as np

from aoprecalc.files.corners import split_corners
from aoprecalc.files.gltf.buffer import GltfBuffer
from aoprecalc.files.gltf.document import Json
from aoprecalc.files.gltf.writer import glb
from aoprecalc.files.sphere_sets.ball import COLOR, unit_ball
from aoprecalc.files.sphere_sets.names import printable
from aoprecalc.model import Scene, SphereSet

_MESH: Json = {
    "name": "mesh",
    "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
}
_TRANSLUCENT: Json = {
    "name": "spheres",
    "alphaMode": "BLEND",
    "pbrMetallicRoughness": {"baseColorFactor": list(COLOR), "metallicFactor": 0.0, "roughnessFactor": 1.0},
}


def spheres_glb(spheres: SphereSet, scene: Scene | None) -> bytes:
    """Lay out a node `sphere_<number>` for each sphere, from 0, after that of the scene's mesh, where there is one.

    The mesh is one piece in one colour, its positions rounded to float32; spheres are placed in float64.
    Raises ValueError where a position of the mesh is beyond float32.
    """
    document: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0}
    document |= {"scenes": [], "nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(document)
    if scene is not None:
        name = printable(scene)
        document["nodes"].append({"name": name, "mesh": _add(document, name, _surface(buffer, scene), _MESH)})
    ball = _add(document, "sphere", _ball(buffer), _TRANSLUCENT)
    document["nodes"] += [
        {"name": f"sphere_{number}", "mesh": ball, "translation": center, "scale": [radius] * 3}
        for number, (center, radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True))
    ]
    document["scenes"].append({"nodes": list(range(len(document["nodes"])))})
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    return glb(json.dumps(document, separators=(",", ":"), allow_nan=False).encode(), buffer.data)


def _add(document: Json, name: str, primitive: Json, material: Json) -> int:
    """Add a mesh of one primitive with a material of its own; return its number."""
    document["materials"].append(material)
    primitive["material"] = len(document["materials"]) - 1
    document["meshes"].append({"name": name, "primitives": [primitive]})
    return len(document["meshes"]) - 1


def _surface(buffer: GltfBuffer, scene: Scene) -> Json:
    """Return the primitive of a scene; it has the file's normals, without which viewers shade each face flat."""
    split = split_corners(scene.faces, *([] if scene.normals is None else [scene.normals]))
    with np.errstate(over="ignore"):
        positions = scene.positions[scene.faces.reshape(-1)[split.corner]].astype(np.float32)
    if not np.isfinite(positions).all():
        raise ValueError("a position is beyond float32")
    attributes = {"POSITION": buffer.add_floats(positions, bounded=True)}
    if scene.normals is not None:
        attributes["NORMAL"] = buffer.add_floats(scene.normals.reshape(-1, 3)[split.corner])
    return {"attributes": attributes, "indices": buffer.add_triangles(split.triangles)}


def _ball(buffer: GltfBuffer) -> Json:
    """Return the primitive of a ball of radius 1, whose points are their own normals."""
    points, triangles = unit_ball()
    accessor = buffer.add_floats(points, bounded=True)
    return {"attributes": {"POSITION": accessor, "NORMAL": accessor}, "indices": buffer.add_triangles(triangles)}
