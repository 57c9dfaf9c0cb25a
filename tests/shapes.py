"""Meshes with known answers, made in code. A shape is (positions (v, 3), faces (f, 3)), counter-clockwise outside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from aoprecalc.types import Part, Scene

MESHES = Path(__file__).parents[2] / "shared" / "meshes"  # beside the repository, for tests marked `corpus`


def scene(positions, faces, uvs=None, normals=None) -> Scene:
    """Make a Scene of a shape; uvs (f, 3, 2) and normals (f, 3, 3) at its corners are optional."""
    positions, faces = np.asarray(positions, float), np.asarray(faces, np.int32)
    part = Part("made", 0, len(faces), faces)
    normals = None if normals is None else np.asarray(normals, np.float32)
    return Scene(Path("made.obj"), "obj", positions, faces, normals, () if uvs is None else (uvs,), (part,))


def scene_of_parts(*shapes, uvs=None) -> Scene:
    """Make a Scene with a part for each shape."""
    whole = scene(*join(*shapes), uvs)
    stops = np.cumsum([len(faces) for _, faces in shapes])
    parts = [
        Part(f"part {number}", stop - len(faces), stop, np.asarray(faces, np.int32))
        for number, ((_, faces), stop) in enumerate(zip(shapes, stops.tolist(), strict=True))
    ]
    return replace(whole, parts=tuple(parts))


def quad(origin, right, up, cells=1):
    """A parallelogram that faces right x up, of cells x cells x 2 triangles."""
    steps = np.linspace(0, 1, cells + 1)
    grid = np.asarray(origin, float) + np.add.outer(steps, 0)[:, None, None] * np.asarray(right, float)
    positions = (grid + steps[None, :, None] * np.asarray(up, float)).reshape(-1, 3)
    i, j = np.divmod(np.arange(cells * cells), cells)
    a = i * (cells + 1) + j
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    return positions, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def quad_uvs(low, high, cells=1):
    """UVs at the corners of a quad, (f, 3, 2), that lay it out in the rectangle from low to high."""
    positions, faces = quad((*low, 0), (high[0] - low[0], 0, 0), (0, high[1] - low[1], 0), cells)
    return positions[faces][..., :2]


def join(*shapes):
    """One shape of several; positions are not shared between them."""
    starts = np.cumsum([0] + [len(positions) for positions, _ in shapes])
    return (
        np.concatenate([positions for positions, _ in shapes]),
        np.concatenate([faces + start for (_, faces), start in zip(shapes, starts, strict=False)]),
    )


def ball(divisions=3, radius=1.0):
    """An icosahedron, divided, with every position on the sphere."""
    golden = (1 + 5**0.5) / 2
    corners = [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([np.roll(corner, turn) for turn in range(3) for corner in corners])
    points /= np.linalg.norm(points[0])
    for _ in range(divisions):
        triangles = points[hull(points)[1]]
        middles = (triangles + np.roll(triangles, 1, axis=1)).reshape(-1, 3)
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        points = np.unique(np.concatenate([points, middles]).round(12), axis=0)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    positions, faces = hull(points)
    return positions * radius, faces


def hull(points):
    """The convex hull of points, facing outwards."""
    points = np.asarray(points, float)
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a + b + c - 3 * points.mean(axis=0)) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, faces = np.unique(faces, return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def box(low=(-1, -1, -1), high=(1, 1, 1)):
    """An axis-aligned box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return hull(np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)))


def torus(major=1.0, minor=0.4, around=48, across=24):
    """A ring about the z axis."""
    u, v = np.meshgrid(2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across, indexing="ij")
    ring = major + minor * np.cos(v)
    positions = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.divmod(np.arange(around * across), across)
    a = i * across + j
    b = (i + 1) % around * across + j
    c = (i + 1) % around * across + (j + 1) % across
    d = i * across + (j + 1) % across
    return positions, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def disc(radius, height, sections=128):
    """A disc that faces down, coaxial with the z axis."""
    angle = 2 * np.pi * np.arange(sections) / sections
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sections, height)])
    ahead = np.roll(np.arange(sections), -1)
    faces = np.column_stack([np.full(sections, sections), ahead, np.arange(sections)])
    return np.concatenate([rim, [[0.0, 0.0, height]]]), faces


def spun(profile, sections=48):
    """A profile, (k, 2) of radius and height, turned about the z axis; where the radius is 0 it has a pole."""
    radius, height = np.asarray(profile, float).T[:, :, None]
    turn = 2 * np.pi * np.arange(sections) / sections
    rings = [radius * np.cos(turn), radius * np.sin(turn), np.broadcast_to(height, (len(profile), sections))]
    a = np.arange((len(profile) - 1) * sections)
    b = a // sections * sections + (a + 1) % sections
    faces = np.concatenate([np.stack([a, b, b + sections], 1), np.stack([a, b + sections, a + sections], 1)])
    positions, same = np.unique(np.stack(rings, axis=-1).reshape(-1, 3).round(12), axis=0, return_inverse=True)
    faces = same.ravel()[faces]
    return positions, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def cap(rings=12, radius=1.0):
    """The lower half of a sphere, open, facing outwards."""
    turn = np.linspace(0, np.pi / 2, rings + 1)
    return spun(radius * np.column_stack([np.sin(turn), -np.cos(turn)]))


