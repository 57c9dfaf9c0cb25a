"""Vertices of glTF are split along new seams: what counts them, or hangs on their normals, was silently wrong.

Implicit feature ids (EXT_mesh_features) are the numbers of vertices. An accessor that an unknown extension shares with
a primitive was overwritten. Sparse morph targets became dense. With new normals, tangents were not perpendicular to
them, and morph targets lost their own.
"""

import numpy as np
import pytest

from aoprecalc.io import load_scene
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_documents import BLUES, POINTS, STACKED, TRIANGLES, corner, extend, pictured
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues


@pytest.fixture
def gltf(tmp_path):
    return GltfMaker(tmp_path)


@pytest.fixture
def bake(tmp_path):
    return lambda scene, name, *how, **more: write_with_texture(scene, tmp_path / "out" / name, *how, **more)


@pytest.fixture
def rewrite(gltf, bake):
    """rewrite(primitive, new_normals=...) -> (document before, document after, warnings): written with new UVs."""

    def write(primitive, new_normals=False, **mesh):
        gltf.node(mesh=gltf.mesh(primitive, **mesh))
        source = gltf.save()
        scene = load_scene(source)
        path, *_, warnings = bake(scene, "a.glb", normals=None if new_normals else scene.normals.astype(np.float32))
        return GltfValues(source), GltfValues(path), warnings

    return write


def primitives(*documents):
    return [document.json["meshes"][0]["primitives"][0] for document in documents]


def feature_ids(document):
    """The id at each corner of each of the primitive's feature ids."""
    (primitive,) = primitives(document)
    corners = document.corners(primitive)
    features = primitive["extensions"]["EXT_mesh_features"]["featureIds"]
    names = [f"_FEATURE_ID_{one['attribute']}" if "attribute" in one else None for one in features]
    ids = [corners if name is None else document.array(primitive["attributes"][name])[corners, 0] for name in names]
    return [list(map(int, each)) for each in ids]


@pytest.mark.parametrize("kept", [True, False], ids=["uvs kept", "new uvs"])
def test_implicit_feature_ids_follow_their_vertices(kept, gltf, bake):
    extend(gltf, "EXT_mesh_features")
    features = [{"featureCount": 8}, {"featureCount": 3, "attribute": 0, "label": "own"}, {"featureCount": 8}]
    primitive = corner(gltf, STACKED, extensions={"EXT_mesh_features": {"featureIds": features}})
    primitive["attributes"]["_FEATURE_ID_0"] = gltf.vertices(np.array([0, 1, 2, 0, 1, 2, 0, 1], "<u2"))
    gltf.node(mesh=gltf.mesh(primitive))
    source = gltf.save()
    scene = load_scene(source)
    path, *_, warnings = bake(scene, "a.glb", "keep" if kept else "xatlas", normals=scene.normals.astype(np.float32))
    before, after = GltfValues(source), GltfValues(path)
    assert feature_ids(after) == feature_ids(before)
    (written,) = primitives(after)
    assert ("_FEATURE_ID_1" in written["attributes"]) == (not kept)
    assert "_FEATURE_ID_2" not in written["attributes"]
    assert not [line for line in warnings if "EXT_mesh_features" in line]


def test_many_feature_ids_do_not_fit_16_bits(gltf, bake):
    extend(gltf, "EXT_mesh_features")
    count = 70_000
    points = np.zeros((count, 3), "<f4")
    points[-3:] = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    primitive = {
        "attributes": {"POSITION": gltf.vertices(points, bounds=True)},
        "indices": gltf.indices(np.arange(count - 3, count, dtype="<u4")),
        "extensions": {"EXT_mesh_features": {"featureIds": [{"featureCount": count}]}},
    }
    gltf.node(mesh=gltf.mesh(primitive))
    assert feature_ids(GltfValues(bake(gltf.load(), "a.glb")[0])) == [[count - 3, count - 2, count - 1]]


