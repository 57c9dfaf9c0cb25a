"""Triangles with holes, as the opaque pieces between these."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from aoprecalc.mesh.opaque_triangles import opaque_triangles
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.types import AlphaMask, Material
from shapes import box, join, quad, quad_uvs, rotation, scene

PAD = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}


def pierced(made, alpha, uvs, factors=None, cutoff=0.5, wraps=("repeat", "repeat")):
    """Give all of a scene the holes of one cut-out."""
    factors = np.ones((len(made.faces), 3)) if factors is None else np.asarray(factors, float)
    alpha_mask = AlphaMask(np.asarray(alpha, np.float32), np.asarray(uvs, float), factors, cutoff, wraps)
    return with_cutout(made, alpha_mask)


def with_cutout(made, alpha_mask):
    return replace(made, parts=(replace(made.parts[0], material=Material(alpha_mask=alpha_mask)),))


def cutout_of(made):
    return made.parts[0].material.alpha_mask


def card(alpha, low=(0, 0), high=(1, 1), **more):
    """A rectangle in the plane z = 0 whose positions are its UVs."""
    size = np.subtract(high, low)
    made = scene(*quad((*low, 0), (size[0], 0, 0), (0, size[1], 0)))
    return pierced(made, alpha, quad_uvs(low, high), **more)


def triangles(seed, alpha, count=12, **more):
    """Random triangles in UV space; the z of their positions is their number."""
    rng = np.random.default_rng(seed)
    uvs = rng.uniform(-1.5, 1.5, (count, 1, 2)) + rng.uniform(-0.6, 0.6, (count, 3, 2))
    positions = np.concatenate([uvs, np.repeat(np.arange(count), 3).reshape(count, 3, 1)], axis=2)
    made = scene(positions.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    return pierced(made, alpha, uvs, factors=rng.uniform(0.7, 1.3, (count, 3)), **more)


def disc(size, radius=0.35, soft=2):
    """A disc with an edge of `soft` texels, 0.5 at the radius."""
    at = (np.arange(size) + 0.5) / size - 0.5
    return np.clip((radius - np.hypot(*np.meshgrid(at, at))) * size / soft + 0.5, 0, 1)


def chequer(size, square):
    return (np.indices((size, size)) // square).sum(axis=0) % 2


def clouds(seed, shape, blur=3):
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=shape), blur, mode="wrap")
    return (noise - noise.min()) / np.ptp(noise)


def area(corners):
    return np.linalg.norm(area_vectors(corners), axis=1).sum() / 2


def slow_alpha(alpha_mask, uvs, reach=3):
    """Bilinear alpha at (m, 2) UVs within `reach` of 0, in a picture that is laid out as often."""
    alpha = alpha_mask.alpha.astype(float)
    height, width = alpha.shape
    alpha = np.pad(alpha, ((0, 0), (reach * width,) * 2), PAD[alpha_mask.wraps[0]])
    alpha = np.pad(alpha, ((reach * height,) * 2, (0, 0)), PAD[alpha_mask.wraps[1]])
    places = (1 - uvs[:, 1] + reach) * height - 0.5, (uvs[:, 0] + reach) * width - 0.5
    return map_coordinates(alpha, places, order=1)


def count_over(points, corners):
    """How many of the triangles, (o, 3, 2+), each of the points, (m, 2), is in."""
    a, b, c = corners[..., :2].swapaxes(0, 1)

    def left_of(p, q):
        offset = points[:, None] - p
        return (q - p)[:, 0] * offset[..., 1] - (q - p)[:, 1] * offset[..., 0] > 0

    sides = np.stack([left_of(a, b), left_of(b, c), left_of(c, a)])
    return (sides.all(axis=0) | ~sides.any(axis=0)).sum(axis=1)


def compare(made, seed, points=1500, **more):
    """Random points: which are opaque, and in how many of the pieces each is."""
    pieces = opaque_triangles(made, **more)
    alpha_mask = cutout_of(made)
    rng = np.random.default_rng(seed)
    opaque, found = [], []
    for number, corners in enumerate(made.corners):
        weights = rng.dirichlet((1, 1, 1), points)
        alpha = slow_alpha(alpha_mask, weights @ alpha_mask.uvs[number]) * (weights @ alpha_mask.factors[number])
        opaque.append(alpha >= alpha_mask.cutoff)
        found.append(count_over((weights @ corners)[:, :2], pieces[np.rint(pieces[:, 0, 2]) == number]))
    return np.concatenate(opaque), np.concatenate(found)


@pytest.mark.parametrize("wraps", [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")], ids="-".join)
@pytest.mark.parametrize(("seed", "shape"), [(1, (32, 32)), (2, (24, 40)), (3, (7, 64)), (4, (1, 9))])
def test_a_point_is_in_one_piece_where_the_alpha_is_opaque_and_else_in_none(seed, shape, wraps):
    blurred = clouds(seed, shape, 1.5)
    made = triangles(seed, blurred, wraps=wraps, cutoff=float(np.median(blurred)))
    opaque, found = compare(made, seed)
    assert 0.2 < opaque.mean() < 0.8
    assert found.max() == 1
    assert (opaque != (found > 0)).mean() < 0.006
    assert opaque.mean() == pytest.approx((found > 0).mean(), abs=0.002)


@pytest.mark.parametrize("seed", [5, 6])
def test_hard_texels_have_their_edges_halfway(seed):
    alpha = np.random.default_rng(seed).random((16, 16)) > 0.5
    opaque, found = compare(triangles(seed, alpha), seed)
    assert (opaque != (found > 0)).mean() < 0.01
    assert opaque.mean() == pytest.approx((found > 0).mean(), abs=0.004)


@pytest.mark.parametrize("size", [32, 100, 512])
def test_a_disc_has_its_area_in_few_pieces(size):
    pieces = opaque_triangles(card(disc(size)))
    assert area(pieces) == pytest.approx(np.pi * 0.35**2, rel=0.1 / size + 1e-4)
    assert len(pieces) < 200
    distance = np.linalg.norm(pieces[..., :2] - 0.5, axis=2)
    assert distance.max() < 0.36


@pytest.mark.parametrize(("size", "square"), [(8, 1), (64, 1), (64, 8), (48, 3)])
def test_half_of_a_chequer_is_opaque(size, square):
    pieces = opaque_triangles(card(chequer(size, square)))
    assert area(pieces) == pytest.approx(0.5, abs=1e-3)
    if square == 8:
        assert len(pieces) == 2 * 32


@pytest.mark.parametrize(
    ("wrap", "spans"),
    [("repeat", [(-1, -0.5), (0, 0.5)]), ("mirror", [(-0.5, 0.5)]), ("clamp", [(-1, 0.5)])],
)
@pytest.mark.parametrize("axis", [0, 1], ids="uv")
def test_beyond_the_picture_its_wraps_hold(wrap, spans, axis):
    row = np.arange(16) < 8
    alpha = np.tile(row, (16, 1)) if axis == 0 else np.tile(row[::-1, None], (1, 16))
    wraps = ("repeat", "repeat")[:axis] + (wrap,) + ("repeat", "repeat")[axis + 1 :]
    pieces = opaque_triangles(card(alpha, (-1, -1), (1, 1), wraps=wraps))
    assert area(pieces) == pytest.approx(2 * sum(high - low for low, high in spans), rel=1e-3)
    middles = pieces.mean(axis=1)[:, axis]
    assert np.any([(low < middles) & (middles < high) for low, high in spans], axis=0).all()


def test_row_0_is_at_the_top_of_v():
    alpha = np.zeros((4, 4))
    alpha[0] = 1
    pieces = opaque_triangles(card(alpha, wraps=("repeat", "clamp")))
    assert pieces[..., 1].min() == pytest.approx(0.75)
    assert pieces[..., 1].max() == 1


def test_a_slope_of_factors_is_cut_by_one_straight_line():
    made = scene([(0, 0, 0), (4, 0, 0), (0, 4, 0)], [(0, 1, 2)])
    kept = opaque_triangles(pierced(made, [[1]], np.zeros((1, 3, 2)), [(0.25, 1, 0.25)]))
    assert kept == pytest.approx(np.array([[(4, 0, 0), (4 / 3, 8 / 3, 0), (4 / 3, 0, 0)]]))
    lost = opaque_triangles(pierced(made, [[0.5]], np.zeros((1, 3, 2)), [(2, 0, 2)]))
    assert len(lost) == 2
    assert area(lost) == pytest.approx(8 * 3 / 4)
    assert opaque_triangles(pierced(made, np.ones((8, 8)), made.corners[..., :2], [(0.25, 1, 0.25)])) == pytest.approx(
        kept
    )


@pytest.mark.parametrize("seed", [7, 8])
def test_the_pieces_and_the_holes_are_the_whole(seed):
    # In steps that floats know, so that the opposite is just that.
    made = triangles(seed, np.round(clouds(seed, (32, 32), 1.5) * 255) / 256)
    alpha_mask = replace(cutout_of(made), factors=np.ones((12, 3)))
    opposite = replace(alpha_mask, alpha=1 - alpha_mask.alpha)
    both = [opaque_triangles(with_cutout(made, some)) for some in (alpha_mask, opposite)]
    assert area(np.concatenate(both)) == pytest.approx(area(made.corners), rel=1e-9)


def test_pieces_are_wound_as_their_faces():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    faces[1] = faces[1, ::-1]
    uvs = positions[faces][..., :2]
    pieces = opaque_triangles(pierced(scene(positions, faces), clouds(1, (16, 16), 2), uvs))
    upwards = area_vectors(pieces)[:, 2] > 0
    above = np.diff(pieces.mean(axis=1)[:, :2], axis=1)[:, 0] > 0
    assert (above != above[0]).any()
    assert (upwards == above).all() or (upwards == ~above).all()


@pytest.mark.parametrize("cutoff", [0, 1, 1.01])
def test_whole_triangles_stay_or_vanish_as_they_are(cutoff):
    made = card(np.maximum(clouds(1, (64, 64)), cutoff == 1), cutoff=cutoff)
    kept = opaque_triangles(made)
    assert len(kept) == (0 if cutoff > 1 else 2)
    assert set(map(bytes, kept)) <= set(map(bytes, made.corners))


@pytest.mark.parametrize(("cutoff", "kept"), [(0.5, 2), (0.50001, 0)])
def test_one_texel_is_as_good_as_none(cutoff, kept):
    assert len(opaque_triangles(card([[0.5]], (-70, -70), (90, 90), cutoff=cutoff))) == kept


def test_what_is_opaque_is_not_parted():
    alpha = np.ones((64, 64))
    alpha[:4, :4] = 0
    pieces = opaque_triangles(card(alpha, wraps=("clamp", "clamp")))
    assert np.isclose(np.linalg.norm(area_vectors(pieces), axis=1), 1).sum() == 1  # the half without the hole
    assert len(pieces) < 40
    assert area(pieces) == pytest.approx(1 - 1 / 256, abs=4e-5)  # the hole has a round corner


@pytest.mark.parametrize("budget", [4, 20, 300, 5000])
def test_a_budget_is_kept_and_the_area_with_it(budget):
    made = card(clouds(3, (64, 64)))
    pieces = opaque_triangles(made, max_pieces=budget)
    assert budget / 8 < len(pieces) <= budget
    assert area(pieces) == pytest.approx(area(opaque_triangles(made)), rel=1e-3)


@pytest.mark.parametrize("work", [4, 100, 1000])
def test_where_all_cannot_be_looked_at_samples_tell_the_share(work, monkeypatch):
    monkeypatch.setattr("aoprecalc.mesh.opaque_triangles._MAX_NODES", work)
    needles = np.zeros((256, 256))
    needles[:, ::16] = needles[:, 1::16] = 1
    made = triangles(1, needles, count=100)
    opaque, found = compare(made, 1, points=200)
    assert found.mean() == pytest.approx(opaque.mean(), abs=0.02)


@pytest.mark.parametrize("budget", [4 * 49, 1000, 10_000])
def test_copies_are_the_same_and_count(budget):
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    turned = [(positions @ rotation(seed) + 3 * seed, faces) for seed in range(49)]
    uvs = np.tile(quad_uvs((0, 0), (1, 1)), (49, 1, 1))
    pieces = opaque_triangles(pierced(scene(*join(*turned)), disc(64), uvs), max_pieces=budget)
    assert len(pieces) <= budget
    assert len(pieces) % 49 == 0
    middles = pieces.mean(axis=1)
    for seed in range(49):
        back = (middles - 3 * seed) @ rotation(seed).T
        own = np.abs(back - (0.5, 0.5, 0)).max(axis=1) < 0.6
        own &= np.abs(back[:, 2]) < 1e-9
        assert own.sum() >= len(pieces) / 49
        assert area(pieces[own]) == pytest.approx(np.pi * 0.35**2, rel=0.002)


@pytest.mark.parametrize("far", [1, 30, 300, 3000])
def test_what_is_small_in_its_scene_has_few_pieces_and_its_share(far):
    positions, faces = join(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((far, far, 1), (1, 0, 0), (0, 1, 0)))
    needles = np.zeros((256, 256))
    needles[:, ::16] = needles[:, 1::16] = 1
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1))] * 2)
    pieces = opaque_triangles(pierced(scene(positions, faces), needles, uvs))
    assert area(pieces) == pytest.approx(2 / 8, rel=0.01)
    assert len(pieces) <= 4 * max(1, 2048 / far) ** 2
    if far > 1:
        sides = np.linalg.norm(pieces - np.roll(pieces, 1, axis=1), axis=2).max(axis=1)
        assert np.median(sides) > np.hypot(far, far) / 2048 / 4


def test_only_what_occludes_is_there():
    shapes = [quad((0, 0, z), (1, 0, 0), (0, 1, 0)) for z in range(4)]
    made = scene(*join(*shapes))
    uvs = quad_uvs((0, 0), (1, 1))
    hole = AlphaMask(np.array([[1, 0]], np.float32), uvs, np.ones((2, 3)), 0.5, ("clamp", "clamp"))
    looks = [Material(), Material(alpha_mask=hole), Material(alpha_mask=hole), Material()]
    parts = tuple(
        replace(made.parts[0], start=2 * n, stop=2 * n + 2, material=looks[n], occludes=n in (0, 1)) for n in range(4)
    )
    pieces = opaque_triangles(replace(made, parts=parts))
    assert np.array_equal(pieces[:2], made.corners[:2])
    assert (pieces[2:, :, 2] == 1).all()
    assert area(pieces[2:]) == pytest.approx(0.5)


def test_parts_keep_their_own_pictures_and_cutoffs():
    made = scene(*join(*(quad((0, 0, z), (1, 0, 0), (0, 1, 0)) for z in range(3))))
    ramp = (np.arange(8, dtype=np.float32)[None] + 0.5) / 8
    cutouts = [
        AlphaMask(alpha, quad_uvs((0, 0), (1, 1)), np.ones((2, 3)), cutoff, ("clamp", "clamp"))
        for alpha, cutoff in ((ramp, 0.25), (ramp, 0.75), (ramp**2, 0.25))
    ]
    parts = tuple(
        replace(made.parts[0], start=2 * n, stop=2 * n + 2, material=Material(alpha_mask=alpha_mask))
        for n, alpha_mask in enumerate(cutouts)
    )
    pieces = opaque_triangles(replace(made, parts=parts))
    floor = pieces[:, 0, 2].round()
    assert [area(pieces[floor == n]) for n in range(3)] == pytest.approx([0.75, 0.25, 0.5], abs=0.01)


def test_a_scene_without_holes_is_as_it_was():
    made = scene(*box())
    assert np.array_equal(opaque_triangles(made), made.corners)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e30])
def test_uvs_that_are_no_places_do_no_harm(bad):
    uvs = quad_uvs((0, 0), (1, 1))
    uvs[1, 2] = bad
    made = pierced(scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0))), disc(16), uvs)
    assert np.isfinite(opaque_triangles(made)).all()


def test_faces_without_area_do_no_harm():
    made = scene([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2), (0, 0, 0)])
    assert area(opaque_triangles(pierced(made, disc(16), np.tile([(0, 0), (1, 0), (0, 1)], (2, 1, 1))))) == 0


def test_surroundings_of_any_size_leave_the_holes_as_fine_as_they_are_alone():
    """Pieces were as coarse as the whole scene asked for, which a floor that does not receive can make of any size."""
    made = card(disc(64))
    ground = scene(*quad((-5e4, -5e4, -2), (1e5, 0, 0), (0, 1e5, 0)))
    start = len(made.faces)
    floor = replace(ground.parts[0], start=start, stop=start + 2, receives=False)
    both = replace(
        made,
        positions=np.concatenate([made.positions, ground.positions]),
        faces=np.concatenate([made.faces, ground.faces + len(made.positions)]),
        parts=(*made.parts, floor),
    )
    alone, among = opaque_triangles(made), opaque_triangles(both)
    assert len(among) == len(alone) + 2
    assert np.array_equal(among[2:], alone)
