"""Scenes where a clip of a glTF file stands at a time."""

import json

import numpy as np
import pytest

from aoprecalc.errors import ArgumentError, InputError
from aoprecalc.io import load_scene
from aoprecalc.io.meshes import scene_in_pose
from gltf_kit.gltf_animated import box_with_lid, clip, flat_primitive, floats, strip_over_a_joint, turn
from shapes import box

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")


def triangle(maker, **members):
    """A node that shows one triangle with a normal."""
    attributes = {"POSITION": maker.accessor(TRIANGLE), "NORMAL": maker.accessor(floats([[0, 0, 1]] * 3))}
    return maker.node(mesh=maker.mesh({"attributes": attributes}), **members)


def corners(scene, pose):
    return scene_in_pose(scene, pose).corners[0]


def test_a_translation_is_interpolated_and_stays_at_its_ends(gltf):
    node = triangle(gltf)
    clip(gltf, "slide", (node, "translation", [0.5, 1, 3], [[0, 0, 0], [2, 0, 0], [2, 4, 0]]))
    scene = gltf.load()
    for time, offset in [(0, 0), (0.5, 0), (0.75, 1), (1, 2)]:
        assert corners(scene, f"slide@{time}") == pytest.approx(TRIANGLE + (offset, 0, 0))
    assert corners(scene, "slide@2") == pytest.approx(TRIANGLE + (2, 2, 0))
    assert corners(scene, "slide@3") == pytest.approx(TRIANGLE + (2, 4, 0))


def test_steps_last_until_the_next_key(gltf):
    node = triangle(gltf)
    clip(gltf, "jump", (node, "scale", [0, 1], [[1, 1, 1], [2, 2, 2]], "STEP"))
    scene = gltf.load()
    assert np.array_equal(corners(scene, "jump@0.999"), TRIANGLE)
    assert np.array_equal(corners(scene, "jump@1"), 2 * TRIANGLE)


def test_a_cubic_spline_is_the_polynomial_of_its_tangents(gltf):
    """Values and slopes of x^3 at two keys give x^3 between them, whatever the interval."""
    node = triangle(gltf)
    start, end = 1.0, 3.0
    keys = [[[0, 0, 0], [t**3, 0, 0], [3 * t * t, 0, 0]] for t in (start, end)]
    keys[1][0] = [3 * end * end, 0, 0]
    clip(gltf, "curve", (node, "translation", [start, end], np.reshape(keys, (6, 3)), "CUBICSPLINE"))
    scene = gltf.load()
    for time in (1, 1.25, 2, 2.9, 3):
        assert corners(scene, f"curve@{time}") == pytest.approx(TRIANGLE + (time**3, 0, 0), rel=1e-6)
    assert corners(scene, "curve@0.5") == pytest.approx(TRIANGLE + (1, 0, 0))


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_take_the_shorter_arc_at_equal_speed(gltf, sign):
    node = triangle(gltf)
    last = (sign * np.array(turn((0, 0, 1), 120))).tolist()
    clip(gltf, "spin", (node, "rotation", [0, 2], [turn((0, 0, 1), 0), last]))
    scene = gltf.load()
    for time in (0, 0.25, 0.5, 1, 1.7, 2):
        angle = np.radians(60 * time)
        assert corners(scene, f"spin@{time}")[1] == pytest.approx([np.cos(angle), np.sin(angle), 0], abs=1e-6)


def test_a_cubic_spline_of_rotations_has_unit_length(gltf):
    node = triangle(gltf)
    zero = [0, 0, 0, 0]
    keys = [zero, turn((0, 0, 1), 0), zero, zero, turn((0, 0, 1), 90), zero]
    clip(gltf, "spin", (node, "rotation", [0, 1], keys, "CUBICSPLINE"))
    assert corners(gltf.load(), "spin@0.5")[1] == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0], abs=1e-6)


