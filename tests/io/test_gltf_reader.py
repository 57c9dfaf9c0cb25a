import base64

import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")


def face_normals(scene):
    edges = scene.corners[:, 1:] - scene.corners[:, :1]
    return np.cross(edges[:, 0], edges[:, 1])


def test_a_cube_is_a_cube(gltf_cube, cube):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive), name="box")
    for name in ("made.glb", "made.gltf"):
        scene = maker.load(name)
        assert scene.format == name[5:]
        assert len(scene.positions) == 8
        assert trimesh.Trimesh(scene.positions, scene.faces, process=False).volume == pytest.approx(8)
        assert np.array_equal(scene.normals, np.tile(cube[2], (2, 1))[:, None].repeat(3, axis=1))
        assert scene.uvs[0].tolist() == [[0, 1], [0.25, 1], [0.25, 0.75]]
        assert [part.name for part in scene.parts] == ["box"]


def test_nodes_place_instances_in_the_world(gltf):
    up = gltf.accessor(np.tile(np.array([0, 0, 2], dtype="<f4"), (3, 1)))
    mesh = gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE), "NORMAL": up}})
    turn = {"rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]}  # a quarter turn about z
    child = gltf.node(mesh=mesh, name="child", translation=[1, 0, 0], scale=[1, 3, 1])
    gltf.node(name="parent", children=[child], translation=[0, 0, 5], **turn)
    gltf.node(mesh=mesh, name="lifted", matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 7, 1])
    scene = gltf.load()
    assert scene.corners[0] == pytest.approx(np.array([[0, 1, 5], [0, 2, 5], [-3, 1, 5]]), abs=1e-12)
    assert scene.corners[1] == pytest.approx(TRIANGLE + np.array([0, 0, 7]))
    assert [part.name for part in scene.parts] == ["child", "lifted"]
    assert scene.normals == pytest.approx(np.broadcast_to([0, 0, 1], (2, 3, 3)), abs=1e-6)


@pytest.mark.parametrize("scale", [[-1, 1, 1], [2, -1, 1], [-1, -3, -1], [-1, -1, 1], [1, 2, 0.5]])
def test_mirrors_keep_the_outside_out(gltf_cube, scale):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive), scale=scale)
    scene = maker.load()
    assert trimesh.Trimesh(scene.positions, scene.faces, process=False).volume == pytest.approx(8 * abs(np.prod(scale)))
    assert np.all(np.einsum("fk,fck->fc", face_normals(scene), scene.normals) > 0)


def test_normals_stay_upright_under_uneven_scale(gltf):
    slope = np.array([[0, 0, 0], [1, 0, -1], [0, 1, 0]], dtype="<f4")  # normal (1, 0, 1)
    normal = np.tile(np.array([[1, 0, 1]], dtype="<f4"), (3, 1))
    mesh = gltf.mesh({"attributes": {"POSITION": gltf.accessor(slope), "NORMAL": gltf.accessor(normal)}})
    gltf.node(mesh=mesh, scale=[-4, 1, 0.5])
    scene = gltf.load()
    expected = face_normals(scene)[0] / np.linalg.norm(face_normals(scene)[0])
    assert scene.normals[0] == pytest.approx(np.tile(expected, (3, 1)), abs=1e-6)


def test_only_the_shown_scene_is_read(gltf):
    mesh = gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}})
    gltf.node(mesh=mesh, name="hidden")
    gltf.node(mesh=mesh, name="shown")
    gltf.json |= {"scenes": [{"nodes": [0]}, {"nodes": [1]}], "scene": 1}
    assert [part.name for part in gltf.load().parts] == ["shown"]
    gltf.json["scenes"] = []
    assert [part.name for part in gltf.load().parts] == ["hidden", "shown"]


def test_quantised_normalised_and_interleaved(gltf):
    # One view of 12 bytes a vertex: int16 position, padding, uint16 UV.
    rows = np.zeros(3, dtype=[("position", "<i2", 3), ("gap", "<u2"), ("uv", "<u2", 2)])
    rows["position"] = [[0, 0, 0], [32767, 0, 0], [0, -32768, 0]]
    rows["uv"] = [[0, 0], [65535, 0], [0, 13107]]
    view = gltf.view(rows.tobytes(), byteStride=12)
    position = gltf.accessor(rows["position"], bufferView=view, normalized=True)
    uv = gltf.accessor(rows["uv"], bufferView=view, byteOffset=8, normalized=True)
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": position, "TEXCOORD_0": uv}}))
    scene = gltf.load()
    assert scene.corners[0].tolist() == [[0, 0, 0], [1, 0, 0], [0, -1, 0]]
    assert scene.uvs[0] == pytest.approx(np.array([[0, 1], [1, 1], [0, 0.8]]))


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessors(gltf, based):
    view = gltf.view(np.array([1, 2], dtype="<u1").tobytes())
    values = gltf.view(TRIANGLE[1:].tobytes())
    sparse = {"count": 2, "indices": {"bufferView": view, "componentType": 5121}, "values": {"bufferView": values}}
    base = {"bufferView": gltf.view(np.zeros((3, 3), "<f4").tobytes())} if based else {}
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE, sparse=sparse, **base)}}))
    assert np.array_equal(gltf.load().corners[0], TRIANGLE)


