"""The meshes of the documentation's pictures."""

import json
import struct
from pathlib import Path

import numpy as np
import trimesh
from trimesh.transformations import translation_matrix

import aoprecalc as ao

# leaning_wall: the outlines of a floor and of a wall that leans over it, in texels; they share their first two corners.
SIZE = (96, 72)
FLOOR = [(12, 42), (54, 18), (64, 30), (62, 41), (56, 50), (47, 56), (35, 59), (20, 57)]
WALL = [(74, 61), (78, 12), (86, 25), (85, 48)]
LEAN = np.radians(60)  # angle between floor and wall

STUDS, STUD_RADIUS = 80, 0.14  # of `studded`; radians


def leaning_wall() -> ao.Mesh:
    """Make the mesh of borders.png, whose faces have the size of their charts."""
    floor, wall = (np.array(outline) @ (1, 1j) for outline in (FLOOR, WALL))  # x + iy
    crease, base = ((side[1] - side[0]) / abs(side[1] - side[0]) for side in (floor, wall))
    raised = (wall - wall[0]) / base
    ground = np.append(floor, floor[0] + crease * (raised.real + 1j * np.cos(LEAN) * raised.imag))
    ground[len(floor) + 1] = floor[1]
    height = np.append(np.zeros(len(floor)), np.sin(LEAN) * raised.imag)
    faces = [(0, i, i + 1) for i in range(1, len(floor) - 1)]
    faces += [(len(floor), len(floor) + i + 1, len(floor) + i) for i in range(1, len(wall) - 1)]
    uvs = np.array(FLOOR + WALL) / SIZE * (1, -1) + (0, 1)
    return ao.Mesh(np.column_stack([ground.real, ground.imag, height]), faces, uvs=uvs)


def in_a_box() -> trimesh.Trimesh:
    """Make a box with one ball halfway through its top and another inside; the first 12 faces are the box."""
    sunk = trimesh.creation.icosphere(4, 0.34).apply_translation((0, 0, 0.5))
    within = trimesh.creation.icosphere(4, 0.22).apply_translation((0, 0, -0.2))
    return trimesh.util.concatenate([trimesh.creation.box((1.3, 1.3, 1.0)), sunk, within])


def inside_out() -> trimesh.Trimesh:
    """Make a torus whose faces point inwards."""
    ring = trimesh.creation.torus(0.60, 0.30, major_sections=128, minor_sections=64)
    ring.invert()
    return ring


def studded(divisions: int, height: float) -> ao.Mesh:
    """Make a ball with round studs of a height, and a groove around each: both meshes of high-to-low.png."""
    ball = trimesh.creation.icosphere(divisions)
    turns = np.arange(STUDS)
    z = 1 - (2 * turns + 1) / STUDS
    angle = turns * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    studs = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    away = np.arccos(np.clip(ball.vertices @ studs.T, -1, 1)).min(axis=1) / STUD_RADIUS
    relief = np.sqrt(np.maximum(1 - away**2, 0)) - 0.5 * np.exp(-(((away - 1.15) / 0.12) ** 2))
    return ao.Mesh(ball.vertices * (1 + height * relief)[:, None], ball.faces, name="studded")


def cup() -> trimesh.Trimesh:
    """Make a single-layer cup, whose faces point inwards, on a plate."""
    angles = np.linspace(-np.pi / 2, 0, 17)
    layer = trimesh.creation.revolve(
        np.array([*0.5 * np.column_stack([np.cos(angles), np.sin(angles)]), (0.56, 0.4)]), sections=96
    )
    layer.invert()
    plate = trimesh.creation.cylinder(0.92, segment=[(0, 0, -0.62), (0, 0, -0.52)], sections=128)
    return trimesh.util.concatenate([plate, layer])


def plant() -> trimesh.Trimesh:
    """Make single-layer leaves over a plate; the faces of every second leaf point down."""
    along, across = np.meshgrid(np.linspace(0, 1, 33), np.linspace(-1, 1, 9), indexing="ij")
    side = (0.19 * np.sin(np.pi * along**1.3) + 0.02) * across
    height = 0.62 * np.sin(2.7 * along**0.9) + 0.06 * np.abs(across) * np.sin(np.pi * along) - 0.38
    vertices = np.stack([0.07 + 0.80 * along, side, height], axis=-1).reshape(-1, 3)
    corner = np.add.outer(9 * np.arange(32), np.arange(8)).ravel()
    faces = np.concatenate([corner[:, None] + (0, 9, 10), corner[:, None] + (0, 10, 1)])
    plate = trimesh.creation.cylinder(0.92, segment=[(0, 0, -0.5), (0, 0, -0.4)], sections=128)
    leaves = [trimesh.Trimesh(vertices, faces if number % 2 else faces[:, ::-1]) for number in range(6)]
    for number, leaf in enumerate(leaves):
        leaf.apply_transform(trimesh.transformations.rotation_matrix(number * np.pi / 3 + 0.3, (0, 0, 1)))
    return trimesh.util.concatenate([plate, *leaves])