def bowl(rings=9):
    """The lower half of a ball, hollow, with walls of a seventh of the radius."""
    turn = np.linspace(0, np.pi / 2, rings + 1)
    outside = np.column_stack([np.sin(turn), -np.cos(turn)])
    return spun(np.concatenate([outside, 0.85 * outside[::-1]]))


def dented(seed, dents=12):
    """A ball with round dents."""
    positions, faces = ball(4)
    middle = np.random.default_rng(seed).normal(size=(dents, 3))
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    depth = 0.35 * np.exp((positions @ middle.T - 1) / 0.03).sum(axis=1)
    return positions * (1 - np.minimum(depth, 0.6))[:, None], faces


def clutter(seed, boxes=5):
    """Boxes of random shape, place and rotation, and a ring, some of them through each other."""
    rng = np.random.default_rng(seed)
    parts = [torus(1.5, 0.3, around=16, across=8)]
    for _ in range(boxes):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        positions, faces = box()
        parts.append((positions * rng.uniform(0.2, 0.7, 3) @ turn + rng.normal(size=3), faces))
    return join(*parts)


def triangle_a_cell(count):
    """UVs, (count, 3, 2), that give every face a triangle of its own."""
    cells = int(np.ceil(np.sqrt(count)))
    place = np.column_stack(np.divmod(np.arange(count), cells))[:, None]
    return (place + np.array([(0.1, 0.1), (0.9, 0.1), (0.1, 0.9)])) / cells


def rotation(seed):
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def notch(opening, length, sections=24):
    """A cylinder of radius 1 about the y axis without a wedge of `opening` radians, which starts at the x axis.

    The wedge's sides are the first four faces, two each.
    """
    turn = np.linspace(opening, 2 * np.pi, sections + 1)
    ring = np.column_stack([np.cos(turn), np.zeros_like(turn), np.sin(turn)])
    end = np.concatenate([[(0.0, 0.0, 0.0)], ring])
    half, count = np.array([0, length / 2, 0]), len(end)
    edges = np.array([(0, count - 1), (1, 0), *((i + 1, i) for i in range(1, count - 1))])
    sides = np.stack([edges[:, [0, 1, 1]], edges[:, [0, 1, 0]]], axis=1)
    sides[:, 0, 2] += count
    sides[:, 1, 1:] = edges[:, ::-1] + count
    fans = np.array([(0, i, i + 1) for i in range(1, count - 1)])
    return np.concatenate([end - half, end + half]), np.concatenate(
        [sides.reshape(-1, 3), fans, fans[:, [0, 2, 1]] + count]
    )


def helicopter():
    """A toy of 2 units: a hull, and rotors of thin blades."""
    turn = 2 * np.pi * np.arange(5) / 5
    blade, cells = box((0.05, -0.02, 0.5), (1.0, 0.02, 0.502)), np.stack([np.cos(turn), np.sin(turn)], axis=1)
    parts = [(0.3 * ball(2)[0], ball(2)[1]), box((-1.2, -0.03, -0.03), (-0.2, 0.03, 0.03))]
    for cos, sin in cells:
        spin = np.array([(cos, sin, 0), (-sin, cos, 0), (0, 0, 1)])
        parts.append((blade[0] @ spin, blade[1]))
        parts.append((0.15 * (blade[0] @ spin)[:, [0, 2, 1]] - (1.2, 0, 0), blade[1][:, ::-1]))
    return join(*parts)


def city(seed=0, boxes=300, sky=170.0):
    """A scene of three parts: boxes of 0.5 to 4 units on a plain, a toy helicopter, and the box of the sky."""
    rng = np.random.default_rng(seed)
    houses = []
    for x, y in rng.uniform(-60, 60, (boxes, 2)):
        size = rng.uniform(0.5, 4, 3)
        houses.append(box((x, y, 0), (x + size[0], y + size[1], size[2])))
    positions, faces = helicopter()
    inwards = box((-sky / 2, -sky / 2, -sky / 2), (sky / 2, sky / 2, sky / 2))
    made = scene_of_parts(join(*houses), (positions + (0, 0, 8), faces), (inwards[0], inwards[1][:, ::-1]))
    names = "houses", "helicopter", "sky"
    return replace(made, parts=tuple(replace(part, name=name) for part, name in zip(made.parts, names, strict=True)))