@pytest.mark.parametrize(
    ("mode", "indices", "faces"),
    [
        (4, [0, 1, 2, 2, 1, 3], 2),
        (4, None, 1),
        (5, [0, 1, 2, 3], 2),
        (5, [0, 1, 2, 2, 3], 1),
        (6, [0, 1, 3, 2], 2),
    ],
)
def test_triangles_strips_and_fans_face_the_same_way(gltf, mode, indices, faces):
    primitive = {"attributes": {"POSITION": gltf.accessor(SQUARE)}, "mode": mode}
    if indices:
        primitive["indices"] = gltf.accessor(np.array(indices, dtype="<u1"))
    gltf.node(mesh=gltf.mesh(primitive))
    assert face_normals(gltf.load()).tolist() == [[0, 0, 1]] * faces


def test_points_and_lines_are_left_out(gltf):
    position = gltf.accessor(TRIANGLE)
    gltf.node(mesh=gltf.mesh(*({"attributes": {"POSITION": position}, "mode": mode} for mode in (0, 1, 4))))
    scene = gltf.load()
    assert len(scene.faces) == 1
    assert "2 primitives of points or lines" in scene.notes[0]


def test_skinned_meshes_stand_as_their_joints_do(gltf):
    joints = gltf.accessor(np.array([[0, 1, 0, 0]] * 3, dtype="<u1"))
    weights = gltf.accessor(np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]], dtype="<f4"))
    attributes = {"POSITION": gltf.accessor(TRIANGLE), "JOINTS_0": joints, "WEIGHTS_0": weights}
    still, lifted = gltf.node(), gltf.node(translation=[0, 0, 4])
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 3, 2] = -2  # column-major: the second joint was at z = 2 when it was bound
    gltf.json["skins"] = [{"joints": [still, lifted], "inverseBindMatrices": gltf.accessor(inverse.reshape(2, 16))}]
    gltf.node(mesh=gltf.mesh({"attributes": attributes}), skin=0, translation=[9, 9, 9])
    assert gltf.load().corners[0] == pytest.approx(TRIANGLE + np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2]]))


def test_buffers_beside_the_file(gltf, save):
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}}))
    path = gltf.save("made.gltf")
    data = path.read_text()
    uri = "data:application/octet-stream;base64," + base64.b64encode(gltf.data).decode()
    assert uri in data
    path.write_text(data.replace(uri, "the%20data.bin"))
    with pytest.raises(InputError, match="cannot be read"):
        load_scene(path)
    save("the data.bin", bytes(gltf.data))
    assert np.array_equal(load_scene(path).corners[0], TRIANGLE)
    save("the data.bin", bytes(gltf.data[:-1]))
    with pytest.raises(InputError, match="buffer 0 of 36 bytes was expected, but it has 35"):
        load_scene(path)
    path.write_text(data.replace(uri, "https://example.org/a.bin"))
    with pytest.raises(InputError, match="a file beside it was expected"):
        load_scene(path)


def remove_version(json):
    del json["asset"]["version"]


def point_outside(json):
    json["accessors"][0]["count"] = 10**15


def stand_still(json):
    json["accessors"][0]["count"] = 10**15
    json["bufferViews"][0]["byteStride"] = 0


def promise_zeros(json):
    json["accessors"][0] = {"componentType": 5126, "type": "VEC3", "count": 10**15}


def leave_the_buffer(json):
    json["bufferViews"][0]["byteLength"] = 10**9


def name_no_accessor(json):
    json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (remove_version, "asset.version"),
        (lambda json: json["asset"].update(version="1.0"), "is glTF '1.0'"),
        (point_outside, "buffer view 0 has 36 bytes"),
        (stand_still, "buffer view 0 has 36 bytes"),
        (promise_zeros, "more than its buffers can hold"),
        (leave_the_buffer, "its buffer at 36"),
        (name_no_accessor, "entry 9 of accessors, but there are 1"),
        (lambda json: json.update(textures=[{"source": 0}]), "entry 0 of images, but there are 0"),
        (
            lambda json: json.update(images=[{"uri": "a"}], textures=[{"source": 0, "sampler": 2}]),
            "entry 2 of samplers",
        ),
        (
            lambda json: json.update(materials=[{"emissiveTexture": {"index": 1}}]),
            "entry 1 of textures, but there are 0",
        ),
        (lambda json: json["nodes"].append({"children": [0, 1]}), "no faces"),
        (lambda json: json["nodes"][0].update(children=[0]), "no faces"),
        (lambda json: json.update(scenes=[{"nodes": [0, 0]}]), "node 0 is reached twice"),
        (lambda json: json["nodes"][0].update(scale=[float("nan")] * 3), "not finite"),
    ],
)
def test_damage_is_told_in_one_line(gltf, change, said):
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}}))
    change(gltf.json)
    with pytest.raises(InputError) as failure:
        gltf.load()
    assert said in str(failure.value)
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize("length", [3, 11, 19, 40, 200, -1])
def test_a_glb_that_is_cut_off(gltf, length):
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}}))
    path = gltf.save()
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(InputError):
        load_scene(path)


def test_other_scenes_and_extensions_that_are_not_known_are_told(gltf):
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": gltf.accessor(TRIANGLE)}}))
    gltf.json |= {"scene": 1, "scenes": [{"nodes": []}, {"nodes": [0]}], "extensionsRequired": ["FOO_bar"]}
    scene = gltf.load()
    assert any("2 scenes" in line and "index 1" in line for line in scene.notes)
    assert any("requires FOO_bar" in line for line in scene.warnings)
