"""Facets of an STL whose corners differed in the last digits became a soup: flat, and each a chart of its own."""

import struct

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.io import load_scene
from aoprecalc.io.images import read_pixels
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.mesh.topology import topology, weld_corners
from shapes import ball, bowl, box, cap, join, torus

SEEDS = range(4)


def diagonal(corners):
    return np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))


def noisy(corners, seed, size=0.57e-6):
    """Each corner moved by up to `size` of the diagonal along each axis."""
    return corners + np.random.default_rng(seed).uniform(-1, 1, corners.shape) * size * diagonal(corners)


def binary(corners):
    rows = np.zeros(len(corners), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    rows["v"] = corners
    return b"made".ljust(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def ascii_solids(*solids):
    lines = []
    for number, corners in enumerate(solids):
        lines.append(f"solid part{number}")
        for facet in corners.tolist():
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += ["vertex {!r} {!r} {!r}".format(*point) for point in facet]
            lines += ["endloop", "endfacet"]
        lines.append(f"endsolid part{number}")
    return "\n".join(lines).encode()


def read(tmp_path, data):
    path = tmp_path / "a.stl"
    path.write_bytes(data)
    return load_scene(path)


def corners_of(shape):
    positions, faces = shape
    return np.asarray(positions, float)[faces]


SHAPES = {
    "ball": ball(4, 50),
    "torus": torus(),
    "box": box(),
    "two": join(box(), (box()[0] + 5, box()[1])),
    "cap": cap(),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["binary", "ascii"])
def test_noise_changes_no_topology(tmp_path, shape, seed, kind):
    exact = corners_of(SHAPES[shape])
    rough = noisy(exact, seed)
    scene = read(tmp_path, binary(rough) if kind == "binary" else ascii_solids(rough))
    positions, faces = weld_corners(exact, 0.0)
    assert topology(scene.faces) == topology(faces)
    assert len(scene.positions) == len(positions)
    moved, tolerance = scene.welded
    assert tolerance == pytest.approx(1e-6 * diagonal(rough))
    assert np.linalg.norm(scene.corners - rough, axis=2).max() <= tolerance * 1.01
    assert moved == np.count_nonzero((scene.corners != rough.astype("<f4" if kind == "binary" else float)).any(axis=2))
    assert any(f"{moved} of {faces.size} corners were moved by up to {tolerance:.3g} units" in n for n in scene.notes)


@pytest.mark.parametrize("shape", SHAPES)
def test_exact_corners_stay_as_they_are(tmp_path, shape):
    corners = corners_of(SHAPES[shape]).astype(np.float32)
    scene = read(tmp_path, binary(corners))
    assert np.array_equal(scene.corners, corners)
    assert (scene.welded, scene.notes) == (None, ())


@pytest.mark.parametrize("seed", SEEDS)
def test_the_order_of_the_facets_does_not_matter(seed):
    rough = noisy(corners_of(torus()), seed)
    order = np.random.default_rng(seed).permutation(len(rough))
    positions, faces = weld_corners(rough, 1e-6 * diagonal(rough))
    shuffled_positions, shuffled_faces = weld_corners(rough[order], 1e-6 * diagonal(rough))
    assert np.array_equal(positions[faces][order], shuffled_positions[shuffled_faces])


@pytest.mark.parametrize("seed", SEEDS)
def test_no_edge_longer_than_the_tolerance_is_lost(seed):
    """A fan of slivers whose short edges are about the tolerance, which corners may be joined along."""
    random = np.random.default_rng(seed)
    places = np.cumsum(random.uniform(0.3, 2.5, 200))
    rim = np.stack([places, random.uniform(-0.1, 0.1, 200), np.zeros(200)], axis=1)
    tip = np.broadcast_to([100.0, 5e5, 0], rim[1:].shape)
    corners = noisy(np.stack([rim[:-1], rim[1:], tip], axis=1), seed, 1e-8)
    tolerance = 1.0
    positions, faces = weld_corners(corners, tolerance)
    before = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    after = np.linalg.norm(positions[faces[:, 0]] - positions[faces[:, 1]], axis=1)
    assert (after[before > tolerance] > 0).all()
    assert np.linalg.norm(positions[faces] - corners, axis=2).max() <= tolerance


def test_details_far_below_the_tolerance_of_a_closed_surface_stay():
    small, far = corners_of(ball(2, 1e-8)), corners_of(box((1, 1, 1), (2, 2, 2)))
    corners = np.concatenate([small, far])
    positions, faces = weld_corners(corners, 1e-6 * diagonal(corners))
    assert np.array_equal(positions[faces], corners)


def test_solids_that_touch_meet(tmp_path):
    ring = corners_of(torus())
    half = len(ring) // 2
    rough = noisy(ring, 1)
    scene = read(tmp_path, ascii_solids(rough[:half], rough[half:]))
    assert [part.name for part in scene.parts] == ["part0", "part1"]
    assert topology(scene.faces) == topology(weld_corners(ring, 0.0)[1])


def shown(path, picture):
    """The values of a texture at the middle of each face of the mesh that was written with it, weighted by area."""
    mesh, values = load_scene(path), read_pixels(picture)[:, :, 0]
    u, v = mesh.uvs.mean(axis=1).T
    height, width = values.shape
    areas = np.linalg.norm(area_vectors(mesh.corners), axis=1)
    return np.average(values[((1 - v) * height).astype(int), (u * width).astype(int)], weights=areas)


def test_the_bake_is_that_of_the_exact_mesh_and_the_report_tells(tmp_path):
    exact = corners_of(bowl(18))
    options = ao.BakeOptions(size=256, directions=256, unwrap="uvunwrap", shadow_size=512)
    means, inputs = [], []
    for name, corners in (("exact", exact), ("noisy", noisy(exact, 0))):
        (tmp_path / f"{name}.stl").write_bytes(binary(corners))
        result = ao.bake(tmp_path / f"{name}.stl", options)
        result.save(tmp_path / f"{name}_ao.png")
        means.append(shown(tmp_path / f"{name}_ao.glb", tmp_path / f"{name}_ao.png"))
        inputs.append(result.report.to_dict()["input"])
    assert 0.4 < means[0] < 0.9
    assert means[1] == pytest.approx(means[0], abs=1e-3)
    counts = [{key: found[key] for key in ("vertices", "components", "watertight")} for found in inputs]
    assert counts[0] == counts[1]
    assert inputs[0].keys() & {"welded_corners", "weld_tolerance"} == set()
    assert inputs[1]["welded_corners"] > 0
    assert inputs[1]["weld_tolerance"] == pytest.approx(1e-6 * diagonal(exact), rel=1e-4)
