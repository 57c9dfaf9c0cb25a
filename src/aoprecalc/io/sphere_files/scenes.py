"""Sphere sets as scenes: GLB and OBJ with icospheres, YAML of cuRobo, URDF and USDA with sphere primitives."""

import json
import re
from xml.etree import ElementTree

import numpy as np

from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import Json
from aoprecalc.io.formats.gltf.writer import glb
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.types import Float64Array, Int32Array, Scene, SphereSet


def printable_name(scene: Scene | None) -> str:
    """Return the stem of the scene's file, with _ for invalid UTF-8 and for control characters, which XML lacks."""
    stem = scene.path.stem if scene is not None else ""
    return "".join(letter if letter.isprintable() else "_" for letter in stem) or "mesh"


def identifier(scene: Scene | None) -> str:
    """Return the stem of the scene's file as an ASCII identifier: letters, digits and _, no digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", printable_name(scene))
    return f"_{name}" if name[0].isdigit() else name


COLOR = (0.9, 0.4, 0.1, 0.4)  # red, green, blue and opacity: the mesh shows through
_SUBDIVISIONS = 3  # 1280 triangles; they lie at most 0.5% of the radius inside the sphere


def unit_icosphere() -> tuple[Float64Array, Int32Array]:
    """Return (points, triangles) of an icosphere of radius 1 around the origin.

    points      (642, 3) float64, which are its normals too
    triangles   (1280, 3) int32, counter-clockwise seen from outside
    """
    from trimesh.creation import icosphere  # takes half a second, which other formats should not pay

    ball = icosphere(subdivisions=_SUBDIVISIONS)
    return np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int32)


# GLB: the mesh, and one translucent icosphere that a node for each sphere moves and scales.

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
    """Return a GLB with a node for the scene's mesh, if there is one, and a node `sphere_<n>` for each sphere, from 0.

    The mesh has one colour; its positions are rounded to float32. The nodes of spheres are in float64.
    Raises ValueError where a position of the mesh is beyond float32.
    """
    document: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0}
    document |= {"scenes": [], "nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(document)
    if scene is not None:
        name = printable_name(scene)
        document["nodes"].append({"name": name, "mesh": _add(document, name, _surface(buffer, scene), _MESH)})
    ball = _add(document, "sphere", _icosphere(buffer), _TRANSLUCENT)
    document["nodes"] += [
        {"name": f"sphere_{number}", "mesh": ball, "translation": center, "scale": [radius] * 3}
        for number, (center, radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True))
    ]
    document["scenes"].append({"nodes": list(range(len(document["nodes"])))})
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    return glb(json.dumps(document, separators=(",", ":"), allow_nan=False).encode(), buffer.data)


def _add(document: Json, name: str, primitive: Json, material: Json) -> int:
    """Add a mesh of one primitive and its material; return the index of the mesh."""
    document["materials"].append(material)
    primitive["material"] = len(document["materials"]) - 1
    document["meshes"].append({"name": name, "primitives": [primitive]})
    return len(document["meshes"]) - 1


def _surface(buffer: GltfBuffer, scene: Scene) -> Json:
    """Return the primitive of a scene with the file's normals; without normals viewers shade each face flat."""
    split = corners_to_vertices(scene.faces, *([] if scene.normals is None else [scene.normals]))
    with np.errstate(over="ignore"):
        positions = scene.positions[scene.faces.reshape(-1)[split.corner]].astype(np.float32)
    if not np.isfinite(positions).all():
        raise ValueError("a position is beyond float32")
    attributes = {"POSITION": buffer.add_floats(positions, bounded=True)}
    if scene.normals is not None:
        attributes["NORMAL"] = buffer.add_floats(scene.normals.reshape(-1, 3)[split.corner])
    return {"attributes": attributes, "indices": buffer.add_triangles(split.triangles)}


