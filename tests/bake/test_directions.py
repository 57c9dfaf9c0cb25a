"""Directions: unit, uniform, and even in every group."""

import numpy as np
import pytest

from aoprecalc.visibility.directions import GROUP_SIZE, axis_groups, light_axes, texel_offset


def unevenness(axes):
    """How far the second moments of the axes are from those of the sphere, I / 3."""
    return np.abs(axes.T @ axes / len(axes) - np.eye(3) / 3).max()


@pytest.mark.parametrize("count", [2, 3, 100, 256, 1000, 4096])
@pytest.mark.parametrize("sampling", ["fibonacci", "random"])
def test_axes_are_distinct_unit_vectors_half_as_many(count, sampling):
    found = light_axes(count, sampling, seed=4)
    assert len(found) == (count + 1) // 2
    assert np.linalg.norm(found, axis=1) == pytest.approx(1)
    cosines = np.abs(found @ found.T) - np.eye(len(found))
    assert cosines.max() < 1 - 1e-9


@pytest.mark.parametrize("count", [256, 500, 1000, 1024, 2000, 4096, 10000])
def test_every_group_is_even(count):
    found = light_axes(count)
    whole = [group for group in axis_groups(len(found)) if group.stop - group.start == GROUP_SIZE]
    assert max(unevenness(found[group]) for group in whole) < 0.03
    # In its own order the lattice sweeps from equator to pole, which the same bound must refuse.
    swept = found[np.argsort(found[:, 2])]
    assert unevenness(swept[:GROUP_SIZE]) > 0.1


@pytest.mark.parametrize(("group_size", "bound"), [(8, 0.2), (16, 0.08), (32, 0.05), (128, 0.01), (512, 0.01)])
def test_groups_of_other_sizes_are_even_too(group_size, bound):
    found = light_axes(18 * group_size, group_size=group_size)
    groups = axis_groups(len(found), group_size)
    assert [group.stop - group.start for group in groups] == [group_size] * 9
    assert max(unevenness(found[group]) for group in groups) < bound
    assert unevenness(found[np.argsort(found[:, 2])][:group_size]) > bound


def test_groups_cover_all_axes_in_order():
    assert [axis for group in axis_groups(150) for axis in range(group.start, group.stop)] == list(range(150))


def test_random_axes_are_uniform():
    found = light_axes(100_000, "random", seed=1)
    assert np.abs(found).mean(axis=0) == pytest.approx(0.5, abs=0.01)


def test_texel_offsets_start_at_the_centre_and_fill_the_square():
    offsets = np.array([texel_offset(group) for group in range(64)])
    assert tuple(offsets[0]) == (0.5, 0.5)
    counts = np.histogram2d(*offsets.T, bins=4, range=[[0, 1], [0, 1]])[0]
    assert counts.min() >= 2
