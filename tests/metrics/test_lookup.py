"""Pictures are read as a renderer reads them."""

from itertools import pairwise, product

import numpy as np
import pytest

from aoprecalc.texture_lookup import bilinear, bilinear_taps, mip_chain, repeating_texture


def ramp(width, height):
    """A picture that is 0.2 + 0.5 u + 0.3 v at the centres of its texels."""
    u = (np.arange(width) + 0.5) / width
    v = 1 - (np.arange(height) + 0.5) / height
    return np.add.outer(0.3 * v, 0.2 + 0.5 * u).astype(np.float32)


@pytest.mark.parametrize("repeats", [False, True])
def test_a_linear_ramp_is_exact_between_the_outer_centres(repeats):
    uvs = np.random.default_rng(0).uniform(0.06, 0.94, (1000, 2))
    found = bilinear(ramp(32, 9), uvs, repeats=repeats)
    assert np.abs(found - (0.2 + uvs @ [0.5, 0.3])).max() < 1e-6


def test_row_0_is_at_the_top():
    picture = np.array([[1, 1], [0, 0]], np.float32)
    assert bilinear(picture, np.array([[0.5, 0.9], [0.5, 0.1]]), repeats=False).tolist() == [1, 0]


def test_the_seam_blends_where_the_picture_repeats_and_stays_where_it_is_clamped():
    picture = np.array([[0, 0.2, 1.0]], np.float32)
    at = np.array([[0.0, 0.5], [1.0, 0.5], [-2.0, 0.5], [1 + 1 / 6, 3.5]])
    assert bilinear(picture, at, repeats=True) == pytest.approx([0.5, 0.5, 0.5, 0], abs=1e-6)
    assert bilinear(picture, at, repeats=False) == pytest.approx([0, 1, 0, 1])


@pytest.mark.parametrize("shape", [(64, 64), (32, 128), (9, 7), (1, 5), (33, 2), (3, 3)])
def test_every_level_keeps_the_mean(shape):
    picture = np.random.default_rng(1).random(shape).astype(np.float32)
    chain = mip_chain(picture, 20)
    assert chain[0] is picture
    assert chain[-1].shape == (1, 1)
    for fine, coarse in pairwise(chain):
        assert coarse.shape == tuple(max(1, side // 2) for side in fine.shape)
        assert coarse.mean() == pytest.approx(picture.mean(), abs=1e-6)


def test_levels_are_two_by_two_means():
    picture = np.arange(16, dtype=np.float32).reshape(4, 4)
    assert mip_chain(picture, 2)[1].tolist() == [[2.5, 4.5], [10.5, 12.5]]
    assert len(mip_chain(picture, 2)) == 2


def test_an_odd_row_is_shared_by_length():
    (level,) = mip_chain(np.array([[0, 0, 5, 0, 0]], np.float32), 2)[1:]
    assert level.tolist() == [[1, 1]]


@pytest.mark.parametrize("wraps", list(product(["repeat", "mirror", "clamp"], repeat=2)))
def test_a_repeating_texture_stands_for_every_wrap_mode(wraps):
    """Against look-ups with the wrap modes themselves, at UVs on all sides of the texture."""
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 256, (5, 7, 1), np.uint8)
    uvs = rng.uniform(-0.5, 1.5, (200, 2))

    def look_up(image, uvs, wraps):
        height, width = image.shape
        left, right, across = bilinear_taps(uvs[:, 0] * width, width, wraps[0])
        above, below, down = bilinear_taps((1 - uvs[:, 1]) * height, height, wraps[1])
        upper = image[above, left] * (1 - across) + image[above, right] * across
        return upper * (1 - down) + (image[below, left] * (1 - across) + image[below, right] * across) * down

    repeating, moved = repeating_texture(texture, uvs, wraps)
    expected = look_up(texture[..., 0].astype(float), uvs, wraps)
    assert np.allclose(look_up(repeating[..., 0].astype(float), moved, ("repeat", "repeat")), expected, atol=1e-9)
