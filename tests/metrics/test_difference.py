"""Differences are what they can be worked out to be, whatever kind of value is compared."""

from itertools import permutations

import numpy as np
import pytest

from aoprecalc.metrics import result_difference as spheres_module
from aoprecalc.metrics.difference import (
    ComparedMesh,
    ComparedTexture,
    mesh_difference,
    picture_difference,
)
from aoprecalc.metrics.result_difference import document_difference, spheres_difference
from shapes import quad, quad_uvs

RNG = np.random.default_rng(0)


def picture(*shape):
    return RNG.random(shape).astype(np.float32)


def compared(first, second, *covered):
    """The difference of pictures; `covered` is the surface of both, or of each."""
    surfaces = covered * (2 // len(covered)) if covered else (None, None)
    return picture_difference(*map(ComparedTexture, (first, second), surfaces))


@pytest.mark.parametrize("offset", [0.25, -0.125])
def test_a_constant_offset_is_rms_bias_and_maximum(offset):
    first = np.full((20, 30, 1), 0.5, np.float32)
    found = compared(first, first + np.float32(offset))
    assert found.value == abs(offset)
    assert not found.equal
    assert found.details["surface"] is None
    details = found.details | found.details["picture"]
    assert (details["width"], details["height"], details["channel"]) == (30, 20, 0)
    assert (details["rms"], details["bias"], details["max"], details["share"]) == (abs(offset), offset, abs(offset), 1)
    assert details["flip"] > 0


def test_a_sine_that_is_moved_has_the_known_rms():
    # sin(x + t) - sin(x) is a sine of amplitude 2 sin(t / 2), whose root mean square is 1 / sqrt(2) of that
    x = np.arange(64) * 2 * np.pi / 64
    first, second = (np.tile(0.5 + 0.5 * np.sin(x + turn), (32, 1))[..., None].astype(np.float32) for turn in (0, 0.4))
    assert compared(first, second).value == pytest.approx(0.5 * 2 * np.sin(0.2) / 2**0.5, rel=1e-6)


def test_the_share_is_of_pixels_that_differ_by_more_than_two_levels():
    first = np.full((16, 16, 1), np.float32(100 / 255))
    second = np.full((16, 16, 1), np.float32(102 / 255))  # two levels: not more
    second[:4] = np.float32(103 / 255)
    assert compared(first, second).details["picture"]["share"] == 0.25


def test_the_channel_that_differs_most_speaks():
    first = picture(8, 9, 4)
    second = first.copy()
    second[:, :, 1] += 0.25
    second[:, :, 2] -= 0.5
    found = compared(first, second)
    assert found.details["channel"] == 2
    assert found.value == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_array_equal(found.pair.first, first[:, :, 2])


def test_one_channel_against_several_is_compared_with_the_first():
    colors = picture(8, 9, 3)
    found = compared(colors, colors[:, :, :1])
    assert found.equal
    assert "3 and 1 channels" in found.warnings[0]


def test_the_least_step_of_one_pixel_is_not_equal():
    first = picture(50, 50, 1)
    second = first.copy()
    second[7, 9] = np.nextafter(first[7, 9], np.float32(2))
    found = compared(first, second)
    assert 0 < found.value < 1e-8
    assert [found.answer(tolerance) for tolerance in (0, 1e-3)] == ["different", "near"]
    assert compared(first, first.copy()).answer(0) == "equal"


def test_other_sizes_have_no_number():
    found = compared(picture(8, 9, 1), picture(9, 8, 1))
    assert (found.value, found.equal, found.answer(1)) == (None, False, "different")
    assert "9 x 8 and 8 x 9 pixels" in found.reason
    assert found.pair.flip is None


def test_padding_and_fill_count_only_where_no_surface_is_known():
    first, surface = picture(16, 16, 1), np.zeros((16, 16), bool)
    surface[4:8, 4:8] = True
    second = first.copy()
    second[surface] += 0.1
    second[~surface] -= 0.5
    found = compared(first, second, surface)
    assert found.value == pytest.approx(0.1, abs=1e-6)
    told = found.details["surface"]
    assert (told["texels"], told["share"]) == (16, 1)
    assert (told["bias"], told["max"]) == (pytest.approx(0.1, abs=1e-6), pytest.approx(0.1, abs=1e-6))
    whole = compared(first, second)
    assert found.details["picture"] == whole.details["picture"]
    assert whole.value == pytest.approx(np.sqrt((16 * 0.01 + 240 * 0.25) / 256), rel=1e-5)
    assert found.warnings == whole.warnings == ()


def test_a_difference_in_the_padding_alone_is_near_but_not_equal():
    first, surface = picture(8, 8, 1), np.eye(8, dtype=bool)
    second = np.where(surface[:, :, None], first, 0)
    found = compared(first, second, surface)
    assert (found.value, found.answer(0)) == (0, "near")


def test_texels_of_either_surface_count_and_it_is_said_if_few_are_of_both():
    first = np.zeros((8, 8, 1), np.float32)
    second = first.copy()
    second[:4] = 1
    top, left = np.zeros((8, 8), bool), np.zeros((8, 8), bool)
    top[:4], left[:, :4] = True, True
    found = compared(first, second, top, left)
    assert found.details["surface"]["texels"] == 48
    assert found.value == pytest.approx(np.sqrt(32 / 48))
    (line,) = found.warnings
    assert line.startswith("66.7% of the texels lie on the surface of A or B alone: they have different UVs")
    assert compared(first, second, None, left).details["surface"]["texels"] == 32


def plate(moved=0.0, uv_moved=0.0, tilt=0.0, brighter=0.0, size=1.0):
    positions, faces = quad((0, 0, 0), (3 * size, 0, 0), (0, 4 * size, 0))  # the diagonal is 5
    uvs = quad_uvs((0.1, 0.1), (0.9, 0.9))
    corners = positions[faces]
    corners[0, 1, 2] += moved * size
    uvs[1, 2, 0] += uv_moved
    normals = np.tile(np.float32([0, 0, 1]), (2, 3, 1))
    normals[1, 1] = (np.sin(tilt), 0, np.cos(tilt))
    shown = ComparedTexture(np.full((8, 8, 1), 0.5 + brighter, np.float32))
    return ComparedMesh(corners, normals, (uvs,), shown, uvs)


@pytest.mark.parametrize("size", [1.0, 1e300, 1e-300])
def test_positions_are_measured_by_the_diagonal(size):
    found = mesh_difference(plate(size=size), plate(moved=0.3, size=size))
    assert found.value == pytest.approx(0.3 / np.sqrt(25 + 0.09))
    assert found.details["position"] == pytest.approx(found.value, rel=1e-5)
    assert mesh_difference(plate(size=size), plate(size=size)).equal


@pytest.mark.parametrize(
    ("change", "name", "expected"),
    [
        ({"uv_moved": 0.02}, "uv", 0.02),
        ({"tilt": 0.1}, "normal", 2 * np.sin(0.05)),
        ({"brighter": 0.25}, "texture", 0.25),
    ],
)
def test_whatever_differs_most_is_the_difference(change, name, expected):
    found = mesh_difference(plate(), plate(moved=0.001, **change))
    assert found.value == pytest.approx(expected, rel=1e-5)
    told = found.details[name]
    assert (told["picture"]["rms"] if name == "texture" else told) == pytest.approx(expected, rel=1e-5)


def test_what_one_mesh_lacks_makes_them_different():
    whole = plate()
    corners, normals, uv_sets = whole.corners, whole.normals, whole.uv_sets
    hole = whole.texture_uvs.copy()
    hole[1] = np.nan
    cases = {
        "2 and 1 triangles": ComparedMesh(
            corners[:1], normals[:1], (uv_sets[0][:1],), whole.texture, whole.texture_uvs[:1]
        ),
        "only A has normals": ComparedMesh(corners, None, uv_sets, whole.texture, whole.texture_uvs),
        "only A has a picture": ComparedMesh(corners, normals, uv_sets),
        "1 and 0 sets of UVs": ComparedMesh(corners, normals, (), whole.texture, whole.texture_uvs),
        "lie on 2 and 1 triangles": ComparedMesh(corners, normals, uv_sets, whole.texture, hole),
        "8 x 8 and 4 x 8 pixels": ComparedMesh(
            corners, normals, uv_sets, ComparedTexture(whole.texture.pixels[:, :4]), whole.texture_uvs
        ),
    }
    for reason, other in cases.items():
        found = mesh_difference(whole, other)
        assert reason in found.reason
        assert found.answer(1) == "different"


def spheres(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.random((count, 3)), rng.random(count)


def shuffled(one, seed=1):
    order = np.random.default_rng(seed).permutation(len(one[1]))
    return one[0][order], one[1][order]


@pytest.mark.parametrize("count", [1, 2, 300, 20_000])
def test_the_order_of_spheres_does_not_count(count):
    one = spheres(count)
    found = spheres_difference([one], [shuffled(one)])
    assert found.equal
    assert (found.value, found.warnings) == (0, ())


@pytest.mark.parametrize("size", [1.0, 1e300, 1e-300])
def test_spheres_are_measured_by_the_diagonal_of_their_box(size):
    one = np.array([[0, 0, 0], [3, 4, 12.0]]) * size, np.zeros(2)
    other = np.array([[3, 4, 12.0], [0, 0.3, 0]]) * size, np.zeros(2)
    assert spheres_difference([one], [other]).value == pytest.approx(0.3 / 13)
    grown = one[0], np.array([0, 0.5]) * size
    found = spheres_difference([one], [grown])
    assert found.value == pytest.approx(0.5 / np.linalg.norm([3.5, 4.5, 12.5]))
    assert found.details["center"] == 0


def test_moved_and_shuffled_spheres_are_as_far_as_they_were_moved():
    centers, radii = spheres(3000)
    step = 1e-4 * np.array([0.36, 0.48, 0.8])
    found = spheres_difference([(centers, radii)], [shuffled((centers + step, radii))])
    low, high = (centers - radii[:, None]).min(axis=0), (centers + step + radii[:, None]).max(axis=0)
    assert found.value == pytest.approx(1e-4 / np.linalg.norm(high - low), rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_the_pairs_are_the_best_of_all(seed):
    one, other = spheres(6, seed), spheres(6, seed + 100)
    apart = np.linalg.norm(one[0][:, None] - other[0], axis=2) + np.abs(one[1][:, None] - other[1])
    best = min(apart[np.arange(6), list(order)].max() for order in permutations(range(6)))
    box = np.concatenate([c + s * r[:, None] for c, r in (one, other) for s in (-1, 1)])
    expected = best / np.linalg.norm(np.ptp(box, axis=0))
    assert spheres_difference([one], [other]).value == pytest.approx(expected, rel=1e-9)


def test_repeated_spheres_are_counted():
    # every sphere of one set is in the other, but two of A's three at the origin have only one to go to
    a, b = np.zeros((3, 3)), np.zeros((3, 3))
    a[2, 0] = b[1, 0] = b[2, 0] = 1.0
    found = spheres_difference([(a, np.zeros(3))], [(b, np.zeros(3))])
    assert found.value == pytest.approx(1.0)


def test_too_many_pairs_are_compared_in_their_order_and_it_is_said(monkeypatch):
    monkeypatch.setattr(spheres_module, "_ALL_PAIRS_UP_TO", 10)
    centers, radii = np.zeros((50, 3)), np.ones(50)
    other = centers.copy()
    other[0, 0] = 1.0
    found = spheres_difference([(centers, radii)], [(other, radii)])
    assert found.value == pytest.approx(1 / np.linalg.norm([3, 2, 2]))
    assert "in file order" in found.warnings[0]


def test_levels_are_compared_one_by_one():
    coarse, fine = spheres(3), spheres(9)
    moved = coarse[0] + (0.1, 0, 0), coarse[1]
    assert spheres_difference([coarse, fine], [shuffled(coarse), shuffled(fine)]).equal
    found = spheres_difference([coarse, fine], [moved, fine])
    assert found.value == spheres_difference([coarse], [moved]).value > 0
    assert "9 and 3, 9 spheres" in spheres_difference([fine], [coarse, fine]).reason


REPORT = {"schema": 1, "n": 10, "x": 0.5, "t": "gl", "ok": True, "none": None, "list": [1, {"y": 2.0}]}


def test_documents_that_differ_in_time_and_place_are_equal():
    first = REPORT | {"seconds": {"load": 1.0}, "version": "1", "renderer": "a", "outputs": {"mesh": "a.obj"}}
    second = REPORT | {"seconds": {}, "version": "2", "input": {}, "renderer": "b", "outputs": None}
    found = document_difference(first | {"input": {"path": "a/b"}}, second)
    assert found.equal
    assert found.details == {"numbers": 5, "differing": 0, "value": 0.0, "places": []}


@pytest.mark.parametrize(
    ("change", "value", "at"),
    [
        ({"x": 0.75}, 0.25, "x"),  # below 1 the difference itself
        ({"n": 8}, 0.2, "n"),  # above 1 a share of the larger
        ({"x": -1.5}, 2 / 1.5, "x"),
        ({"list": [1, {"y": 4.0}]}, 0.5, "list[1].y"),
        ({"n": 10.0}, 0, None),
    ],
)
def test_numbers_are_as_far_apart_as_the_formula_says(change, value, at):
    found = document_difference(REPORT, REPORT | change)
    assert found.value == pytest.approx(value)
    assert [place["at"] for place in found.details["places"]] == ([] if at is None else [at])


@pytest.mark.parametrize(
    "change",
    [
        {"t": "ray"},
        {"t": 1},
        {"ok": False},
        {"ok": 1},
        {"none": 0},
        {"new": None},
        {"list": [1]},
        {"list": {"0": 1}},
        {"x": 10**400},
    ],
    ids=lambda change: str(change)[:20],
)
def test_what_is_no_number_has_to_be_the_same(change):
    (key,) = change
    for found in (document_difference(REPORT, REPORT | change), document_difference(REPORT | change, REPORT)):
        assert found.value is None
        assert found.answer(1) == "different"
        assert [place["at"] for place in found.details["places"]] == [key]
        assert f"1 place differs in more than a number, the first at {key}" in found.reason


def test_ten_places_are_shown_in_order_and_all_are_counted():
    found = document_difference({"n": list(range(40))}, {"n": [0, *range(2, 41)]})
    assert found.details["differing"] == 39
    assert [place["at"] for place in found.details["places"]] == [f"n[{number}]" for number in range(1, 11)]
    assert found.details["places"][0] == {"at": "n[1]", "a": 1, "b": 2}


def test_deep_documents_are_walked():
    first, second = 1.0, 1.5
    for _ in range(20_000):
        first, second = [first], [second]
    assert document_difference(first, second).value == pytest.approx(0.5 / 1.5)
