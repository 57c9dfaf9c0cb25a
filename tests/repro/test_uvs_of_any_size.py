"""UVs of 1e12 overflowed the integers that number them, and NumPy said so on standard error."""

import numpy as np
import pytest

from aoprecalc.files import load_scene
from aoprecalc.texspace.layout import corner_ids
from shapes import quad, quad_uvs


def test_far_uvs_are_numbered_apart():
    faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=4)[1]
    near = quad_uvs((0, 0), (1, 1), cells=4)
    assert (corner_ids(faces, near) == corner_ids(faces, near + 5e4)).all()


@pytest.mark.parametrize("far", ["1e12", "1e300", "-1e30"])
def test_uvs_beyond_use_count_as_missing(tmp_path, far):
    path = tmp_path / "far.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 {far}\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    scene = load_scene(path)
    assert "1 of 1 faces lack usable UVs" in scene.warnings
    assert np.abs(scene.uvs).max() <= 1
