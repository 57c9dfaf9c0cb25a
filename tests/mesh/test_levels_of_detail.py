"""Levels of detail and collision hulls: which parts they are, and what they mean for a bake, spheres and pictures."""

from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.io import load_scene
from aoprecalc.mesh.roles import assign_roles, at_level, finest_level
from aoprecalc.mesh.surface import sample_surface, shading_normals
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, LightOptions, SphereOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set
from gltf_kit.gltf_maker import GltfMaker
from shapes import ball, box, scene_of_parts

NESTED = {"ball_LOD0": ball(2), "ball_LOD1": ball(1, 0.9), "ball_LOD2": ball(1, 0.5), "UCX_ball": box()}


def named(shapes):
    """A scene with a part of each name."""
    made = scene_of_parts(*shapes.values())
    parts = [replace(part, name=name) for part, name in zip(made.parts, shapes, strict=True)]
    return replace(made, parts=tuple(parts))


def with_roles(*names, **options):
    """Unit boxes with these names, side by side, with their roles."""
    boxes = {name: box((3 * place, 0, 0), (3 * place + 1, 1, 1)) for place, name in enumerate(names)}
    return assign_roles(named(boxes), LightOptions(**options))


@pytest.mark.parametrize(
    ("names", "hulls"),
    [
        ("wall UCX_wall_01 UBX_wall ucx_wall USP_b UCP_c", "UCX_wall_01 UBX_wall ucx_wall USP_b UCP_c"),
        (
            "wall wall-colonly wall-convcolonly wall-COLONLY.001",
            "wall-colonly wall-convcolonly wall-COLONLY.001",
        ),
        ("crate COL_crate col_Crate_01 crate_collision crate_collider collision_crate", None),
        ("Col_1 Col_2 Col_3 roof", ""),  # columns
        ("collar UCXwall wall_ucx my-colonly-wall", ""),
        ("UCX_1 UCX_2", ""),  # there would be nothing to bake
    ],
)
def test_collision_hulls_by_their_names(names, hulls):
    names = names.split()
    expected = names[1:] if hulls is None else hulls.split()
    scene = with_roles(*names)
    assert [part.name for part in scene.parts if part.hull] == expected
    assert [part.name for part in scene.parts if not part.receives] == expected
    assert [part.name for part in scene.parts if not part.occludes] == expected
    assert not any(part.hull or not part.receives for part in with_roles(*names, all_parts=True).parts)


def test_a_name_that_may_be_a_hulls_is_one_where_it_surrounds_another_part():
    statue = box((0, 0, 0), (1, 2, 1))
    for hull, is_hull in ((box((-0.05, 0, -0.05), (1.05, 2, 1.05)), True), (box((2, 0, 0), (3, 2, 1)), False)):
        scene = assign_roles(
            named({"statue": statue, "tree": box((9, 0, 0), (10, 1, 1)), "COL_12": hull}), LightOptions()
        )
        assert [part.hull for part in scene.parts] == [False, False, is_hull]


@pytest.mark.parametrize("option", ["only", "occluders_only"])
def test_a_hull_that_is_asked_for_is_an_ordinary_part(option):
    scene = with_roles("wall", "UCX_wall", **{option: ("UCX_*",)})
    assert scene.parts[1].occludes
    assert scene.parts[1].receives == (option == "only")


@pytest.mark.parametrize(
    ("names", "levels"),
    [
        ("tree_LOD0 tree_LOD1 tree_LOD2", "0 1 2"),
        ("tree_LOD2 tree_LOD5 tree_LOD3", "0 2 1"),
        ("tree tree_LOD1 road", "0 1 -"),
        ("tree_lod0 tree.LOD1 treeLOD2 tree-lod-3", "0 1 2 3"),
        ("LOD0_tree LOD1_tree", "0 1"),
        ("tree_LOD0.001 tree_LOD1.001", "0 1"),
        ("tree_LOD0_leaf tree_LOD0_bark tree_LOD1", "0 0 1"),
        ("tree_LOD0 house_LOD0 tree_LOD1 house_LOD1 house_LOD2", "0 0 12 1 2"),
        ("tree_LOD1 house_LOD1", "- -"),  # one level of each
        ("melodic1 lodge2 explode3", "- - -"),
    ],
)
def test_levels_of_detail_by_their_names(names, levels):
    """Each digit is a level that shows the part; a dash: all levels do."""
    scene = with_roles(*names.split())
    found = ["".join(map(str, part.levels)) if part.levels else "-" for part in scene.parts]
    assert found == levels.split()
    assert scene.levels == 1 + max((int(digit) for digit in levels if digit.isdigit()), default=0)
    assert with_roles(*names.split(), all_parts=True).levels == 1


