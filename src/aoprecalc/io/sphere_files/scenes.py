"""Sphere sets as scenes: GLB and OBJ with icospheres, URDF and USDA with sphere primitives."""

import json
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from aoprecalc.errors import InputError, counted
from aoprecalc.io.formats.gltf.document import Json
from aoprecalc.io.formats.gltf.references import GltfBuffer
from aoprecalc.io.formats.gltf.writer import glb
from aoprecalc.io.meshes import load_scene
from aoprecalc.io.sphere_files.tables import read_file
from aoprecalc.mesh.surface import local_origin
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

    The mesh has one colour; its positions are rounded to float32, if they are far away about a local origin that its
    node moves there. The nodes of spheres are in float64.
    Raises ValueError where a position of the mesh is beyond float32.
    """
    document: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0}
    document |= {"scenes": [], "nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(document)
    if scene is not None:
        name = printable_name(scene)
        origin = local_origin(scene.positions)
        node = {"name": name, "mesh": _add(document, name, _surface(buffer, scene, origin), _MESH)}
        document["nodes"].append(node | ({"translation": origin.tolist()} if origin.any() else {}))
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


def _surface(buffer: GltfBuffer, scene: Scene, origin: Float64Array) -> Json:
    """Return the primitive of a scene about an origin, with the file's normals; without, viewers shade faces flat."""
    split = corners_to_vertices(scene.faces, *([] if scene.normals is None else [scene.normals]))
    with np.errstate(over="ignore"):
        positions = (scene.positions[scene.faces.reshape(-1)[split.corner]] - origin).astype(np.float32)
    if not np.isfinite(positions).all():
        raise ValueError("a position is beyond float32")
    attributes = {"POSITION": buffer.add_floats(positions, bounded=True)}
    if scene.normals is not None:
        attributes["NORMAL"] = buffer.add_floats(scene.normals.reshape(-1, 3)[split.corner])
    return {"attributes": attributes, "indices": buffer.add_indices(split.triangles)}


def _icosphere(buffer: GltfBuffer) -> Json:
    """Return the primitive of the unit icosphere, whose points are their own normals."""
    points, triangles = unit_icosphere()
    accessor = buffer.add_floats(points, bounded=True)
    return {"attributes": {"POSITION": accessor, "NORMAL": accessor}, "indices": buffer.add_indices(triangles)}


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


_BALL_TOLERANCE = 0.01  # of the radius, by which the points of an object may lie off the sphere
_MIN_FACE_DISTANCE = 0.75  # of the centres of its triangles, over the radius; 0.64 for a cube, 0.79 for an icosahedron
_MIN_EXTENT = 1.6  # of its bounding box, over the radius: no dome