def test_normalized_integers_and_sparse_accessors(gltf):
    node = triangle(gltf)
    quarter = np.round(32767 * np.array([turn((0, 0, 1), 0), turn((0, 0, 1), 90)])).astype("<i2")
    slid = gltf.sparse(floats([[0, 0, 0], [0, 0, 5]]), None)
    clip(
        gltf,
        "both",
        (node, "rotation", [0, 1], gltf.accessor(quarter, normalized=True)),
        (node, "translation", [0, 1], slid),
    )
    assert corners(gltf.load(), "both@1")[1] == pytest.approx([0, 1, 5], abs=1e-4)


def test_morph_weights_move_positions_and_turn_normals(gltf):
    sheet = {"POSITION": gltf.accessor(TRIANGLE), "NORMAL": gltf.accessor(floats([[0, 0, 1]] * 3))}
    targets = [
        {"POSITION": gltf.accessor(floats([[0, 0, 1]] * 3)), "NORMAL": gltf.accessor(floats([[1, 0, -1]] * 3))},
        {"POSITION": gltf.accessor(floats([[0, 2, 0]] * 3))},
    ]
    node = gltf.node(mesh=gltf.mesh({"attributes": sheet, "targets": targets}, weights=[0, 0.5]))
    clip(gltf, "rise", (node, "weights", [0, 1], [0, 0.5, 1, 0]))
    scene = gltf.load()
    assert scene.corners[0] == pytest.approx(TRIANGLE + (0, 1, 0))
    half = scene_in_pose(scene, "rise@0.5")
    assert half.corners[0] == pytest.approx(TRIANGLE + (0, 0.5, 0.5))
    assert half.normals[0, 0] == pytest.approx([np.sqrt(0.5), 0, np.sqrt(0.5)])
    assert scene_in_pose(scene, "rise@1").normals[0, 0] == pytest.approx([1, 0, 0])


def test_a_skinned_strip_bends_at_its_joint(gltf):
    scene = strip_over_a_joint(gltf).load()
    bent = scene_in_pose(scene, "bend@1")
    moved = (scene.corners >= -1e-9).all(axis=1)[:, 0]
    x, y, z = np.moveaxis(scene.corners[moved], -1, 0)
    assert moved.sum() == 2
    assert bent.corners[moved] == pytest.approx(np.stack([-y, x, z], axis=-1), abs=1e-6)
    assert bent.normals[moved] == pytest.approx(np.broadcast_to([-1, 0, 0], (2, 3, 3)), abs=1e-6)
    assert np.array_equal(bent.corners[~moved], scene.corners[~moved])


def test_children_move_with_their_parents(gltf):
    child = triangle(gltf, translation=[1, 0, 0])
    parent = gltf.node(children=[child])
    clip(gltf, "spin", (parent, "rotation", [0, 1], [turn((0, 0, 1), 0), turn((0, 0, 1), 90)]))
    assert corners(gltf.load(), "spin@1")[0] == pytest.approx([0, 1, 0], abs=1e-6)


def test_a_pose_that_mirrors_keeps_the_corners_and_turns_the_normals(gltf):
    node = gltf.node(mesh=gltf.mesh(flat_primitive(gltf, box())))
    clip(gltf, "flip", (node, "scale", [0, 1], [[1, 1, 1], [-1, 1, 1]]))
    scene = gltf.load()
    flipped = scene_in_pose(scene, "flip@1")
    assert np.array_equal(flipped.corners, scene.corners * (-1, 1, 1))
    assert flipped.normals == pytest.approx(scene.normals * (-1, 1, 1))


def test_faces_that_are_scaled_away_stay_in_their_order(gltf):
    triangle(gltf)
    node = triangle(gltf, translation=[0, 0, 1])
    clip(gltf, "hide", (node, "scale", [0, 1], [[1, 1, 1], [0, 0, 0]]))
    hidden = scene_in_pose(gltf.load(), "hide@1")
    assert np.array_equal(hidden.corners[0], TRIANGLE)
    assert np.array_equal(hidden.corners[1], np.broadcast_to([0, 0, 1], (3, 3)))