def test_every_part_receives_at_one_level_and_occludes_at_those_that_show_it():
    scene = with_roles("tree_LOD0", "tree_LOD1", "house_LOD0", "house_LOD1", "house_LOD2", "road")
    shown = [at_level(scene, level).parts for level in range(scene.levels)]
    assert [[part.receives for part in parts].index(True) for parts in zip(*shown, strict=True)] == [0, 1, 0, 1, 2, 0]
    assert [sum(part.receives for part in parts) for parts in zip(*shown, strict=True)] == [1] * 6
    occluding = [{part.name for part in parts if part.occludes} for parts in shown]
    assert occluding == [
        {"tree_LOD0", "house_LOD0", "road"},
        {"tree_LOD1", "house_LOD1", "road"},
        {"tree_LOD1", "house_LOD2", "road"},
    ]


@pytest.mark.parametrize("backend", [pytest.param("gl", marks=pytest.mark.gl), "ray"])
def test_levels_inside_one_another_are_open(backend):
    """Each is convex, so that its value is 1 everywhere by itself; as ordinary parts all but the hull are enclosed."""
    options = BakeOptions(size=128, directions=64, backend=backend)
    baked = bake_scene(named(NESTED), options)
    assert baked.texture.values[baked.texture.valid].min() > 0.999
    together = bake_scene(named(NESTED), replace(options, all_parts=True))
    inner = together.texture.values[together.texture.valid]
    assert np.mean(inner < 0.01) > 0.3
    assert any("3 levels of detail" in note for note in baked.notes)
    assert any("'UCX_ball'" in note for note in baked.notes)


@pytest.mark.parametrize(
    ("options", "received"),
    [
        ({"exclude": ("ball_LOD0",)}, "ball_LOD1 ball_LOD2"),
        ({"exclude": ("ball_LOD1", "UCX_ball")}, "ball_LOD0 ball_LOD2"),
        ({"only": ("ball_LOD2",)}, "ball_LOD2"),
        ({"only": ("UCX_ball",)}, "UCX_ball"),
        ({"occluders_only": ("ball_LOD0",)}, "ball_LOD1 ball_LOD2"),
    ],
    ids=str,
)
def test_levels_at_which_nothing_receives_are_left_out(options, received):
    baked = bake_scene(named(NESTED), BakeOptions(size=64, directions=64, backend="ray", **options))
    assert {part.name for part in baked.scene.parts if part.receives} == set(received.split())
    assert baked.texture.values[baked.texture.valid].min() > 0.999
    points = sample_surface(baked.scene, baked.atlas.mapped, 50, seed=0)
    values = reference_ao(baked.scene, baked.normals, points, VerifyOptions(rays=64), Progress())
    np.testing.assert_array_equal(values, 1)


def test_two_sided_levels_take_the_lighter_side():
    """Open shells one inside the other: the inside of a bowl is darker than its outside, whatever else there is."""
    options = BakeOptions(size=64, directions=64, backend="ray", two_sided=True)
    baked = bake_scene(named({key: NESTED[key] for key in ("ball_LOD0", "ball_LOD1")}), options)
    assert baked.texture.values[baked.texture.valid].min() > 0.999


def test_the_reference_looks_at_each_level_by_itself():
    scene = assign_roles(named(NESTED), LightOptions())
    points = sample_surface(scene, scene.receives, 200, seed=0)
    assert set(np.searchsorted([part.stop for part in scene.parts], points.faces, "right")) == {0, 1, 2}
    normals = shading_normals(scene, "flat", None)
    values = reference_ao(scene, normals, points, VerifyOptions(rays=64), Progress())
    np.testing.assert_array_equal(values, 1)


