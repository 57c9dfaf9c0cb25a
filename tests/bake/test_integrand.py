"""The integrand of a bake: distance, falloff, cone and weight, against closed forms, by depth maps and by rays."""

from math import asin, cos, inf, log, pi, radians, sin, sqrt

import numpy as np
import pytest

from aoprecalc.api.bake_messages import ground_alone
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import ArgumentError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import SurfacePoints
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.visibility.integrand import Integrand
from shapes import clutter, disc, join, quad, quad_uvs, scene, scene_of_parts

WIDE = 200.0


def patch_under(shape):
    """A small square that faces up at the origin, and an occluder."""
    patch = quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), np.zeros((len(shape[1]), 3, 2))])
    return scene_of_parts(patch, shape, uvs=uvs)


def plate(height):
    return quad((-WIDE, -WIDE, height), (0, 2 * WIDE, 0), (2 * WIDE, 0, 0))


def baked_value(made, **options):
    texture = bake_scene(
        made, BakeOptions(size=8, unwrap="keep", only="part 0", **{"directions": 4000, **options})
    ).texture
    return float(texture.values[texture.valid].mean())


def reference(made, **value):
    options = ValueOptions(only="part 0", **value)
    middle = SurfacePoints(np.zeros(1, int), np.array([(0.5, 0.0, 0.5)]))
    shading = np.broadcast_to(np.float32((0, 0, 1)), (len(made.faces), 3, 3))
    made = assign_roles(made, options)
    integrand = Integrand.from_options(options, made)
    return float(reference_ao(made, shading, middle, VerifyOptions(), Progress(), integrand)[0])


def taken_by_plate(c, weight, falloff):
    """What a plate at the share c of the maximum distance takes; the directions w with n.w > c reach it in time."""
    if weight == "uniform":
        return {"none": 1 - c, "linear": 1 - c + c * log(c), "smooth": 1 - 3 * c + 3 * c**2 - c**3}[falloff]
    smooth = 1 + 3 * c**2 - 4 * c**3 + 6 * c**2 * log(c)
    return {"none": 1 - c**2, "linear": (1 - c) ** 2, "smooth": smooth}[falloff]


@pytest.mark.parametrize("falloff", ["none", "linear", "smooth"])
@pytest.mark.parametrize("weight", ["cosine", "uniform"])
def test_a_plate_within_the_maximum_distance_takes_its_part(weight, falloff):
    made = patch_under(plate(0.5))
    value = {"max_distance": 1.25, "falloff": falloff, "weight": weight}
    expected = 1 - taken_by_plate(0.4, weight, falloff)
    assert baked_value(made, **value) == pytest.approx(expected, abs=2e-3)
    assert reference(made, **value) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("falloff", ["none", "linear", "smooth"])
def test_a_plate_beyond_the_maximum_distance_takes_nothing(falloff):
    value = {"max_distance": 0.49, "falloff": falloff}
    assert baked_value(patch_under(plate(0.5)), **value) == 1
    assert reference(patch_under(plate(0.5)), **value) == 1


def test_the_ground_counts_up_to_the_maximum_distance():
    """A patch that faces down at a height over the ground is one under a plate; the ball lies on the ground."""
    patch = quad((-0.01, -0.01, 0), (0, 0.02, 0), (0.02, 0, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), np.zeros((2, 3, 2))])
    made = scene_of_parts(patch, quad((50, 50, -0.5), (1, 0, 0), (0, 1, 0)), uvs=uvs)
    options = {"ground": True, "up": "z", "max_distance": 1.25}
    assert baked_value(made, **options) == pytest.approx(1 - taken_by_plate(0.4, "cosine", "none"), abs=2e-3)
    assert baked_value(made, **options, falloff="smooth") == pytest.approx(
        1 - taken_by_plate(0.4, "cosine", "smooth"), abs=2e-3
    )
    assert baked_value(made, **{**options, "max_distance": 0.49}) == 1


@pytest.mark.parametrize("backend", ["gl", "ray"])
@pytest.mark.parametrize("weight", ["cosine", "uniform"])
@pytest.mark.parametrize("cone", [180, 120, 60])
def test_a_disc_in_a_cone_hides_its_share(backend, weight, cone):
    made, rim, edge = patch_under(disc(0.5, 1.0)), 1 / sqrt(1.25), cos(radians(cone / 2))
    share = (1 - rim**2) / (1 - edge**2) if weight == "cosine" else (1 - rim) / (1 - edge)
    value = {"cone": cone, "weight": weight}
    assert baked_value(made, backend=backend, **value) == pytest.approx(1 - share, abs=0.01)
    assert reference(made, **value) == pytest.approx(1 - share, abs=2e-3)


