import numpy as np
import pytest
import trimesh

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene


def test_quads_groups_uvs_and_normals_are_as_in_the_file(cube_obj, cube):
    points, quads, normals, _ = cube
    scene = load_scene(cube_obj)
    assert np.array_equal(scene.positions, points)
    assert scene.faces.shape == (12, 3)
    assert [(part.name, part.start, part.stop) for part in scene.parts] == [("half 0", 0, 4), ("half 2", 4, 12)]
    for face in range(12):
        side = face // 2
        at = [0, 1, 2] if face % 2 == 0 else [0, 2, 3]
        assert np.array_equal(scene.faces[face], quads[side][at])
        assert np.array_equal(scene.normals[face], np.tile(normals[side], (3, 1)))
        numbers = [4 * side + corner for corner in at]
        assert scene.uvs[face].tolist() == [[n % 4 / 4, float(f"{n // 4 / 7:.6f}")] for n in numbers]
    assert scene.warnings == ()


def test_the_surface_is_the_one_that_trimesh_reads(cube_obj):
    theirs = trimesh.load_scene(cube_obj, process=False).to_mesh()
    scene = load_scene(cube_obj)
    ours = trimesh.Trimesh(scene.positions, scene.faces, process=False)
    assert ours.is_watertight
    assert ours.volume == pytest.approx(8.0)
    assert ours.volume == pytest.approx(theirs.volume)


def test_relative_indices_count_from_where_they_stand(save):
    first = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
    scene = load_scene(save("a.obj", first + "v 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 -1\n"))
    assert scene.corners[:, :, 2].tolist() == [[0, 0, 0], [5, 5, 5]]


def test_equal_positions_are_welded_and_unused_ones_left_out(save):
    scene = load_scene(save("a.obj", "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 0\nv 1 1 0\nf 2 3 4\nf 5 4 6\n"))
    assert len(scene.positions) == 4
    assert scene.faces[0][0] == scene.faces[1][0]


def test_corners_without_uv_or_normal_are_told_and_filled(save):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1 1\nvn 0 3 4\nf 1/1/1 2/1/1 3/1/1\nf 1/1/1 2/1 3\n"
    scene = load_scene(save("a.obj", text))
    assert scene.normals[0] == pytest.approx(np.tile([0, 0.6, 0.8], (3, 1)))
    assert scene.normals[1] == pytest.approx(np.array([[0, 0.6, 0.8], [0, 0, 1], [0, 0, 1]]))
    assert scene.uvs[1].tolist() == [[1, 1], [1, 1], [0, 0]]
    assert [len(lines) for lines in (scene.warnings, scene.notes)] == [1, 1]


def test_odd_writing(save):
    text = "\ufeffv 0 0 0 1\r\nv\t1 0\t0 0.5 0.5 0.5\r\nv 0 1 \\\r\n0\r\nf 1 2 3 # a face\r\nl 1 2\r\nf 1 2\r\n"
    scene = load_scene(save("a.OBJ", text))
    assert len(scene.positions) == 3
    assert len(scene.faces) == 1
    assert scene.warnings == ("1 face of fewer than 3 corners is skipped",)


def test_faces_without_area_stay_and_are_counted(save):
    scene = load_scene(save("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 2\nf 1 2 4\n"))
    assert len(scene.faces) == 3
    assert "2 of 3 faces have no area" in scene.notes[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "refers to v 4, but there are 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "refers to v 0, but there are 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 1 2\n", "refers to v -4, but there are 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n", "refers to vt 1, but there are 0"),
        ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "number 2 is '1 x 0'"),
        ("v 0 0\nf 1 1 1\n", "number 1 is '0 0'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 c\n", "a face is '1 2 c'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/2/3/4 2 3\n", "a face is '1/2/3/4 2 3'"),
        ("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "not finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1e300 0\nf 1 2 3\n", "not finite or of no usable size"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "3 points but no faces"),
        ("hello\n", "no faces"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "none of 1 face has any area"),
        ("v 0 0 0\nv 1e-80 0 0\nv 0 1e-80 0\nf 1 2 3\n", "is 1e-80 units across"),
    ],
)
def test_damage_is_told_in_one_line(save, text, said):
    path = save("a.obj", text)
    with pytest.raises(InputError) as failure:
        load_scene(path)
    message = str(failure.value)
    assert said in message
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