def test_the_pose_of_the_first_key_may_be_the_rest_pose(gltf):
    scene = box_with_lid(gltf).load()
    closed = scene_in_pose(scene, "open@0")
    assert np.array_equal(closed.corners, scene.corners)
    assert np.array_equal(closed.normals, scene.normals)


def test_clips_are_found_by_name_or_by_number(gltf):
    node = triangle(gltf)
    for name, x in ((None, 1), ("2", 2), ("a@b", 3)):
        clip(gltf, name, (node, "translation", [0], [[x, 0, 0]]))
    scene = gltf.load()
    found = [corners(scene, f"{name}@0")[0, 0] for name in ("0", "2", "1", "a@b")]
    assert found == [1, 2, 2, 3]


def failure(scene, pose):
    with pytest.raises(ArgumentError) as raised:
        scene_in_pose(scene, pose)
    return str(raised.value)


def test_errors_name_the_clips_and_the_range(gltf):
    node = triangle(gltf)
    clip(gltf, "walk", (node, "translation", [0.25, 1.5], [[0, 0, 0], [1, 0, 0]]))
    clip(gltf, None, (node, "translation", [0], [[0, 0, 0]]))
    scene = gltf.load()
    assert "'wakl' is no animation (did you mean 'walk'?); expected one of 'walk', '1'" in failure(scene, "wakl@1")
    assert "'walk' of" in failure(scene, "walk@1.6")
    assert "lasts from 0 to 1.5 seconds" in failure(scene, "walk@1.6")


def test_errors_where_nothing_moves(gltf, cube_obj):
    triangle(gltf)
    assert "has no animations; omit it" in failure(gltf.load(), "walk@1")
    assert "is OBJ, and only glTF has poses" in failure(load_scene(cube_obj), "walk@1")


def test_what_is_no_property_of_a_node_is_named(gltf):
    node = triangle(gltf)
    clip(gltf, "glow", (node, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]]))
    pointer = {"pointer": "/materials/0/emissiveFactor"}
    target = {"path": "pointer", "extensions": {"KHR_animation_pointer": pointer}}
    gltf.json["animations"][0]["channels"].append({"sampler": 0, "target": target})
    posed = scene_in_pose(gltf.load(), "glow@1")
    assert posed.corners[0] == pytest.approx(TRIANGLE + (1, 0, 0))
    assert len(posed.warnings) == 1
    assert "/materials/0/emissiveFactor (KHR_animation_pointer)" in posed.warnings[0]


def times_that_fall(document):
    document["accessors"][document["animations"][0]["samplers"][0]["input"]]["byteOffset"] = 4


def too_few_values(document):
    document["accessors"][document["animations"][0]["samplers"][0]["output"]]["count"] = 1


def no_such_node(document):
    document["animations"][0]["channels"][0]["target"]["node"] = 99


def no_such_sampler(document):
    document["animations"][0]["channels"][0]["sampler"] = 99


def a_matrix(document):
    document["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()


def a_width_of_another_property(document):
    document["animations"][0]["channels"][0]["target"]["path"] = "rotation"


@pytest.mark.parametrize(
    "damage",
    [times_that_fall, too_few_values, no_such_node, no_such_sampler, a_matrix, a_width_of_another_property],
    ids=lambda damage: damage.__name__,
)
def test_a_damaged_clip_is_one_line(gltf, save, damage):
    node = triangle(gltf)
    clip(gltf, "walk", (node, "translation", [0, 1, 0.5], [[0, 0, 0], [1, 0, 0], [2, 0, 0]]))
    for end in ("input", "output"):
        gltf.json["accessors"][gltf.json["animations"][0]["samplers"][0][end]]["count"] = 2
    path = gltf.save("made.gltf")
    document = json.loads(path.read_text())
    damage(document)
    scene = load_scene(save("damaged.gltf", json.dumps(document)))
    with pytest.raises(InputError) as raised:
        scene_in_pose(scene, "walk@0.5")
    assert "the file is damaged" in str(raised.value)
    assert "\n" not in str(raised.value)
