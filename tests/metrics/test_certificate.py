"""Certificates: how often they are wrong is bounded, whatever the errors; products are unbiased."""

import numpy as np
import pytest

from aoprecalc.api.checks import form_factor
from aoprecalc.errors import InputError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import SurfacePoints, sample_surface, shading_normals
from aoprecalc.metrics import certificate
from aoprecalc.metrics.certificate import RenderedErrors, certify
from aoprecalc.metrics.reference import RayCount, reference_ao
from aoprecalc.options import ValueOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import atlas_from_uvs
from aoprecalc.visibility.integrand import Integrand
from shapes import join, quad, quad_uvs, scene, scene_of_parts

E = 0.1  # so that few points do
RUNS = 100


def batches(kind, mean, seed):
    """Batches of 100 products of a mean."""
    rng = np.random.default_rng(seed)

    def products(batch):
        if kind == "rare and large":  # such as light leaks
            return np.where(rng.random(100) < 2 * mean, 0.5, 0.0)
        if kind == "noisy":
            return mean + rng.normal(0, 0.05, 100).clip(-0.9, 0.9)
        strata = np.linspace(0, 2 * mean, 100)
        return strata + rng.uniform(-0.01, 0.01, 100)

    return products


KINDS = ["rare and large", "noisy", "stratified"]


@pytest.mark.parametrize("kind", KINDS)
def test_of_errors_that_are_just_too_great_at_most_a_twentieth_is_certified(kind):
    wrong = sum(certify(batches(kind, E**2, seed), E).holds for seed in range(RUNS))
    assert wrong <= 0.05 * RUNS + 2 * np.sqrt(0.05 * 0.95 * RUNS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.5, 1.5])
def test_bounds_are_right_at_least_as_often_as_they_say(kind, share):
    bounds = [certify(batches(kind, share * E**2, seed), E).bound for seed in range(RUNS)]
    wrong = sum(bound < np.sqrt(share) * E for bound in bounds)
    assert wrong <= 0.05 * RUNS + 2 * np.sqrt(0.05 * 0.95 * RUNS)


@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_half_the_square_are_certified(kind):
    found = [certify(batches(kind, E**2 / 2, seed), E) for seed in range(50)]
    assert np.mean([one.holds for one in found]) > 0.9
    assert all(one.bound <= E for one in found if one.holds)


def test_no_error_takes_as_many_points_as_the_bet_needs():
    """Each adds log(1 + 0.95 E^2), of a third of the capital, until that is 20."""
    found = certify(lambda batch: np.zeros(10), E)
    needed = np.log(20 * 3) / np.log1p(0.95 * E**2)  # a little less, as the other stakes gain, too
    assert found.holds
    assert found.error == 0
    assert 0.9 * needed <= found.points <= needed + 10


def test_more_confidence_takes_more_points():
    points = [certify(lambda batch: np.zeros(10), E, confidence=level).points for level in (0.9, 0.95, 0.999)]
    assert points == sorted(set(points))


def test_of_a_hopeless_error_few_points_are_taken():
    found = certify(lambda batch: np.full(100, 0.04), E)
    assert not found.holds
    assert found.points == 200
    assert found.error == 0.2
    assert 0.2 < found.bound < 0.35


def test_a_bound_is_at_most_the_greatest_error_there_is():
    assert certify(lambda batch: np.full(2, 1.0), E).bound == 1


# By rays.


def room(height, size=1.0):
    """A square floor and a long wall, and the atlas of the floor."""
    shape = join(quad((0, 0, 0), (size, 0, 0), (0, size, 0)), quad((-20, 0, height), (41, 0, 0), (0, 0, -height)))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), quad_uvs((2, 2), (3, 3))])
    made = scene(*shape, uvs)
    mapped = np.array([True, True, False, False])
    return made, atlas_from_uvs(made, uvs, mapped)


def errors_of(made, atlas, texture, seed=(0, 0)):
    return RenderedErrors(made, shading_normals(made), atlas, np.float32(texture), Integrand(), seed, 0)


def test_products_on_an_open_plane_are_the_squared_error():
    made = scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad_uvs((0, 0), (1, 1)))
    atlas = atlas_from_uvs(made, made.uv_sets[0], np.ones(2, bool))
    products = errors_of(made, atlas, np.full((4, 4), 0.75))(0)
    assert products == pytest.approx(0.0625, abs=1e-6)


