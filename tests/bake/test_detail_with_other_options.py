"""High to low with several textures, bent normals and backs that do not occlude, against closed forms.

The detailed mesh is a floor with a wall of height h as its edge, long enough to count as infinite. At a distance a from
the wall a point of the floor sees (1 + a / sqrt(a^2 + h^2)) / 2 of its light.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.api.bent_normals import bent_picture
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_maker import GltfMaker
from shapes import join, quad, quad_uvs

HEIGHT, LONG = 0.8, 500
FLOOR = quad((0, -LONG, 0), (LONG, 0, 0), (0, 2 * LONG, 0))
WALL = quad((0, -LONG, 0), (0, 2 * LONG, 0), (0, 0, HEIGHT))
STEP = join(FLOOR, WALL)
QUICK = {"size": 32, "directions": 1000, "unwrap": "keep", "cage": 0.05}
MIDDLES = (np.arange(32) + 0.5) / 32


def open_share(distance):
    return (1 + distance / np.hypot(distance, HEIGHT)) / 2


def row_of_squares(path, tiles):
    """An OBJ of unit squares along x from 0.1, each of its own material, with the UVs of a tile in a row of UDIMs."""
    path.with_suffix(".mtl").write_text("".join(f"newmtl m{number}\nKd 1 1 1\n" for number in range(len(tiles))))
    lines = [f"mtllib {path.stem}.mtl"]
    for number, tile in enumerate(tiles):
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            lines += [f"v {0.1 + number + u} {v} 0.01", f"vt {tile + u} {v}"]
        corners = (4 * number + corner for corner in range(1, 5))
        lines += [f"usemtl m{number}", "f " + " ".join(f"{corner}/{corner}" for corner in corners)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("tiles", "textures", "names"),
    [((0, 0, 0), "material", ["m0", "m1", "m2"]), ((0, 1, 2), "one", [1001, 1002, 1003])],
)
def test_each_of_several_textures_has_the_details_under_its_faces(tmp_path, tiles, textures, names):
    path = row_of_squares(tmp_path / "row.obj", tiles)
    options = BakeOptions(**QUICK, backend="ray", textures=textures)
    result = ao.bake(path, options, high=[ao.Mesh(*STEP)])
    assert [texture.name for texture in result.textures] == list(map(str, names))
    for number, texture in enumerate(result.textures):
        assert np.abs(texture.ao - open_share(0.1 + number + MIDDLES)).max() < 0.02
    assert result.report.high_to_low.missed == 0


def tilted(degrees, uvs):
    """A square over the floor, turned about its middle at a distance of 0.6 from the wall; and its normal."""
    turn = np.radians(degrees)
    along = 0.1 * np.array((np.cos(turn), 0, np.sin(turn)))
    across = np.array((0, 0.1, 0))
    mesh = ao.Mesh(*quad((0.6, 0, 0.01) - (along + across) / 2, along, across), uvs=uvs)
    return mesh, np.cross(along, across) / 0.01


@pytest.mark.parametrize("degrees", [0, 15, -15])
@pytest.mark.parametrize("quarter", [False, True])
def test_bent_normals_of_the_details_are_tangent_to_the_simple_mesh(degrees, quarter):
    """Across the wall angles t up to pi - atan(h / a) are open: an integral of sin(t) (cos t, sin t)."""
    uvs = quad_uvs((0, 0), (1, 1))
    mesh, normal = tilted(degrees, uvs[..., ::-1] * (-1, 1) + (1, 0) if quarter else uvs)
    options = BakeOptions(**QUICK, backend="ray", bent_normals=True, bent_space="tangent")
    result = ao.bake(mesh, options, high=[ao.Mesh(*STEP)])
    end = np.pi - np.arctan2(HEIGHT, 0.6)
    world = np.array((np.sin(end) ** 2 / 2, 0, end / 2 - np.sin(2 * end) / 4))
    world /= np.linalg.norm(world)
    middle = (slice(15, 17), slice(15, 17))
    assert np.degrees(np.arccos(result.bent_normals[middle] @ world)).max() < 2
    along, across = np.array((normal[2], 0, -normal[0])), np.array((0, 1, 0))
    tangent, bitangent = (-across, along) if quarter else (along, across)
    expected = np.array((tangent, bitangent, normal)) @ world
    picture = bent_picture(result._baked, options)[middle]
    assert np.degrees(np.arccos((picture @ expected).clip(-1, 1))).max() < 2


@pytest.mark.parametrize("backend", ["gl", "ray"])
@pytest.mark.parametrize(
    ("backfaces", "facing", "double_sided", "dark"),
    [
        ("occlude", "up", False, True),
        ("ignore", "up", False, False),
        ("ignore", "up", True, True),
        ("ignore", "down", False, True),
    ],
)
def test_backs_of_details_occlude_as_the_option_says(tmp_path, backend, backfaces, facing, double_sided, dark):
    """A wide roof over the floor takes all light but that from its rim where it counts."""
    maker = GltfMaker(tmp_path)
    material = maker.add("materials", {"doubleSided": double_sided})
    roof = quad((-LONG, -LONG, 0.5), (2 * LONG, 0, 0), (0, 2 * LONG, 0))
    floor = quad((-1, -1, 0), (3, 0, 0), (0, 3, 0))
    for (positions, faces), own in ((floor, {}), (roof, {"material": material})):
        if own and facing == "down":
            faces = faces[:, ::-1]
        corners = np.asarray(positions, "<f4")[faces.ravel()]
        maker.node(mesh=maker.mesh({"attributes": {"POSITION": maker.vertices(corners, bounds=True)}, **own}))
    options = BakeOptions(
        **QUICK | {"directions": 64}, backend=backend, backfaces=backfaces, high=maker.save("high.glb")
    )
    square = ao.Mesh(*quad((0, 0, 0.01), (1, 0, 0), (0, 1, 0)), uvs=quad_uvs((0, 0), (1, 1)))
    values = ao.bake(square, options).ao
    assert values.max() < 0.02 if dark else values.min() == 1


def test_verify_measures_several_textures_of_details(tmp_path):
    path = row_of_squares(tmp_path / "row.obj", (0, 0, 0))
    trimesh.Trimesh(*STEP, process=False).export(tmp_path / "step.ply")
    options = BakeOptions(**QUICK, backend="ray", textures="material", high=tmp_path / "step.ply")
    ao.bake(path, options).save(f"{tmp_path}/")
    few = ao.VerifyOptions(points=500, rays=256)
    assert ao.verify(tmp_path / "row_ao.obj", options=few).error < 0.02
    trimesh.Trimesh(*FLOOR, process=False).export(tmp_path / "floor.ply")
    assert ao.verify(tmp_path / "row_ao.obj", options=replace(few, high=tmp_path / "floor.ply")).error > 0.1
