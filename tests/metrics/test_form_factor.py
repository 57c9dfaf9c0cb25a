"""The closed form of an opening's share of the light, against quadrature and against other closed forms."""

import numpy as np
import pytest

from aoprecalc.api.checks import form_factor

UP = np.array([[0.0, 0.0, 1.0]])
ORIGIN = np.zeros((1, 3))


def by_quadrature(place, normal, polygon, steps=400):
    """The cosine-weighted share of the hemisphere that a parallelogram takes up, by a sum over its cells."""
    right, down = polygon[1] - polygon[0], polygon[3] - polygon[0]
    middle = (np.arange(steps) + 0.5) / steps
    spots = polygon[0] + middle[:, None, None] * right + middle[:, None] * down - place
    area = np.cross(right, down) / steps**2
    square = (spots**2).sum(axis=-1)
    return float((spots @ normal * np.abs(spots @ area) / square**2).sum() / np.pi)


def parallel(a, b):
    """Of a rectangle a x b at distance 1, parallel to the surface, with a corner straight above the point."""
    across, along = np.hypot(1, a), np.hypot(1, b)
    return (a / across * np.arctan(b / across) + b / along * np.arctan(a / along)) / (2 * np.pi)


def perpendicular(height, width):
    """Of a rectangle that stands on the surface at distance 1, with a corner straight ahead of the point."""
    far = np.hypot(1, height)
    return (np.arctan(width) - np.arctan(width / far) / far) / (2 * np.pi)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.3, 2.0), (5.0, 0.1)])
def test_a_parallel_rectangle_above_a_corner(a, b):
    """Clockwise from below is counter-clockwise from above."""
    polygon = np.array([(0, 0, 1), (a, 0, 1), (a, b, 1), (0, b, 1)], float)
    assert form_factor(ORIGIN, UP, polygon)[0] == pytest.approx(parallel(a, b), rel=1e-12)


@pytest.mark.parametrize(("height", "width"), [(1.0, 1.0), (0.3, 2.0), (5.0, 0.1)])
def test_a_rectangle_that_stands_on_the_surface(height, width):
    polygon = np.array([(1, 0, 0), (1, 0, height), (1, width, height), (1, width, 0)], float)[::-1]
    assert form_factor(ORIGIN, UP, polygon)[0] == pytest.approx(perpendicular(height, width), rel=1e-12)


def test_a_window_around_everything_is_one():
    far = 1e6
    polygon = np.array([(-far, -far, 1), (far, -far, 1), (far, far, 1), (-far, far, 1)])
    assert form_factor(ORIGIN, UP, polygon)[0] == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("seed", [3, 4])
def test_any_parallelogram_seed(seed):
    """All of it lies above the surface, in any direction."""
    rng = np.random.default_rng(seed)
    polygon = np.array([(0, 0), (1.3, 0.2), (1.5, 1.1), (0.2, 0.9)]) @ rng.normal(size=(2, 3)) * 0.5
    polygon -= polygon.mean(axis=0)
    places, normals = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places -= normals * 6  # well below
    facing = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
    for place, normal in zip(places, normals, strict=True):
        seen = polygon if (polygon[0] - place) @ facing > 0 else polygon[::-1]
        assert ((seen - place) @ normal > 0).all()
        assert form_factor(place[None], normal[None], seen)[0] == pytest.approx(
            by_quadrature(place, normal, seen), rel=1e-4
        )


def test_points_on_the_floor_under_a_lid_and_on_a_wall_share_one_formula():
    """An edge of the polygon may lie in the plane of the surface, as the top of a wall does."""
    lid = np.array([(0, 0, 1), (2, 0, 1), (2, 1, 1), (0, 1, 1)], float)
    places = np.array([(0.7, 0.4, 0.0), (0.7, 0.0, 0.3), (2.0, 0.5, 0.8)])
    normals = np.array([(0, 0, 1), (0, 1, 0), (-1, 0, 0)], float)
    for place, normal, found in zip(places, normals, form_factor(places, normals, lid), strict=True):
        assert found == pytest.approx(by_quadrature(place, normal, lid, 1500), rel=1e-3)
