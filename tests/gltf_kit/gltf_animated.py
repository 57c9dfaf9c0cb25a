"""Meshes that move, made in code: a box with a lid, a strip over a joint, a sheet with morph targets."""

import numpy as np

from gltf_kit.gltf_maker import GltfMaker
from shapes import box, join, quad, triangle_a_cell

HINGE = np.array([0, 1, -1])


def clip(maker: GltfMaker, name, *channels, **members):
    """Add an animation; each channel is (node, path, times, values) and perhaps the interpolation."""
    made = {"channels": [], "samplers": [], **members, **({} if name is None else {"name": name})}
    for node, path, times, values, *how in channels:
        times = maker.accessor(np.array(times, "<f4"), min=[min(times)], max=[max(times)])
        sampler = {"input": times, "output": values if isinstance(values, int) else maker.accessor(floats(values))}
        made["samplers"].append(sampler | ({"interpolation": how[0]} if how else {}))
        made["channels"].append({"sampler": len(made["samplers"]) - 1, "target": {"node": node, "path": path}})
    return maker.add("animations", made)


def floats(values):
    return np.array(values, "<f4")


def turn(axis, degrees):
    """The quaternion of a turn about an axis."""
    half = np.radians(degrees) / 2
    return [*(np.sin(half) * np.asarray(axis, float)), np.cos(half)]


def soup(shape):
    """A shape whose vertices are not shared: positions (3 f, 3), normals (3 f, 3)."""
    positions, faces = shape
    corners = np.asarray(positions, float)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def flat_primitive(maker: GltfMaker, shape, uvs=None):
    """A primitive with flat normals, and with (f, 3, 2) UVs, v upwards."""
    positions, normals = soup(shape)
    attributes = {
        "POSITION": maker.vertices(floats(positions), bounds=True),
        "NORMAL": maker.vertices(floats(normals)),
    }
    if uvs is not None:
        attributes["TEXCOORD_0"] = maker.vertices(floats(np.asarray(uvs) * (1, -1) + (0, 1)).reshape(-1, 2))
    return {"attributes": attributes}


def open_box():
    """A floor and four walls, all seen from inside, 2 wide, 1 high; and its lid, which lies on the walls' edges."""
    low, high = (-1, 0, -1), (1, 1, 1)
    positions, faces = box(low, high)
    corners = np.asarray(positions, float)[faces]
    inside = faces[(corners[:, :, 1] < 1).any(axis=1)][:, ::-1]
    lid = quad((-1, 1, -1), (0, 0, 2), (2, 0, 0), cells=2)
    return (positions, inside), lid


def box_with_lid(maker: GltfMaker, angles=(0, 90)):
    """A box whose lid turns about its hinge, from one angle at 0 seconds to another at 1; all faces have UVs."""
    walls, lid = open_box()
    count = len(walls[1])
    uvs = triangle_a_cell(count + len(lid[1]))
    maker.node(name="walls", mesh=maker.mesh(flat_primitive(maker, walls, uvs[:count])))
    about_hinge = lid[0] - HINGE, lid[1]
    mesh = maker.mesh(flat_primitive(maker, about_hinge, uvs[count:]))
    node = maker.node(name="lid", mesh=mesh, translation=HINGE.tolist())
    clip(maker, "open", (node, "rotation", [0, 1], [turn((1, 0, 0), -angle) for angle in angles]))
    return maker


def box_with_still_lid(maker: GltfMaker, angle):
    """The same box with its lid at an angle, without an animation."""
    box_with_lid(maker)
    del maker.json["animations"]
    maker.json["nodes"][1]["rotation"] = [float(number) for number in floats(turn((1, 0, 0), -angle))]
    return maker


def strip_over_a_joint(maker: GltfMaker, degrees=90):
    """A strip along x from -1 to 1; its half x > 0 hangs on a joint at 0 that bends about z within one second."""
    positions, faces = join(quad((-1, 0, 0.5), (1, 0, 0), (0, 0, -1)), quad((0, 0, 0.5), (1, 0, 0), (0, 0, -1)))
    primitive = flat_primitive(maker, (positions, faces), triangle_a_cell(len(faces)))
    moves = np.repeat([0, 1], len(faces) * 3 // 2)
    joints, weights = np.zeros((len(moves), 4), "<u1"), np.zeros((len(moves), 4), "<f4")
    joints[:, 0], weights[:, 0] = moves, 1
    primitive["attributes"] |= {"JOINTS_0": maker.vertices(joints), "WEIGHTS_0": maker.vertices(weights)}
    still, bends = maker.node(), maker.node()
    maker.add("skins", {"joints": [still, bends]})
    maker.node(mesh=maker.mesh(primitive), skin=0, translation=[7, 7, 7], scale=[3, 3, 3])
    clip(maker, "bend", (bends, "rotation", [0, 1], [turn((0, 0, 1), 0), turn((0, 0, 1), degrees)]))
    return maker
