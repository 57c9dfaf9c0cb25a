"""Levels: sets of several finenesses, each sphere with a parent in the next coarser one."""

import json
from itertools import pairwise

import numpy as np
import pytest

import shapes
from aoprecalc.io.sphere_files import sphere_document
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.spheres.fit import assign_parents
from aoprecalc.types import SphereSet

SCENE = shapes.scene(*shapes.clutter(1, boxes=3))


def fitted(**chosen):
    return fit_sphere_set(SCENE, SphereOptions(samples=2000, **chosen), Progress())


def chain(spheres):
    """The finest level, and those above it."""
    return [spheres, *chain(spheres.coarser)] if spheres.coarser is not None else [spheres]


def some(count, seed):
    random = np.random.default_rng(seed)
    return SphereSet(random.normal(size=(count, 3)), random.uniform(0, 0.6, count), 1, True, "lloyd", "mean", 9, 0)


@pytest.mark.parametrize("seed", range(5))
def test_the_parent_is_the_sphere_whose_surface_is_nearest(seed):
    finer, coarser = some(40, seed), some(7, seed + 100)
    found = assign_parents(finer, coarser)
    for center, parent in zip(finer.centers, found, strict=True):
        away = [np.linalg.norm(center - other) - radius
                for other, radius in zip(coarser.centers, coarser.radii, strict=True)]  # fmt: skip
        assert parent == int(np.argmin(away))
    assert len(set(found.tolist())) > 1
    assert found.dtype == np.int32


@pytest.mark.parametrize(
    ("method", "levels"),
    [
        ("lloyd", (1, 5, 20, 60)),
        ("algebraic", (3, 4)),
        pytest.param("shadow", (2, 5), marks=pytest.mark.slow),
        ("lloyd", (6,)),
    ],
)
def test_each_level_is_the_plain_fit_of_its_number(method, levels):
    found, quality = fitted(method=method, levels=levels)
    down = chain(found)
    assert [len(level) for level in down] == list(levels[::-1])
    for level in down:
        plain, plain_quality = fitted(method=method, spheres=len(level))
        assert level.centers.tobytes() == plain.centers.tobytes()
        assert level.radii.tobytes() == plain.radii.tobytes()
        if level is found:
            assert quality == plain_quality
    assert down[-1].parents is None
    for finer, coarser in pairwise(down):
        assert ((finer.parents >= 0) & (finer.parents < len(coarser))).all()
        np.testing.assert_array_equal(finer.parents, assign_parents(finer, coarser))


def test_the_document_holds_the_levels_and_the_parents():
    found, quality = fitted(levels=(2, 5, 11))
    document = json.loads(sphere_document(found, quality))
    rows = [*(level["spheres"] for level in document["levels"]), document["spheres"]]
    assert [len(level) for level in rows] == [2, 5, 11]
    for level, spheres in zip(rows, chain(found)[::-1], strict=True):
        np.testing.assert_array_equal([row["center"] for row in level], spheres.centers)
        np.testing.assert_array_equal([row["radius"] for row in level], spheres.radii)
        if spheres.parents is None:
            assert all("parent" not in row for row in level)
        else:
            assert [row["parent"] for row in level] == spheres.parents.tolist()
    assert document["quality"] == quality


def test_without_levels_there_are_none_in_the_document():
    found, quality = fitted(spheres=3)
    document = json.loads(sphere_document(found, quality))
    assert found.coarser is found.parents is None
    assert "levels" not in document
    assert all(set(row) == {"center", "radius"} for row in document["spheres"])