def octopus() -> trimesh.Trimesh:
    """Make a head on eight tapered arms, y up: one mesh of spheres.png."""
    head = trimesh.creation.icosphere(4, 0.42)
    head.apply_transform(np.diag([0.9, 1.25, 0.9, 1.0]))
    parts = [head.apply_translation((0.0, 0.75, -0.05))]
    along = np.linspace(0, 1, 49)
    for arm in range(8):
        turn = arm * np.pi / 4 + 0.35 * np.sin(2.4 * arm) + 0.9 * along**2 * np.cos(1.7 * arm)
        reach = 0.16 + 1.1 * along
        height = 0.42 * (1 - along) ** 2 + 0.07 + 0.16 * np.sin(3.1 * along + arm) * along
        path = np.column_stack([reach * np.cos(turn), height, reach * np.sin(turn)])
        parts.append(tube(path, 0.15 * (1 - along) ** 0.8 + 0.02))
    return trimesh.util.concatenate(parts)


def chair() -> trimesh.Trimesh:
    """Make a chair of thin bars, y up: the other mesh of spheres.png."""
    bars = [((x - 0.03, 0.0, z - 0.03), (x + 0.03, 0.5, z + 0.03)) for x in (-0.24, 0.24) for z in (-0.24, 0.24)]
    bars += [((-0.30, 0.50, -0.30), (0.30, 0.54, 0.30)), ((-0.30, 1.05, -0.28), (0.30, 1.14, -0.24))]
    bars += [((x - 0.025, 0.54, -0.28), (x + 0.025, 1.05, -0.24)) for x in (-0.26, -0.13, 0.0, 0.13, 0.26)]
    return trimesh.util.concatenate([trimesh.creation.box(bounds=bar) for bar in bars])


def tube(path: np.ndarray, radii: np.ndarray, sections: int = 24) -> trimesh.Trimesh:
    """Sweep circles, one radius for each point, along a path, (n, 3); it never runs along y. The ends are closed."""
    forward = np.gradient(path, axis=0)
    side = np.cross(forward, (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    upward = np.cross(side, forward)
    upward /= np.linalg.norm(upward, axis=1, keepdims=True)
    angles = np.linspace(0, 2 * np.pi, sections, endpoint=False)
    ring = side[:, None] * np.cos(angles)[:, None] + upward[:, None] * np.sin(angles)[:, None]
    vertices = np.concatenate([(path[:, None] + radii[:, None, None] * ring).reshape(-1, 3), path[[0, -1]]])
    first = (np.arange(len(path) - 1)[:, None] * sections + np.arange(sections)).ravel()
    turned = first - first % sections + (first + 1) % sections
    quads = np.concatenate([np.column_stack([first, turned, turned + sections]),
                            np.column_stack([first, turned + sections, first + sections])])  # fmt: skip
    start, last = np.arange(sections), np.arange(sections) + len(vertices) - 2 - sections
    caps = [
        np.column_stack([np.full(sections, len(vertices) - 2), np.roll(start, -1), start]),
        np.column_stack([np.full(sections, len(vertices) - 1), last, np.roll(last, -1)]),
    ]
    mesh = trimesh.Trimesh(vertices, np.concatenate([quads, *caps]), process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def chest(path: Path) -> None:
    """Write a chest with a ball in it as GLB; its lid opens by 110 degrees within a second, in the clip `open`."""

    def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
        return trimesh.creation.box(bounds=[low, high])

    walls = [block((-1, 0, -0.6), (1, 0.1, 0.6))]
    walls += [block((-1, 0.1, z - 0.05), (1, 0.7, z + 0.05)) for z in (-0.55, 0.55)]
    walls += [block((x - 0.05, 0.1, -0.5), (x + 0.05, 0.7, 0.5)) for x in (-0.95, 0.95)]
    ball = trimesh.creation.icosphere(4, 0.25).apply_translation((0.3, 0.35, 0.0))
    lid = [block((-1, 0, 0), (1, 0.1, 1.2)), block((-1.04, -0.1, 1.2), (1.04, 0.1, 1.26))]
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.util.concatenate([*walls, ball]), node_name="box", geom_name="box")
    hinge = translation_matrix((0, 0.7, -0.6))
    scene.add_geometry(trimesh.util.concatenate(lid), node_name="lid", geom_name="lid", transform=hinge)
    data = scene.export(file_type="glb", include_normals=True)
    size = struct.unpack_from("<I", data, 12)[0]
    document, buffer = json.loads(data[20 : 20 + size]), data[28 + size :]
    number = next(number for number, node in enumerate(document["nodes"]) if node.get("name") == "lid")
    document["nodes"][number] = {
        "name": "lid",
        "mesh": document["nodes"][number]["mesh"],
        "translation": [0, 0.7, -0.6],
    }
    half = np.radians(110) / 2
    keys = np.array([0, 1, 0, 0, 0, 1, -np.sin(half), 0, 0, np.cos(half)], "<f4").tobytes()
    views, accessors = document["bufferViews"], document["accessors"]
    for start, end, kind in ((0, 8, "SCALAR"), (8, 40, "VEC4")):
        views.append({"buffer": 0, "byteOffset": len(buffer) + start, "byteLength": end - start})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": 2, "type": kind})
    accessors[-2] |= {"min": [0], "max": [1]}
    sampler = {"input": len(accessors) - 2, "output": len(accessors) - 1}
    channel = {"sampler": 0, "target": {"node": number, "path": "rotation"}}
    document["animations"] = [{"name": "open", "samplers": [sampler], "channels": [channel]}]
    buffer += keys
    document["buffers"] = [{"byteLength": len(buffer)}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
