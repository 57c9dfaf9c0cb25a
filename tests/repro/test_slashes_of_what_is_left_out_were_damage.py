"""Faces such as `f 1/1/ 2/2/ 3/3/`, `f 1// 2// 3//` and `f 1/ 2/ 3/` were refused as damaged."""

import itertools

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene

HEAD = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n"
PLAIN = {"{v}": ("{v}", "{v}/", "{v}//", "{v}/0/0", "{v}/0"), "{v}/{v}": ("{v}/{v}", "{v}/{v}/", "{v}/{v}/0")}
PLAIN["{v}//1"] = ("{v}//1", "{v}/0/1")


def read(tmp_path, *corners):
    (tmp_path / "a.obj").write_text(f"{HEAD}f {' '.join(corners)}\n")
    return load_scene(tmp_path / "a.obj")


@pytest.mark.parametrize("meaning", PLAIN)
def test_they_mean_the_corner_without_them(tmp_path, meaning):
    expected = read(tmp_path, *(meaning.format(v=v) for v in (1, 2, 3)))
    for forms in itertools.product(PLAIN[meaning], repeat=3):
        scene = read(tmp_path, *(form.format(v=v) for v, form in zip((1, 2, 3), forms, strict=True)))
        assert np.array_equal(scene.faces, expected.faces)
        assert [np.array_equal(*pair) for pair in zip(scene.uv_sets, expected.uv_sets, strict=True)] == [True] * len(
            expected.uv_sets
        )
        assert (scene.normals is None) == (expected.normals is None)


@pytest.mark.parametrize("corner", ["/", "//", "/1", "//1", "1/2/3/", "1/2/3/4", "1/a", "1///"])
def test_other_corners_are_damage(tmp_path, corner):
    with pytest.raises(InputError, match=r"corners such as|refers to v 0"):
        read(tmp_path, corner, "2", "3")