def test_products_beside_a_wall_are_unbiased():
    made, atlas = room(1.0)
    points = sample_surface(made, atlas.mapped, 100_000, 7)
    positions = points.interpolate(made.corners)
    wall = np.array([(-20, 0, 0), (-20, 0, 1), (21, 0, 1), (21, 0, 0)], float)
    up = np.tile((0.0, 0.0, 1.0), (len(positions), 1))
    expected = 1 - np.abs(form_factor(positions, up, wall))
    products = errors_of(made, atlas, np.full((2, 2), 0.6))(0)
    assert products.mean() == pytest.approx(((expected - 0.6) ** 2).mean(), rel=0.02)
    assert (products < 0).any()  # noise is not cut off


def test_batches_and_seeds_are_independent_and_repeat():
    """On a floor so small that all its points see the same: what differs is the noise of the rays."""
    made, atlas = room(1.0, size=1e-3)
    texture = np.full((2, 2), 0.8)
    first, second = errors_of(made, atlas, texture), errors_of(made, atlas, texture, seed=(1, 0))
    zero, one, other = first(0), first(1), second(0)
    assert np.array_equal(zero, errors_of(made, atlas, texture)(0))
    for different in (one, other):
        assert abs(np.corrcoef(zero, different)[0, 1]) < 0.05


def test_the_lighter_of_two_equal_sides_is_not_too_light():
    """A sheet that stands in the middle of a floor; its texture is too dark by far, so that any bias counts."""
    sheet, ground = quad((0, 0, 0), (1, 0, 0), (0, 0, 1)), quad((-3, -3, 0), (7, 0, 0), (0, 6, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), quad_uvs((2, 2), (3, 3))])
    made = scene(*join(sheet, ground), uvs)
    mapped = np.array([True, True, False, False])
    atlas = atlas_from_uvs(made, uvs, mapped)
    points = sample_surface(made, mapped, 5000, 5)
    one_sided = reference_ao(made, shading_normals(made), points, RayCount(1024, 9, 0), Progress())
    both = assign_roles(made, ValueOptions(two_sided=True))
    products = errors_of(both, atlas, np.full((2, 2), 0.2))(0)
    assert products.mean() == pytest.approx(((one_sided - 0.2) ** 2).mean(), rel=0.01)


def test_a_back_that_sees_all_counts_for_a_front_that_sees_nothing():
    """A sheet that lies close above a floor, face down."""
    sheet, ground = quad((0, 0, 0.001), (0, 1, 0), (1, 0, 0)), quad((-3, -3, 0), (7, 0, 0), (0, 7, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), quad_uvs((2, 2), (3, 3))])
    made = assign_roles(scene(*join(sheet, ground), uvs), ValueOptions(two_sided=True))
    atlas = atlas_from_uvs(made, uvs, np.array([True, True, False, False]))
    assert errors_of(made, atlas, np.full((2, 2), 0.2))(0) == pytest.approx(0.64, abs=1e-6)


def test_points_of_different_groups_have_different_rays():
    """Two equal floors beside equal walls, of two objects that do not occlude each other."""
    floor, wall = quad((0, 0, 0), (1e-3, 0, 0), (0, 1e-3, 0)), quad((-20, 0, 1), (41, 0, 0), (0, 0, -1))
    made = assign_roles(
        scene_of_parts(join(floor, wall), join((floor[0], floor[1]), (wall[0], wall[1]))),
        ValueOptions(self_occlusion="part"),
    )
    points = np.repeat([0, 4], 2000)
    places = SurfacePoints(points, np.tile((0.4, 0.3, 0.3), (4000, 1)))
    values = reference_ao(made, shading_normals(made), places, RayCount(64, 1, 0), Progress())
    first, second = values[:2000], values[2000:]
    assert first.mean() == pytest.approx(second.mean(), abs=0.01)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.1


def test_points_that_all_miss_the_details_are_told(monkeypatch):
    made, atlas = room(1.0)
    errors = errors_of(made, atlas, np.ones((2, 2)))
    monkeypatch.setattr(certificate, "BATCH", 64)
    monkeypatch.setattr(errors._surface, "points", lambda drawn: (np.zeros(len(drawn), bool), drawn))
    with pytest.raises(InputError, match="none of its points are on the detailed surface; use a greater cage"):
        errors(0)