def read_balls(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64 from the objects of an OBJ or GLB that are tessellated spheres.

    In files as `spheres_obj` and `spheres_glb` write them these are the objects `sphere_<n>`, in their order; in others
    all objects that are spheres, in the file's order. Other objects are left out.
    Raises InputError where the file is missing or damaged, or no object is a sphere.
    """
    scene = load_scene(path)
    ours = {
        int(found[1]): part
        for part in scene.parts
        if (found := re.fullmatch(r"sphere_(\d{1,9})", part.name)) and (scene.format == "obj" or "sphere" in part.names)
    }
    parts = [ours[number] for number in sorted(ours)] or scene.parts
    balls = [ball for part in parts if (ball := _ball(scene.positions[scene.faces[part.faces]])) is not None]
    if not balls:
        objects = counted(len(scene.parts), "object")
        raise InputError(f"{path}: {objects} found, but no sphere; expected an object for each sphere, of triangles")
    return np.array([center for center, _ in balls]), np.array([radius for _, radius in balls])


def _ball(corners: Float64Array) -> tuple[Float64Array, float] | None:
    """Return the (center, radius) of the sphere that (f, 3, 3) triangles approximate; None if they do not."""
    points = corners.reshape(-1, 3)
    origin = points.mean(axis=0)
    extent = np.ptp(points, axis=0)
    scale = float(extent.max())
    if scale == 0:
        return origin, 0.0
    local = (points - origin) / scale
    # |p|^2 = 2 c.p + (r^2 - |c|^2) for every point p of the sphere, in the least-squares sense
    terms = np.column_stack([2 * local, np.ones(len(local))])
    (*middle, rest), _, rank, _ = np.linalg.lstsq(terms, (local**2).sum(axis=1))
    if rank < terms.shape[1] or rest + np.dot(middle, middle) <= 0:
        return None
    center, radius = np.array(middle), float(np.sqrt(rest + np.dot(middle, middle)))
    off = np.abs(np.linalg.norm(local - center, axis=1) - radius).max()
    faces = np.linalg.norm(local.reshape(-1, 3, 3).mean(axis=1) - center, axis=1)
    if off > _BALL_TOLERANCE * radius or faces.min() < _MIN_FACE_DISTANCE * radius:
        return None
    return None if extent.min() / scale < _MIN_EXTENT * radius else (origin + scale * center, scale * radius)


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


def read_urdf(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked: the sphere collisions of all links, in the robot's coordinates.

    The links are where the origins of their joints put them, each joint at position zero. Collisions of other shapes
    are left out. Raises InputError where the file is missing or damaged.
    """
    data = read_file(path)
    try:
        text = data.decode("utf-8-sig")
        if "\0" in text:
            raise ValueError("it is not UTF-8")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("it declares a document type or entities, which are not read")
        robot = ElementTree.fromstring(text)
        if robot.tag != "robot":
            raise ValueError(f"its root is {robot.tag[:40]!a}, robot was expected")
        joints = {child.get("link", ""): joint for joint in robot.iter("joint") for child in joint.findall("child")}
        rows = [row for link in robot.findall("link") for row in _link_spheres(link, _link_frame(link, joints))]
    except (ElementTree.ParseError, ValueError, KeyError, LookupError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: cannot be read as URDF ({reason}); mend the file") from error
    values = np.array(rows, np.float64).reshape(-1, 4)
    return values[:, :3], values[:, 3]


Frame = tuple[Float64Array, Float64Array]  # a rotation (3, 3) and a translation (3,)


def _link_frame(link: ElementTree.Element, joints: dict[str, ElementTree.Element]) -> Frame:
    """Return the frame of a link in that of the robot; raises ValueError for joints in a circle."""
    rotation, translation = np.eye(3), np.zeros(3)
    name = link.get("name", "")
    for _ in range(len(joints) + 1):
        if name not in joints:
            return rotation, translation
        own, offset = _origin(joints[name])
        rotation, translation = own @ rotation, own @ translation + offset
        parent = joints[name].find("parent")
        name = "" if parent is None else parent.get("link", "")
    raise ValueError("its joints form a circle")


def _link_spheres(link: ElementTree.Element, frame: Frame) -> Iterator[list[float]]:
    for collision in link.findall("collision"):
        sphere = collision.find("geometry/sphere")
        if sphere is not None:
            _, offset = _origin(collision)
            if "radius" not in sphere.attrib:
                raise ValueError("a sphere has no radius")
            yield [*(frame[0] @ offset + frame[1]).tolist(), float(sphere.attrib["radius"])]


def _origin(element: ElementTree.Element) -> Frame:
    """Return the frame that an `origin` gives; raises ValueError where it has other than three numbers each."""
    from scipy.spatial.transform import Rotation  # in functions: slow to import

    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    roll_pitch_yaw, offset = (
        np.array([float(word) for word in given.get(key, "0 0 0").split()]) for key in ("rpy", "xyz")
    )
    if offset.shape != (3,) or roll_pitch_yaw.shape != (3,):
        raise ValueError("an origin is not three numbers each of xyz and rpy")
    return Rotation.from_euler("xyz", roll_pitch_yaw).as_matrix(), offset


# USDA: sphere prims under one transform. Most meshes have y up, as glTF, and a metre as the unit, unless they say more.
_HEAD = """\
#usda 1.0
(
    defaultPrim = "{name}"
    metersPerUnit = {unit}
    upAxis = "{axis}"
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


def usda_stage(spheres: SphereSet, scene: Scene | None) -> str:
    """Return a USDA stage in the frame of the scene and with its name, with a Sphere prim for each sphere."""
    up, unit = (None, None) if scene is None else (scene.up, scene.unit)
    head = _HEAD.format(name=identifier(scene), unit=f"{unit or 1:.15g}", axis=(up or "y").upper())
    return _stage(spheres.centers, spheres.radii, head)


def _stage(centers: Float64Array, radii: Float64Array, head: str) -> str:
    prims = [
        _SPHERE.format(number=number, x=x, y=y, z=z, radius=radius, low=-radius)
        for number, ((x, y, z), radius) in enumerate(zip(centers.tolist(), radii.tolist(), strict=True))
    ]
    return f"{head}{''.join(prims)}}}\n"


_RADIUS = re.compile(r"^ +double radius = (\S+)$", re.MULTILINE)
_TRANSLATION = re.compile(r"^ +double3 xformOp:translate = \((\S+), (\S+), (\S+)\)$", re.MULTILINE)
_FRAME = re.compile(r'defaultPrim = "(?P<name>\w+)"\n +metersPerUnit = (?P<unit>\S+)\n +upAxis = "(?P<axis>[YZ])"')


def read_usda(path: Path) -> tuple[Float64Array, Float64Array]:
    """Read (centers, radii) as float64, unchecked: the Sphere prims of a USD stage.

    A stage that is exactly as `usda_stage` writes it needs no library; others need usd-core.
    Raises InputError where the file is missing or damaged, where it needs usd-core or another file, and where a sphere
    is stretched.
    """
    try:
        text = read_file(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: holds bytes that are not text ({error}), USDA was expected; export it again"
        ) from error
    frame = _FRAME.search(text)
    try:
        radii = np.array([float(radius) for radius in _RADIUS.findall(text)], np.float64)
        centers = np.array(
            [[float(value) for value in center] for center in _TRANSLATION.findall(text)], np.float64
        ).reshape(-1, 3)
        head = _HEAD.format(**frame.groupdict()) if frame is not None else "other"
        if len(centers) == len(radii) and _stage(centers, radii, head) == text:
            return centers, radii
    except ValueError:
        pass  # another program wrote it
    if find_spec("pxr") is None:
        raise InputError(f"{path}: is not a stage that aoprecalc wrote; `pip install usd-core` to read those of others")
    return _read_stage(path)


def _read_stage(path: Path) -> tuple[Float64Array, Float64Array]:
    from pxr import Sdf, Tf, Usd, UsdGeom

    try:
        layer = Sdf.Layer.FindOrOpen(str(path))
        if layer is None:
            raise InputError(f"{path}: cannot be read as USD; export it again")
        if layer.GetCompositionAssetDependencies():
            raise InputError(f"{path}: refers to other files, which are not read; flatten it (usdcat --flatten)")
        stage, cache, rows = Usd.Stage.Open(layer), UsdGeom.XformCache(), list[list[float]]()
        for prim in stage.Traverse():
            if prim.IsA(UsdGeom.Sphere):
                matrix = np.array(cache.GetLocalToWorldTransform(prim))
                scales = np.linalg.norm(matrix[:3, :3], axis=1)
                if np.ptp(scales) > 1e-6 * scales.max():
                    raise InputError(f"{path}: {prim.GetPath()} is stretched, a sphere was expected; scale it evenly")
                rows.append([*matrix[3, :3].tolist(), float(UsdGeom.Sphere(prim).GetRadiusAttr().Get()) * scales[0]])
    except (Tf.ErrorException, RuntimeError) as error:
        reason = " ".join(str(error).split(" : ", 1)[-1].split())[:120]  # behind the place in USD's own sources
        raise InputError(f"{path}: cannot be read as USD ({reason}); export it again") from error
    values = np.array(rows, np.float64).reshape(-1, 4)
    return values[:, :3], values[:, 3]
