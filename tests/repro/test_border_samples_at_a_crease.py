"""Samples of border texels lay on the border itself: at a crease inside the wall, which light then passed."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from shapes import box, join, quad, quad_uvs, scene


def test_the_first_texel_beside_a_wall_is_as_dark_as_the_next():
    floor = quad((0, -2, 0), (4, 0, 0), (0, 4, 0))
    block = box((-1.5, -2, -0.5), (0, 2, 1))
    around = np.full((len(block[1]), 3, 2), 0.9) + np.random.default_rng(0).uniform(0, 0.09, (len(block[1]), 3, 2))
    uvs = np.concatenate([quad_uvs((0, 0), (0.75, 1)), around])
    options = BakeOptions(width=256, height=192, normals="flat", unwrap="keep", padding=0)
    made = scene(*join(floor, block), uvs)
    # The block's UVs overlap on purpose; only the floor's texels are looked at.
    picture = bake_scene(made, options).texture.values
    first, second = picture[80:112, 0].mean(), picture[80:112, 1].mean()
    assert 0.4 < first <= second + 0.01


@pytest.mark.slow
def test_the_inside_of_a_box_is_dark_up_to_its_edges():
    positions, faces = box()
    texture = bake_scene(
        scene(positions, faces[:, ::-1]), BakeOptions(width=256, height=256, normals="flat", shadow_size=1024)
    ).texture
    values = texture.values[texture.valid]
    assert values.mean() < 0.01
    assert np.quantile(values, 0.95) < 0.02