def test_levels_that_share_positions_have_normals_of_their_own():
    """A cube and the same cube as a hull, of which one face is missing: corners of the cube stay as they are."""
    alone = with_roles("cube")
    positions, faces = box((0, 0, 0), (1, 1, 1))
    both = named({"cube": (positions, faces), "UCX_cube": (positions, faces[2:])})
    # Positions of a file are welded.
    shared = np.where(np.arange(len(both.positions)) < len(positions), 0, len(positions))
    welded = replace(both, positions=positions, faces=(both.faces - shared[both.faces]).astype(np.int32))
    found = assign_roles(welded, LightOptions())
    np.testing.assert_array_equal(shading_normals(found, "smooth", None)[:12], shading_normals(alone, "smooth", None))


def test_spheres_stand_for_the_finest_level():
    options = SphereOptions(8, samples=2000)
    alone = named({"ball_LOD0": NESTED["ball_LOD0"]})
    found, expected = (fit_sphere_set(scene, options, Progress()) for scene in (named(NESTED), alone))
    np.testing.assert_array_equal(found[0].centers, expected[0].centers)
    assert found[1] == expected[1]
    everything, _ = fit_sphere_set(named(NESTED), replace(options, all_parts=True), Progress())
    assert not np.array_equal(everything.centers, found[0].centers)


def test_the_finest_level_keeps_its_own_values():
    shapes = {"UCX_a": box(), "a_LOD1": ball(1), "a_LOD0": ball(2, 2.0), "road": box((5, 0, 0), (6, 1, 1))}
    rng = np.random.default_rng(0)
    scene = named(shapes)
    corners = rng.random((len(scene.faces), 3, 2))
    normals = rng.random((len(scene.faces), 3, 3)).astype(np.float32)
    finest, kept = finest_level(replace(scene, uv_sets=(corners,), normals=normals))
    assert [part.name for part in finest.parts] == ["a_LOD0", "road"]
    np.testing.assert_array_equal(finest.corners, scene.corners[kept])
    np.testing.assert_array_equal(finest.uv_sets[0], corners[kept])
    np.testing.assert_array_equal(finest.normals, normals[kept])
    assert [finest.corners[part.faces].shape for part in finest.parts] == [
        scene.corners[part.faces].shape for part in scene.parts[2:]
    ]


def msft_lod(folder, names=("near", "far")):
    """A glTF document of two spheres one inside the other, of which no scene names the coarser."""
    gltf_maker, nodes = GltfMaker(folder), []
    for name, (positions, faces) in zip(names, (ball(2), ball(1, 0.9)), strict=True):
        attributes = {"POSITION": gltf_maker.vertices(positions.astype("<f4"), bounds=True)}
        primitive = {"attributes": attributes, "indices": gltf_maker.indices(faces.astype("<u2"))}
        nodes.append(gltf_maker.node(name=name, mesh=gltf_maker.mesh(primitive)))
    gltf_maker.json["nodes"][nodes[0]]["extensions"] = {"MSFT_lod": {"ids": [nodes[1]]}}
    gltf_maker.json |= {"extensionsUsed": ["MSFT_lod"], "scene": 0, "scenes": [{"nodes": [nodes[0]]}]}
    return gltf_maker.save()


def test_the_levels_of_a_gltf_get_their_bake(tmp_path):
    path = msft_lod(tmp_path)
    scene = assign_roles(load_scene(path), LightOptions())
    assert [(part.name, part.levels.start) for part in scene.parts] == [("near", 0), ("far", 1)]
    result = ao.bake(path, ao.BakeOptions(size=64, directions=64, backend="ray"))
    result.save(tmp_path / "baked.glb")
    again = load_scene(tmp_path / "baked.glb")
    assert len(again.uv_sets) == 1
    assert all(np.ptp(again.uvs[part.faces], axis=(0, 1)).min() > 0.05 for part in again.parts)
    assert [(part.level, part.receives) for part in result.report.parts] == [(0, True), (1, True)]


def test_pictures_show_the_finest_level(tmp_path):
    found = mesh_to_draw(msft_lod(tmp_path))
    assert [part.name for part in found.mesh.scene.parts] == ["near"]
    assert len(found.mesh.normals) == len(found.mesh.textured) == len(found.mesh.scene.faces) == len(ball(2)[1])
    assert any("1 part not drawn" in message for message in found.messages)