def test_an_accessor_that_an_unknown_extension_shares_is_left_alone(gltf, rewrite):
    extend(gltf, "EXT_of_ours")
    primitive = corner(gltf, STACKED)
    primitive["extensions"] = {"EXT_of_ours": {"edges": [primitive["indices"]]}}
    _, after, warnings = rewrite(primitive)
    at = primitives(after)[0]["extensions"]["EXT_of_ours"]["edges"][0]
    assert after.array(at)[:, 0].tolist() == TRIANGLES.tolist()
    assert [line for line in warnings if "EXT_of_ours, which may refer" in line]


@needs_validator
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("shared", [False, True], ids=["apart", "shares the indices"])
def test_outlines_follow_their_vertices(shared, mirrored, gltf, bake):
    extend(gltf, "CESIUM_primitive_outline")
    primitive = corner(gltf, STACKED)
    edges = np.array([0, 1, 1, 2, 2, 3, 3, 0, 4, 5], "<u2")  # without diagonals
    indices = gltf.indices(edges)
    if shared:  # each of their pairs is an edge of a triangle
        edges = np.array([0, 1, 2, 0, 2, 3], "<u2")
        primitive["indices"] = indices = gltf.indices(edges)
    primitive["extensions"] = {"CESIUM_primitive_outline": {"indices": indices}}
    gltf.node(mesh=gltf.mesh(primitive), scale=[-1 if mirrored else 1, 1, 1])
    scene = gltf.load()
    path, *_, warnings = bake(scene, "a.glb", normals=scene.normals.astype(np.float32))
    assert not [line for line in warnings if "outline" in line]
    before, after = GltfValues(scene.path), GltfValues(path)
    (one,) = primitives(after)
    outline = after.array(one["extensions"]["CESIUM_primitive_outline"]["indices"]).reshape(-1, 2)
    triangles = after.corners(one).reshape(-1, 3)
    of_triangles = {frozenset(edge) for edge in triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()}
    assert {frozenset(edge) for edge in outline.tolist()} <= of_triangles
    points = after.array(one["attributes"]["POSITION"])
    expected = {frozenset(map(tuple, POINTS[edge].tolist())) for edge in edges.reshape(-1, 2)}
    assert {frozenset(map(tuple, points[edge].tolist())) for edge in outline} == expected
    assert new_issues(before.path, after.path) == []


def test_polygons_encoded_by_first_vertices_are_not_joined(gltf, rewrite):
    """FB_ngon_encoding: triangles in a row with the same first vertex are one polygon."""
    extend(gltf, "FB_ngon_encoding")
    before, after, warnings = rewrite(corner(gltf, STACKED, extensions={"FB_ngon_encoding": {}}))
    assert not [line for line in warnings if "FB_ngon_encoding" in line]
    (was,), (one,) = primitives(before), primitives(after)
    old, new = before.corners(was)[::3], after.corners(one)[::3]
    assert ((new[1:] == new[:-1]) <= (old[1:] == old[:-1])).all()


def test_an_extension_of_the_mesh_is_told_as_well(gltf, rewrite):
    extend(gltf, "EXT_mesh_manifold")
    *_, warnings = rewrite(corner(gltf, STACKED), extensions={"EXT_mesh_manifold": {"mergeIndices": 0}})
    assert [line for line in warnings if "EXT_mesh_manifold, which may refer" in line]


def test_sparse_targets_stay_sparse(gltf, rewrite):
    primitive = corner(gltf, STACKED)
    moved, still = np.zeros((8, 3), "<f4"), np.zeros((8, 3), "<f4")
    moved[2] = [0, 0, 0.25]
    primitive["targets"] = [
        {"POSITION": gltf.sparse(moved, None, name="moved")},
        {"POSITION": gltf.accessor(still, bufferView=None, min=[0, 0, 0], max=[0, 0, 0])},
    ]
    del gltf.json["accessors"][-1]["bufferView"]
    before, after, _ = rewrite(primitive)
    old, new = primitives(before, after)
    for one, other in zip(old["targets"], new["targets"], strict=True):
        at, was = (document.array(target["POSITION"]) for document, target in ((after, other), (before, one)))
        assert at[after.corners(new)].tolist() == was[before.corners(old)].tolist()
        accessor = after.json["accessors"][other["POSITION"]]
        assert "bufferView" not in accessor
        assert accessor.get("sparse", {"count": 0})["count"] < 4
        assert (accessor["min"], accessor["max"]) == (at.min(0).tolist(), at.max(0).tolist())


