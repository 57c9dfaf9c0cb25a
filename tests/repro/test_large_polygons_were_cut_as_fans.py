"""Polygons of more than 1,000 corners became fans, whatever their shape: a gear was filled to its rim."""

import numpy as np
import pytest

from aoprecalc.io import load_scene
from aoprecalc.io.formats.polygons import polygon_triangles
from aoprecalc.mesh.surface import area_vectors

TILT = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][:2]
FAR = np.array([500012.345, 4649776.125, 120.5])


def ring(radii, turns=1):
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii) * turns
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)


def gear(corners):
    return ring(np.where(np.arange(corners) // max(corners // 80, 2) % 2, 1.0, 0.55))


def star(seed, corners=60):
    return ring(np.random.default_rng(seed).uniform(0.2, 1, corners))


def with_a_hole(seed):
    """A ring as one polygon, which visits the edge between its two borders twice."""
    random = np.random.default_rng(seed)
    outer, inner = ring(random.uniform(1, 1.5, 17)), ring(random.uniform(0.3, 0.6, 11), turns=-1)
    return np.concatenate([outer, outer[:1], inner, inner[:1]])


def straight(seed):
    """A star with up to three further corners on each edge."""
    points = star(seed, 20)
    steps = np.random.default_rng(seed).integers(1, 5, len(points))
    following = np.roll(points, -1, axis=0)
    return np.concatenate(
        [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(points, following, steps, strict=True)]
    )


# Two square holes that touch at (5, 5), reached over one edge.
HOLES = [
    (0, 0),
    (10, 0),
    (10, 10),
    (0, 10),
    (0, 0),
    (2, 2),
    (2, 5),
    (5, 5),
    (5, 8),
    (8, 8),
    (8, 5),
    (5, 5),
    (5, 2),
    (2, 2),
]
STAIRS = [(x + (part > 1), x + part % 2) for x in range(30) for part in (0, 2)] + [(30, 30), (0, 31)]
POLYGONS = {
    **{f"gear {corners}": gear(corners) for corners in (16, 160, 1600, 6400)},
    **{f"star {seed}": star(seed) for seed in range(5)},
    **{f"with a hole {seed}": with_a_hole(seed) for seed in range(5)},
    **{f"straight {seed}": straight(seed) for seed in range(5)},
    "holes": HOLES,
    "stairs": STAIRS,
    "twice": np.repeat(star(9), 2, axis=0),
    "spike": [(0, 0), (4, 0), (4, 3), (6, 3), (4, 3), (4, 4), (2, 1), (0, 4)],
}


def shoelace(points):
    x, y = np.asarray(points, float).T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


@pytest.mark.parametrize("polygon", POLYGONS)
@pytest.mark.parametrize("away", [0, FAR], ids=["near", "far"])
@pytest.mark.parametrize("winding", [1, -1])
def test_the_cut_covers_each_polygon_once(polygon, away, winding):
    flat = np.asarray(POLYGONS[polygon], float)[::winding]
    points = flat @ TILT + away
    triangles, owners = polygon_triangles(np.array([len(flat)]), np.arange(len(flat)), points)
    areas = area_vectors(points[triangles]) @ np.cross(*TILT) / 2
    assert areas.sum() == pytest.approx(shoelace(flat), rel=1e-6)
    assert np.abs(areas).sum() == pytest.approx(abs(shoelace(flat)), rel=1e-6)  # no triangle is turned over
    assert np.array_equal(np.unique(triangles), np.arange(len(flat)))  # neighbours meet at every corner
    assert (owners == 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_corner_on_a_straight_edge_parts_a_triangle(seed):
    flat = straight(seed)
    points = np.round(flat * 2**20) @ np.array([[0, 1, 0], [0, 0, 1]])
    triangles, _ = polygon_triangles(np.array([len(flat)]), np.arange(len(flat)), points)
    assert len(triangles) == len(flat) - 2


def test_a_bent_polygon_is_cut_as_its_projection():
    flat = gear(160)
    bent = np.column_stack([flat, 0.2 * np.sin(3 * flat[:, 0]) * np.cos(4 * flat[:, 1])])
    triangles, _ = polygon_triangles(np.array([160]), np.arange(160), bent @ np.linalg.qr(np.eye(3) + 0.3)[0])
    areas = area_vectors(np.pad(flat, ((0, 0), (0, 1)))[triangles])[:, 2] / 2
    assert np.abs(areas).sum() == pytest.approx(abs(shoelace(flat)), rel=0.05)  # the plane is nearly that of `flat`


def test_polygons_of_all_sizes_keep_their_order():
    shapes = [gear(160), gear(16), star(1), gear(160)[::-1]]
    points = np.concatenate([np.pad(flat, ((0, 0), (0, 1))) + (4 * at, 0, 0) for at, flat in enumerate(shapes)])
    counts = np.array([len(flat) for flat in shapes])
    triangles, owners = polygon_triangles(counts, np.arange(counts.sum()), points)
    areas = np.bincount(owners, area_vectors(points[triangles])[:, 2] / 2)
    assert areas == pytest.approx([shoelace(flat) for flat in shapes])
    assert (np.diff(owners) >= 0).all()
    assert np.array_equal(np.searchsorted(np.cumsum(counts), triangles, side="right"), np.repeat(owners[:, None], 3, 1))


def solid(kind, corners, height=0.5):
    """The text of a gear with its walls, and its area."""
    flat = gear(corners)
    points = np.concatenate([np.column_stack([flat, np.full(corners, z)]) for z in (0, height)])
    low = np.arange(corners)
    walls = np.stack([low, np.roll(low, -1), np.roll(low, -1) + corners, low + corners], axis=1)
    faces = [low[::-1], low + corners, *walls]
    rows = [" ".join(map(repr, point)) for point in points.tolist()]
    if kind == "obj":
        text = "".join([*(f"v {row}\n" for row in rows), *(f"f {' '.join(map(str, face + 1))}\n" for face in faces)])
    else:
        lists = [" ".join(map(str, [len(face), *face])) for face in faces]
        head = [f"OFF\n{len(rows)} {len(faces)} 0"]
        if kind == "ply":
            head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *(f"property double {x}" for x in "xyz")]
            head += [f"element face {len(faces)}", "property list int int vertex_indices", "end_header"]
        text = "\n".join([*head, *rows, *lists, ""])
    edges = np.linalg.norm(flat - np.roll(flat, -1, axis=0), axis=1).sum()
    return text, 2 * shoelace(flat) + height * edges


@pytest.mark.parametrize("kind", ["obj", "ply", "off"])
@pytest.mark.parametrize("corners", [16, 160, 1600])
def test_a_gear_has_its_area_in_every_format(tmp_path, kind, corners):
    text, area = solid(kind, corners)
    path = tmp_path / f"gear.{kind}"
    path.write_text(text)
    scene = load_scene(path)
    assert np.linalg.norm(area_vectors(scene.corners), axis=1).sum() / 2 == pytest.approx(area)
    assert len(scene.faces) == 2 * (corners - 2) + 2 * corners
