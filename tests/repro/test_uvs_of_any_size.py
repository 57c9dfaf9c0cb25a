"""UVs of 1e12 overflowed the integers that number them, and NumPy said so on standard error."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions
from aoprecalc.raster.layout import corner_ids
from shapes import join, quad, quad_uvs, scene


def test_far_uvs_are_numbered_apart():
    faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)[1]
    near = quad_uvs((0, 0), (1, 1), cells=4)
    assert (corner_ids(faces, near) == corner_ids(faces, near + 5e4)).all()


@pytest.mark.parametrize("far", ["1e12", "1e300", "-1e30"])
def test_uvs_beyond_use_count_as_missing(tmp_path, far):
    path = tmp_path / "far.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 {far}\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    scene = load_scene(path)
    assert "1 of 1 face lacks usable UVs" in scene.warnings
    assert np.abs(scene.uvs).max() <= 1


def test_uvs_far_away_that_repeat_give_the_same_picture():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)
    wall = quad((0.5, 0, 0), (0, 1, 0), (0, 0, 1), cells=4)
    places = [((0.125, 0.125), (0.5, 0.5)), ((0.625, 0.625), (0.875, 0.875))]
    uvs = np.concatenate([quad_uvs(low, high, cells=4) for low, high in places])
    options = BakeOptions(size=64, directions=384, unwrap="keep", shadow_size=128)
    near, far = (
        bake_scene(scene(*join((positions, faces), wall), uvs + away), options).texture for away in (1.0, 16385.0)
    )
    assert near.values[near.valid].std() > 0.1
    assert (near.values == far.values).all()