TANGENTS = np.array([[0, 1, 0, 1], [0, 0, 1, -1]], "<f4").repeat(4, axis=0)


def test_tangents_are_turned_with_new_normals(gltf, rewrite):
    primitive = corner(gltf, STACKED, material=pictured(gltf, normalTexture={"index": gltf.texture(BLUES)}))
    primitive["attributes"]["TANGENT"] = gltf.vertices(TANGENTS)
    before, after, _ = rewrite(primitive, new_normals=True)
    old, new = primitives(before, after)
    corners = after.corners(new)
    normals, tangents = (after.array(new["attributes"][name])[corners] for name in ("NORMAL", "TANGENT"))
    was = TANGENTS[before.corners(old)]
    assert np.einsum("ni,ni->n", normals, tangents[:, :3]) == pytest.approx(0, abs=1e-6)
    assert np.linalg.norm(tangents[:, :3], axis=1) == pytest.approx(1)
    assert tangents[:, 3].tolist() == was[:, 3].tolist()
    planes = np.cross(was[:, :3], normals)  # those of old tangent and new normal
    assert np.einsum("ni,ni->n", planes, tangents[:, :3]) == pytest.approx(0, abs=1e-6)
    assert (np.einsum("ni,ni->n", was[:, :3], tangents[:, :3]) > 0).all()


def test_tangents_of_kept_normals_are_the_same_bytes(gltf, rewrite):
    primitive = corner(gltf, STACKED)
    primitive["attributes"]["TANGENT"] = gltf.vertices((TANGENTS * 127).astype("<i1"), normalized=True)
    before, after, _ = rewrite(primitive)
    old, new = primitives(before, after)
    at = after.array(new["attributes"]["TANGENT"])
    assert at.dtype == "i1"
    assert at[after.corners(new)].tolist() == before.array(old["attributes"]["TANGENT"])[before.corners(old)].tolist()


@pytest.mark.parametrize("weights", [[], [0, 0], [0, 0.5]], ids=str)
def test_normals_of_morph_targets_stay_but_for_those_in_the_pose(weights, gltf, rewrite):
    primitive = corner(gltf, STACKED)
    lean = np.linspace(0, 0.5, 24, dtype="<f4").reshape(8, 3)
    primitive["targets"] = [{"NORMAL": gltf.vertices(lean)}, {"NORMAL": gltf.vertices(lean[::-1].copy())}]
    mesh = {"weights": weights} if weights else {}
    before, after, warnings = rewrite(primitive, new_normals=True, **mesh)
    old, new = primitives(before, after)
    pairs = zip(new["targets"], old["targets"], weights or [0, 0], strict=True)
    for target, was, weight in pairs:
        values = after.array(target["NORMAL"])[after.corners(new)]
        expected = before.array(was["NORMAL"])[before.corners(old)]
        assert values.tolist() == (expected * (weight == 0)).tolist()
    told = "1 primitive has new normals in the pose of the file, which its morph targets keep"
    assert (told in warnings) == bool(sum(weights))


@needs_validator
def test_all_of_it_is_valid(gltf, tmp_path, bake):
    extend(gltf, "EXT_mesh_features")
    extend(gltf, "KHR_mesh_quantization", required=True)
    primitive = corner(gltf, STACKED, extensions={"EXT_mesh_features": {"featureIds": [{"featureCount": 8}]}})
    primitive["attributes"]["TANGENT"] = gltf.vertices((TANGENTS * 127).astype("<i1"), normalized=True)
    moved = np.zeros((8, 3), "<f4")
    moved[2] = [0, 0, 0.25]
    primitive["targets"] = [{"POSITION": gltf.sparse(moved, None), "NORMAL": gltf.sparse(moved, None)}]
    primitive["material"] = pictured(gltf, normalTexture={"index": gltf.texture(BLUES)})
    gltf.node(mesh=gltf.mesh(primitive, weights=[0.5]))
    scene = gltf.load()
    for normals in (None, scene.normals.astype(np.float32)):
        assert new_issues(scene.path, bake(scene, "a.glb", normals=normals)[0]) == []
