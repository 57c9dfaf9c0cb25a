"""Points of a simple mesh on a detailed one: rays from a cage, the cage that `auto` finds, and partners by name."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.mesh.detail import Detail, cage_at, detailed_surface, match_parts
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import ValueOptions
from aoprecalc.raster.layout import Samples
from aoprecalc.types import AlphaMask, Material, Part
from aoprecalc.visibility.cage import auto_cage, read_cage
from aoprecalc.visibility.projection import Projection
from shapes import ball, box, join, quad, quad_uvs, scene, scene_of_parts


def bumpy(height, cells=32, frequency=8):
    """The unit square with waves of a height."""
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells)
    waves = np.sin(frequency * positions[:, 0]) * np.cos(0.9 * frequency * positions[:, 1])
    return positions + np.multiply.outer(height * waves, (0, 0, 1)), faces


def plane(z=0.0):
    return quad((0, 0, z), (1, 0, 0), (0, 1, 0))


def detail_of_parts(low, high, *, by_name=True, cage=None):
    """A Detail with the surface of a scene, and a cage at a distance or, for None, as `auto` finds it."""
    surface, normals = detailed_surface([high], low, ValueOptions())
    matches = match_parts(low.parts, surface.parts, by_name=by_name)
    detail = Detail(surface, normals, matches.partners, cage_at(low, cage or 0.0))
    return detail if cage else replace(detail, cage=auto_cage(low, detail))


def projected(low, detail, count=4000):
    """Points of the low surface, those that were found, and where: positions of both, and the faces that were hit."""
    points = sample_surface(low, low.receives, count, seed=0)
    hit, found = Projection(low, detail).points(points)
    return points.interpolate(low.corners)[hit], found.interpolate(detail.scene.corners), hit, found.faces, points.faces


def test_points_move_along_the_normal_onto_what_lies_before_or_behind_them():
    low, high = scene(*plane()), scene(*bumpy(0.05))
    start, end, hit, *_ = projected(low, detail_of_parts(low, high, cage=0.06))
    assert hit.all()
    assert np.abs(start - end)[:, :2].max() < 1e-5
    assert end[:, 2].min() < -0.04
    assert end[:, 2].max() > 0.04


def test_what_the_cage_does_not_enclose_is_missed():
    low = scene(*plane())
    for z, found in ((0.09, True), (-0.09, True), (0.11, False), (-0.11, False)):
        assert projected(low, detail_of_parts(low, scene(*plane(z)), cage=0.1))[2].all() == found
        assert projected(low, detail_of_parts(low, scene(*plane(z)), cage=0.1))[2].any() == found


def test_the_surface_nearest_to_the_cage_is_met_and_backs_are_passed():
    low = scene(*plane())
    two = scene(*join(plane(0.05), plane(-0.05)))
    assert projected(low, detail_of_parts(low, two, cage=0.1))[1][:, 2] == pytest.approx(0.05)
    back = quad((0, 0, 0.05), (0, 1, 0), (1, 0, 0))  # faces down
    assert projected(low, detail_of_parts(low, scene(*join(back, plane(-0.05))), cage=0.1))[1][:, 2] == pytest.approx(
        -0.05
    )


@pytest.mark.parametrize("double_sided", [False, True])
def test_the_holes_of_alpha_masks_are_passed(double_sided):
    low, high = scene(*plane()), scene_of_parts(plane(0.05), plane(-0.05))
    alpha, uvs = np.array([[0, 1]], np.float32), quad_uvs((0, 0), (1, 1))
    mask = AlphaMask(alpha, uvs, np.ones((2, 3)), 0.5, ("clamp", "clamp"))
    sheet = replace(high.parts[0], material=Material(alpha_mask=mask, foliage=double_sided))
    start, end, hit, *_ = projected(low, detail_of_parts(low, replace(high, parts=(sheet, high.parts[1])), cage=0.1))
    assert hit.all()
    assert end[:, 2] == pytest.approx(np.where(start[:, 0] < 0.5, -0.05, 0.05))


def test_samples_without_a_face_stay_so_and_others_do_not_depend_on_what_else_is_asked():
    low = scene(*plane())
    projection = Projection(low, detail_of_parts(low, scene(*bumpy(0.05)), cage=0.1))
    points = sample_surface(low, low.receives, 500, seed=1)
    samples = Samples(points.faces.astype(np.int32), points.weights.astype(np.float32))
    samples.faces[::7] = -1
    whole = projection.samples(samples)
    assert (whole.faces[::7] == -1).all()
    for rows in (slice(0, 100), slice(100, 101), slice(101, 500)):
        part = projection.samples(Samples(samples.faces[rows], samples.weights[rows]))
        assert np.array_equal(part.faces, whole.faces[rows])
        assert np.array_equal(part.weights, whole.weights[rows])


# The cage that auto finds.


def test_auto_encloses_a_detailed_surface_and_hardly_more():
    low = scene(*ball(2))
    positions, faces = ball(4)
    waves = np.sin(9 * positions[:, :1]) * np.sin(8 * positions[:, 1:2])
    detail = detail_of_parts(low, scene(positions * (1 + 0.05 * waves), faces))
    start, end, hit, *_ = projected(low, detail)
    assert hit.all()
    assert np.linalg.norm(start - end, axis=1).max() < detail.cage.distances.max() < 0.1


@pytest.mark.parametrize(("gap", "thickness"), [(0.02, 0.05), (0.05, 0.02), (0.01, 0.01)])
def test_auto_does_not_reach_from_one_plate_to_another(gap, thickness):
    def plates(cells):
        one, other = (
            join(
                quad((0, 0, z + thickness), (1, 0, 0), (0, 1, 0), cells),
                quad((0, 0, z), (0, 1, 0), (1, 0, 0), cells),
            )
            for z in (0.0, gap + thickness)
        )
        return [(p + 0.1 * gap * np.sin(30 * p[:, :1]) * np.array((0, 0, cells > 1)), f) for p, f in (one, other)]

    low, fine = scene_of_parts(*plates(1)), plates(24)
    detail = detail_of_parts(low, scene(*join(*fine)))
    *_, hit, high_faces, low_faces = projected(low, detail)
    assert hit.all()
    assert np.array_equal(high_faces >= len(fine[0][1]), low_faces[hit] >= low.parts[1].start)


def test_auto_does_not_reach_from_a_wheel_to_the_fender_around_it():
    """The fender's outside faces as the wheel's outside does, and is the first that rays from far out meet."""

    def parts(sections):
        angles = np.linspace(0, np.pi, sections + 1)

        def arc(radius, *, outward=True):
            ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
            positions = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in (-0.1, 0.1)])
            i = np.arange(sections)
            a, b, c, d = i, i + 1, i + 1 + len(ring), i + len(ring)
            faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            return positions, faces if outward else faces[:, ::-1]

        return arc(1.0), join(arc(1.1), arc(1.08, outward=False))

    low = scene_of_parts(*parts(16))
    high = scene_of_parts(*parts(128))
    detail = detail_of_parts(low, high, by_name=False)
    *_, hit, high_faces, low_faces = projected(low, detail)
    assert hit.mean() > 0.99
    assert np.array_equal(high_faces >= high.parts[1].start, low_faces[hit] >= low.parts[1].start)


# From a file.


def test_a_cage_from_a_file_gives_the_rays_of_its_corners():
    low, high = scene(*plane()), scene(*bumpy(0.05))
    cage = scene(*plane(0.06))
    start, end, hit, *_ = projected(low, replace(detail_of_parts(low, high, cage=0.06), cage=read_cage(low, cage)))
    assert hit.all()
    assert np.abs(start - end)[:, :2].max() < 1e-5


def test_a_cage_of_another_mesh_is_refused():
    low = scene(*plane())
    with pytest.raises(InputError, match=r"has 12 faces, a cage of made\.obj has 2 faces"):
        read_cage(low, scene(*box()))
    with pytest.raises(InputError, match="far from"):
        read_cage(low, scene(*plane(3.0)))


# Names.


def parts(*names, **others):
    return [
        Part(name, index, index + 1, np.zeros((1, 3), np.int32), names=frozenset(others.get(name, ())))
        for index, name in enumerate(names)
    ]


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ("wheel_low", "wheel_high"),
        ("wheel_lp", "wheel_hp"),
        ("Wheel_LOW", "wheel_Hi"),
        ("low_wheel", "high_wheel"),
        ("wheel", "wheel_high"),
        ("wheel_low.001", "wheel_high.003"),
        ("wheel", "wheel"),
        ("wheel-low", "wheel high bolts"),
    ],
)
def test_names_match_without_the_words_for_low_and_high(low, high):
    matches = match_parts(parts(low, "body_low"), parts("body_high", high), by_name=True)
    assert matches.by_name
    assert matches.partners == ((1,), (0,))
    assert matches.low == matches.high == ()


def test_the_names_of_what_a_part_belongs_to_count_where_its_own_matches_nothing():
    high = parts("bolt", "tyre", "car", bolt=("wheel_high", "car_high"), tyre=("wheel_high",), car=("car_high",))
    matches = match_parts(parts("wheel_low", "car"), high, by_name=True)
    assert matches.partners == ((0, 1), (0, 2))
    assert match_parts(parts("hill"), parts("low_hills"), by_name=True).by_name is False


def test_what_has_no_partner_is_named():
    matches = match_parts(parts("wheel_low", "seat_low"), parts("wheel_high", "roof_high"), by_name=True)
    assert matches.partners == ((0,), (0, 1))
    assert (matches.low, matches.high) == (("seat_low",), ("roof_high",))


def test_where_no_names_match_everything_meets_everything():
    for by_name in (True, False):
        matches = match_parts(parts("a", "b"), parts("c", "d"), by_name=by_name)
        assert matches.partners == ((0, 1), (0, 1))
        assert not matches.by_name
