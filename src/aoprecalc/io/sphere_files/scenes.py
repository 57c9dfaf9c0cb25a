"""What a sphere set is called where a format wants a name: as the file of its mesh is."""

import json
import re
from xml.etree import ElementTree

import numpy as np

from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import Json
from aoprecalc.io.formats.gltf.writer import glb
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.types import Float64Array, Int32Array, Scene, SphereSet


def printable(scene: Scene | None) -> str:
    """Return the stem of the scene's file; bytes that are no UTF-8 and control characters, which XML lacks, are _."""
    stem = scene.path.stem if scene is not None else ""
    return "".join(letter if letter.isprintable() else "_" for letter in stem) or "mesh"


def identifier(scene: Scene | None) -> str:
    """Return the same as an ASCII identifier: letters, digits and _, not a digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", printable(scene))
    return f"_{name}" if name[0].isdigit() else name


# The ball that stands for a sphere where a format has only triangles, and the colour of all of them.

COLOR = (0.9, 0.4, 0.1, 0.4)  # red, green, blue and opacity: the mesh shows through

_DIVISIONS = 3  # 1280 triangles; they lie at most 0.5% of the radius inside the sphere


def unit_ball() -> tuple[Float64Array, Int32Array]:
    """Return (points, triangles) of an icosphere around the origin, its points at distance 1.

    points      (642, 3) float64, which are its normals too
    triangles   (1280, 3) int32, counter-clockwise seen from outside
    """
    from trimesh.creation import icosphere  # takes half a second, which other formats should not pay

    ball = icosphere(subdivisions=_DIVISIONS)
    return np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int32)


# Sphere sets as GLB: the mesh, and one translucent ball that as many nodes as there are spheres place and scale.

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
    split = corners_to_vertices(scene.faces, *([] if scene.normals is None else [scene.normals]))
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


# Sphere sets as Wavefront OBJ: an icosphere for each sphere, for programs that know only triangles.


def spheres_obj(spheres: SphereSet) -> str:
    """Lay out an object `sphere_<number>` for each sphere, from 0; they share one set of normals.

    A sphere of radius 0 is an object too, all of whose triangles lie in its centre.
    """
    points, triangles = unit_ball()
    lines = ["vn {!r} {!r} {!r}".format(*row) for row in points.tolist()]
    for number, (center, radius) in enumerate(zip(spheres.centers, spheres.radii, strict=True)):
        lines.append(f"o sphere_{number}")
        lines += ["v {!r} {!r} {!r}".format(*row) for row in (center + radius * points).tolist()]
        first = 1 + number * len(points)
        lines += [f"f {a + first}//{a + 1} {b + first}//{b + 1} {c + first}//{c + 1}" for a, b, c in triangles.tolist()]
    return "\n".join(lines) + "\n"


# Sphere sets as the YAML in which cuRobo keeps the collision spheres of a robot's links.


def curobo_yaml(spheres: SphereSet, link: str) -> str:
    """Lay out all spheres as those of one link, of a printable name."""
    # Quoted, because a bare `12` or `no` is not a string in YAML; a printable JSON string in its own letters is YAML.
    lines = ["collision_spheres:", f"  {json.dumps(link, ensure_ascii=False)}:"]
    for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True):
        lines.append(f"    - center: [{', '.join(map(_number, center))}]")
        lines.append(f"      radius: {_number(radius)}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return the digits that give the same float64 back; 1e-07 with a point, without which YAML 1.1 takes a string."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")


# Sphere sets as URDF: a robot of one link that collides as the spheres do, and is seen as them.


def urdf_robot(spheres: SphereSet, name: str) -> str:
    """Lay out a robot and its link, both of the printable name, with a collision and a visual for each sphere.

    They are called `sphere_<number>`, from 0. Spheres of radius 0 are left out: they are no bodies, and trimesh, which
    Python readers of URDF build on, makes NaN of them.
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


# Sphere sets as USD text: sphere prims under one transform.

# glTF's and most meshes' y is up; what a unit of the mesh is in metres nobody knows, so that one is one.
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

# The extent has to be there: without it a sphere counts as one of radius 1 when boxes are computed.
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
    """Lay out a stage whose default prim has the given name, an identifier, and a sphere prim for each sphere."""
    prims = [
        _SPHERE.format(number=number, x=x, y=y, z=z, radius=radius, low=-radius)
        for number, ((x, y, z), radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True))
    ]
    return f"{_HEAD.format(name=name)}{''.join(prims)}}}\n"
