import numpy as np
import pytest

from aoprecalc.io.formats.polygons import fan_triangles, polygon_triangles, strip_triangles
from aoprecalc.mesh.topology import unique_rows

# Concave: an arrow head, an L and a comb, counter-clockwise in the plane z = 0.
ARROW = [(0, 0), (2, -1), (1, 0), (2, 1)]
EL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
COMB = [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
ROUND = [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 2000, endpoint=False)]


def shoelace(points):
    x, y = np.array(points).T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


@pytest.mark.parametrize("polygon", [ARROW, EL, COMB, ROUND], ids=["arrow", "el", "comb", "round"])
@pytest.mark.parametrize("turn", range(4))
def test_triangles_cover_a_polygon_once(polygon, turn):
    flat = np.roll(np.array(polygon, dtype=float), turn, axis=0)
    tilt = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])  # out of every coordinate plane but not edge-on to one
    points = flat @ tilt + 100.0
    count = len(points)
    triangles, owners = polygon_triangles(np.array([count]), np.arange(count), points)
    assert triangles.shape == (count - 2, 3)
    assert np.all(owners == 0)
    a, b, c = np.moveaxis(flat[triangles], 1, 0)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert np.all(areas > -1e-12)
    assert areas.sum() == pytest.approx(shoelace(flat))


def test_polygons_keep_their_order_and_small_ones_give_nothing():
    counts = np.array([4, 2, 3, 5])
    triangles, owners = polygon_triangles(counts, np.arange(14), np.array([(i, i * i, 0.0) for i in range(14)]))
    assert owners.tolist() == [0, 0, 2, 3, 3, 3]
    assert triangles[2].tolist() == [6, 7, 8]


def test_strips_alternate_restart_and_drop_what_turns_a_corner():
    assert strip_triangles(np.array([0, 1, 2, 3])).tolist() == [[0, 1, 2], [2, 1, 3]]
    assert strip_triangles(np.array([9, -1, 0, 1, 2, 3])).tolist() == [[0, 1, 2], [2, 1, 3]]
    assert strip_triangles(np.array([0, 1, 2, 2, 3, 4])).tolist() == [[0, 1, 2], [3, 2, 4]]
    assert strip_triangles(np.array([0, 1])).tolist() == []


def test_fans():
    assert fan_triangles(np.array([7, 1, 2, 3])).tolist() == [[7, 1, 2], [7, 2, 3]]
    assert fan_triangles(np.array([7, 1])).tolist() == []


def test_unique_rows_go_by_value_in_order_of_appearance():
    first, which = unique_rows(np.array([[2.0, 0.0], [1.0, 0.0], [2.0, -0.0], [1.0, 1e-300]]), np.array([5, 5, 5, 5]))
    assert first.tolist() == [0, 1, 3]
    assert which.tolist() == [0, 1, 0, 2]
    first, which = unique_rows(np.array([1, 1, 1]), np.array([[0.5], [0.5], [0.25]]))
    assert first.tolist() == [0, 2]
    assert which.tolist() == [0, 0, 1]