def _icosphere(buffer: GltfBuffer) -> Json:
    """Return the primitive of the unit icosphere, whose points are their own normals."""
    points, triangles = unit_icosphere()
    accessor = buffer.add_floats(points, bounded=True)
    return {"attributes": {"POSITION": accessor, "NORMAL": accessor}, "indices": buffer.add_triangles(triangles)}


def spheres_obj(spheres: SphereSet) -> str:
    """Return an OBJ with an icosphere `sphere_<n>` for each sphere, from 0; they share one set of normals.

    A sphere of radius 0 is an object too: all its triangles are degenerate.
    """
    points, triangles = unit_icosphere()
    lines = ["vn {!r} {!r} {!r}".format(*row) for row in points.tolist()]
    for number, (center, radius) in enumerate(zip(spheres.centers, spheres.radii, strict=True)):
        lines.append(f"o sphere_{number}")
        lines += ["v {!r} {!r} {!r}".format(*row) for row in (center + radius * points).tolist()]
        first = 1 + number * len(points)
        lines += [f"f {a + first}//{a + 1} {b + first}//{b + 1} {c + first}//{c + 1}" for a, b, c in triangles.tolist()]
    return "\n".join(lines) + "\n"


def curobo_yaml(spheres: SphereSet, link: str) -> str:
    """Return the YAML of cuRobo's collision spheres: all spheres belong to one link of the given name."""
    # Quoted, because a bare `12` or `no` is no string in YAML; a printable JSON string is a YAML string.
    lines = ["collision_spheres:", f"  {json.dumps(link, ensure_ascii=False)}:"]
    for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True):
        lines.append(f"    - center: [{', '.join(map(_number, center))}]")
        lines.append(f"      radius: {_number(radius)}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return the shortest digits of a float64; 1e-07 gets a point, without which YAML 1.1 reads it as a string."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")


def urdf_robot(spheres: SphereSet, name: str) -> str:
    """Return a URDF robot with one link, both of the given name; `sphere_<n>`, from 0, are its collisions and visuals.

    Spheres of radius 0 are left out: trimesh, on which Python readers of URDF build, turns them into NaN.
    """
    robot = ElementTree.Element("robot", name=name)
    material = ElementTree.SubElement(robot, "material", name="spheres")
    ElementTree.SubElement(material, "color", rgba=_numbers(*COLOR))
    link = ElementTree.SubElement(robot, "link", name=name)
    for kind in ("collision", "visual"):
        for number in np.flatnonzero(spheres.radii).tolist():
            center, radius = spheres.centers[number].tolist(), float(spheres.radii[number])
            element = ElementTree.SubElement(link, kind, name=f"sphere_{number}")
            ElementTree.SubElement(element, "origin", xyz=_numbers(*center), rpy="0 0 0")
            geometry = ElementTree.SubElement(element, "geometry")
            ElementTree.SubElement(geometry, "sphere", radius=_numbers(radius))
            if kind == "visual":
                ElementTree.SubElement(element, "material", name="spheres")
    ElementTree.indent(robot)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _numbers(*values: float) -> str:
    return " ".join(map(repr, values))


# USDA: sphere prims under one transform. Most meshes have y up, as glTF; their unit is unknown and taken as a metre.
_HEAD = """\
#usda 1.0
(
    defaultPrim = "{name}"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "{name}"
{{
"""

# The extent is required: without it bounding boxes are those of a sphere of radius 1.
_SPHERE = """\
    def Sphere "sphere_{number}"
    {{
        float3[] extent = [({low!r}, {low!r}, {low!r}), ({radius!r}, {radius!r}, {radius!r})]
        double radius = {radius!r}
        double3 xformOp:translate = ({x!r}, {y!r}, {z!r})
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
"""


def usda_stage(spheres: SphereSet, name: str) -> str:
    """Return a USDA stage whose default prim has the given name, an identifier, with a Sphere prim for each sphere."""
    prims = [
        _SPHERE.format(number=number, x=x, y=y, z=z, radius=radius, low=-radius)
        for number, ((x, y, z), radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True))
    ]
    return f"{_HEAD.format(name=name)}{''.join(prims)}}}\n"