@pytest.mark.parametrize("backend", ["gl", "ray"])
@pytest.mark.parametrize("cone", [180, 120, 90, 60])
def test_a_cone_over_a_corner_meets_the_wall_above_its_edge(backend, cone):
    """An endless wall of height 1 at the distance 1: w is visible above the plane through the point and the wall's rim.

    By the cosine, w counts as the area of its projection onto the floor (Nusselt): the cone is a disc of radius
    s = sin(cone / 2) there, and the rim half an ellipse with the axes c = cos 45 degrees, towards the wall, and 1. They
    meet at y^2 = (s^2 - c^2) / (1 - c^2); a cone with s < c does not reach the wall.
    """
    made = patch_under(quad((-1, WIDE, 0), (0, -2 * WIDE, 0), (0, 0, 1)))
    s, c = sin(radians(cone / 2)), sqrt(0.5)
    y = sqrt(max(s**2 - c**2, 0) / (1 - c**2))

    def half(radius):  # the integral of sqrt(radius^2 - t^2) from -y to y
        return y * sqrt(radius**2 - y**2) + radius**2 * asin(y / radius)

    expected = 1 - (half(s) - c * half(1)) / (pi * s**2)
    assert baked_value(made, backend=backend, cone=cone) == pytest.approx(expected, abs=0.01)
    assert reference(made, cone=cone) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("weight", ["cosine", "uniform"])
@pytest.mark.parametrize("cone", [180, 90])
def test_the_mean_estimator_tends_to_the_same(weight, cone):
    made = patch_under(disc(0.5, 1.0))
    value = {"cone": cone, "weight": weight}
    mean = baked_value(made, **value, estimator="mean", backend="ray", directions=20_000)
    assert mean == pytest.approx(baked_value(made, **value, backend="ray", directions=20_000), abs=5e-3)
    assert reference(made, **value, estimator="mean") == pytest.approx(reference(made, **value), abs=1e-3)


def test_a_far_maximum_distance_changes_nothing_seed_0():
    made = scene(*clutter(0))
    options = {"width": 64, "height": 64, "directions": 64, "backend": "ray"}
    limited, unlimited = (
        bake_scene(made, BakeOptions(**options, max_distance=distance)).texture.values for distance in (1e6, None)
    )
    assert (limited == unlimited).all()


def test_what_the_ground_alone_takes_is_told_of_the_hemisphere_only():
    """Two upright walls get half of the light from above; what is left of that within a distance is not known."""
    walls = join(quad((0, 0, 0), (0, 0, 1), (1, 0, 0)), quad((0, 3, 0), (0, 0, 1), (1, 0, 0)))
    options = {"size": 64, "directions": 64, "ground": True, "up": "z"}
    assert ground_alone(bake_scene(scene(*walls), BakeOptions(**options))) == pytest.approx(0.5)
    for value in ({"max_distance": "2%"}, {"cone": 90}, {"weight": "uniform"}):
        assert ground_alone(bake_scene(scene(*walls), BakeOptions(**options, **value))) is None


def test_a_share_of_the_diagonal_is_that_length():
    made = scene(*clutter(3))
    diagonal = float(np.linalg.norm(np.ptp(made.positions, axis=0)))
    assert Integrand.from_options(ValueOptions(max_distance="25%"), made).max_distance == pytest.approx(diagonal / 4)
    assert Integrand.from_options(ValueOptions(), made).max_distance == inf


@pytest.mark.parametrize(("weight", "cone"), [("cosine", 180), ("cosine", 70), ("uniform", 180), ("uniform", 70)])
def test_the_mean_weight_is_that_over_the_sphere(weight, cone):
    integrand = Integrand.from_options(ValueOptions(weight=weight, cone=cone), scene(*clutter(0)))
    cosines = np.linspace(-1, 1, 2_000_001)
    assert integrand.weights(cosines).mean() == pytest.approx(integrand.mean_weight, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"max_distance": 0}, "a length above 0"),
        ({"max_distance": "-5%"}, "a length above 0"),
        ({"max_distance": "wide"}, "a length above 0"),
        ({"falloff": "linear"}, "occluders count at any distance"),
        ({"cone": 0}, "from 1 to 180"),
        ({"max_distance": 1.0, "backend": "gl"}, "depth maps do not tell"),
    ],
)
def test_what_makes_no_sense_is_refused(options, words):
    with pytest.raises(ArgumentError, match=words):
        BakeOptions(**options)
