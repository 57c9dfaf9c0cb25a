"""What is the same for every kind of file."""

import os

import pytest

from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import load_scene

KINDS = ("obj", "ply", "stl", "off", "gltf", "glb", "dae", "3mf")


def test_an_unknown_extension_names_the_known_ones(save):
    with pytest.raises(UsageError) as failure:
        load_scene(save("model.blend", "x"))
    assert all(f".{kind}" in str(failure.value) for kind in KINDS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "there is no such file"),
        (b"", "is empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "git lfs pull"),
        (bytes(range(256)) * 40, ""),
        (b"\xff" * 300, ""),
        (b'{"asset": {"version": "2.0"}, "meshes": 3, "nodes": [{"mesh": 0}]}', ""),
    ],
)
def test_rubbish_is_told_in_one_line(save, tmp_path, kind, content, said, capfd, recwarn):
    path = tmp_path / f"a.{kind}" if content is None else save(f"a.{kind}", content)
    with pytest.raises(InputError) as failure:
        load_scene(path)
    assert said in str(failure.value)
    assert "\n" not in str(failure.value)
    assert capfd.readouterr() == ("", "")
    assert not recwarn.list


def test_a_folder_is_no_mesh(tmp_path):
    with pytest.raises(InputError, match="is a folder"):
        load_scene(tmp_path)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.obj")
    with pytest.raises(InputError, match="a pipe"):
        load_scene(tmp_path / "a.obj")
