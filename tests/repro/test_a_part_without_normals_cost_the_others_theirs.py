"""One part without normals, such as a collision hull in a baked copy, cost all others theirs."""

import numpy as np
import pytest

from aoprecalc import BakeOptions
from aoprecalc.api.bake import bake_file
from aoprecalc.io import load_scene

TILTED = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 3 4\no rock\nf 1//1 2//1 3//1\n"
HULL = "o UCX_rock\nf 1 2 3\nf 3 2 4\n"


def test_the_normals_of_the_others_are_kept_and_smooth_ones_computed(tmp_path):
    (tmp_path / "a.obj").write_text(TILTED + HULL)
    scene = load_scene(tmp_path / "a.obj")
    assert scene.normals[0] == pytest.approx(np.tile([0, 0.6, 0.8], (3, 1)))
    up, side = np.array([0, 0, 1.0]), np.array([-1.0, -1, -1])  # area vectors of the hull's faces
    both = (up + side) / np.linalg.norm(up + side)
    assert scene.normals[1] == pytest.approx(np.array([up, both, both]), abs=1e-6)  # the rock's face has no part in it
    assert scene.warnings == ()
    assert scene.notes == ("1 of 2 parts has no normals: smooth ones were computed there",)


def test_a_baked_copy_has_them_too(tmp_path):
    (tmp_path / "a.obj").write_text(TILTED + HULL)
    baked = tmp_path / "b.obj"
    for mesh in (tmp_path / "a.obj", baked):
        bake_file(mesh, baked if mesh != baked else tmp_path / "c.obj", options=BakeOptions(size=32, directions=64))
    assert load_scene(tmp_path / "c.obj").normals[0] == pytest.approx(np.tile([0, 0.6, 0.8], (3, 1)))
