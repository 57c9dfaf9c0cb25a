"""Scenes of several parts: glass, floors, parts that take no part, instances that share a place."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import AlphaMask, Material
from shapes import ball, box, clutter, dented, quad, quad_uvs, scene, scene_of_parts, torus, triangle_a_cell

backends = pytest.mark.parametrize("backend", ["gl", "ray"])
slow = pytest.mark.slow
ONE_STEP = 1 / 255


def bake(made, backend, **options):
    return bake_scene(
        made, BakeOptions(**{"width": 128, "height": 128, "directions": 256, "backend": backend, **options})
    )


def values(baked):
    return baked.texture.values[baked.texture.valid]


def with_part(made, number, **changes):
    parts = list(made.parts)
    parts[number] = replace(parts[number], **changes)
    return replace(made, parts=tuple(parts))


def on_part(baked, number, count=400):
    """Values of the texture at points spread over one part, and these points."""
    mapped = np.zeros(len(baked.scene.faces), bool)
    mapped[baked.scene.parts[number].faces] = True
    points = sample_surface(baked.scene, mapped & baked.atlas.mapped, count, 0)
    return bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs), repeats=False), points


@backends
def test_a_ball_in_a_glass_ball_is_open_and_in_an_opaque_one_closed(backend):
    made = with_part(scene_of_parts(ball(2), ball(3, 2.0)), 1, material=Material(transparent=True))
    open_inside, closed = (bake(made, backend, glass_occludes=occludes) for occludes in (False, True))
    assert on_part(open_inside, 0)[0].min() == 1
    assert on_part(closed, 0)[0].max() <= 1.5 * ONE_STEP
    assert any("1 part ('part 1') is transparent" in line for line in open_inside.notes)
    assert not any("transparent" in line for line in closed.notes)
    # Glass receives: its outside is open, whatever is in it.
    assert on_part(open_inside, 1)[0].min() >= 1 - ONE_STEP


@backends
@pytest.mark.parametrize("up", [pytest.param("x", marks=slow), pytest.param("y", marks=slow), "z"])
def test_a_ball_on_a_floor_sees_the_share_of_the_sky(backend, up):
    """(1 + n.up) / 2: the cosine-weighted share of the half sphere above a level plane."""
    made = scene(*ball(3))
    baked = bake(made, backend, ground=True, up=up, directions=1000)
    found, points = on_part(baked, 0)
    normals = points.interpolate(made.corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.abs(found - (1 + normals[:, "xyz".index(up)]) / 2).max() < 0.02


@backends
def test_a_floor_is_nowhere_but_below(backend):
    """It does not matter how far down it is, and a level plane above it loses nothing."""
    plane = quad((0, 1, 0), (0, 0, 2), (2, 0, 0))
    assert (values(bake(scene(*plane), backend, ground=True)) == 1).all()
    assert (values(bake(scene(*plane), backend, ground=True, two_sided=True)) == 1).all()
    upside_down = scene(plane[0], plane[1][:, ::-1])
    assert values(bake(upside_down, backend, ground=True)).max() < 1e-6


@backends
def test_what_is_excluded_is_as_if_it_were_not_there(backend):
    """However far away it lies, and whatever it hides."""
    ring = torus(around=16, across=8)
    alone = scene(*ring, triangle_a_cell(len(ring[1])))
    shapes = ring, box((-3, -3, -3), (3, 3, 3)), box((900, 0, 0), (901, 1, 1))
    count = len(shapes[0][1])
    more = np.concatenate([alone.uvs, np.zeros((24, 3, 2))])
    made = scene_of_parts(*shapes, uvs=more)
    whole = bake(alone, backend, unwrap="keep")
    assert values(whole).min() < 0.7
    without = bake(made, backend, unwrap="keep", exclude=("part 1", "part 2"))
    assert without.atlas.mapped.tolist() == [True] * count + [False] * 24
    assert np.array_equal(without.texture.valid, whole.texture.valid)
    assert np.abs(without.texture.values - whole.texture.values).max() < 1e-6
    hidden = bake(made, backend, unwrap="keep", occluders_only=("part 1", "part 2"))
    assert values(hidden).max() < 0.03  # the far box makes maps coarse


@backends
def test_a_ball_in_a_box_with_holes_sees_as_much_as_the_holes_let_through(backend):
    """Of the 256 squares on each wall a quarter is opaque."""
    alpha = np.kron(np.random.default_rng(4).permutation(np.arange(256) % 4 == 0).reshape(16, 16), np.ones((8, 8)))
    walls = [quad(at, right, up) for at, right, up in cube_walls(3.0)]
    uvs = np.tile(quad_uvs((0, 0), (1, 1)), (6, 1, 1))
    made = scene_of_parts(ball(3), *walls)
    for number in range(6):
        alpha_mask = AlphaMask(alpha.astype(np.float32), uvs[:2], np.ones((2, 3)), 0.5)
        made = with_part(made, number + 1, material=Material(alpha_mask=alpha_mask))
    options = {"directions": 1000, "occluders_only": tuple(f"part {n}" for n in range(1, 7))}
    baked = bake(made, backend, **options)
    # Through holes spread over the box as evenly as here the ball sees three quarters of the sky, more or less.
    assert abs(values(baked).mean() - 0.75) < 0.02
    asked = VerifyOptions(rays=1024, occluders_only=options["occluders_only"])
    found, points = on_part(baked, 0)
    truth = reference_ao(assign_roles(made, asked.value_options()), baked.normals, points, asked, Progress())
    assert np.abs(found - truth).mean() < 0.012


@backends
def test_only_leafy_parts_have_the_lighter_of_their_sides(backend):
    """Two pairs of squares, each with a roof close above the front of one of them."""
    sheets = [quad((x, 0, 0), (1, 0, 0), (0, 1, 0)) for x in (0, 5)]
    roofs = [quad((x - 2, -2, 0.02), (5, 0, 0), (0, 5, 0)) for x in (0, 5)]
    made = with_part(scene_of_parts(*sheets, *roofs), 1, material=Material(foliage=True))
    baked = bake(made, backend, occluders_only=("part 2", "part 3"), padding=2)
    plain, foliage = (on_part(baked, number)[0] for number in (0, 1))
    assert plain.max() < 0.05
    assert foliage.min() == 1
    asked = VerifyOptions(rays=256, occluders_only=("part 2", "part 3"))
    for number, values_there in ((0, plain), (1, foliage)):
        points = on_part(baked, number)[1]
        truth = reference_ao(assign_roles(made, asked.value_options()), baked.normals, points, asked, Progress())
        assert np.abs(truth - values_there).max() < 0.05


def cube_walls(half):
    """(origin, right, up) of the six sides of a cube, seen from outside."""
    axes = half * np.eye(3)
    for turn in range(3):
        a, b, c = np.roll(axes, turn, axis=0)
        yield a - b - c, 2 * b, 2 * c
        yield -a - b - c, 2 * c, 2 * b


@backends
def test_without_any_occluder_all_is_open(backend):
    made = with_part(scene(*dented(3)), 0, material=Material(transparent=True))
    assert (values(bake(made, backend)) == 1).all()


@backends
def test_the_reference_knows_glass_floors_and_what_is_excluded(backend):
    shapes = dented(3), box((-1, 1.2, -1), (1, 3, 1)), box((1.2, -1, -1), (3, 1, 1)), box((-3, -1, -1), (-1.2, 1, 1))
    made = with_part(scene_of_parts(*shapes), 1, material=Material(transparent=True))
    options = {"ground": True, "exclude": ("part 2",)}
    baked = bake(made, backend, width=256, height=256, directions=512, **options)
    found, points = on_part(baked, 0, 1000)
    asked = VerifyOptions(rays=1024, **options)
    truth = reference_ao(assign_roles(made, asked.value_options()), baked.normals, points, asked, Progress())
    assert np.sqrt(((found - truth) ** 2).mean()) < 0.012
    for other in ({}, {"ground": True}, {"exclude": ("part 2",)}, {**options, "glass_occludes": True}):
        wrong = VerifyOptions(rays=256, **other)
        truth = reference_ao(assign_roles(made, wrong.value_options()), baked.normals, points, wrong, Progress())
        assert np.sqrt(((found - truth) ** 2).mean()) > 0.03


def open_and_closed():
    """Two instances, one in the open and one within a closed box, which is part 2."""
    made = scene_of_parts(ball(2), (ball(2)[0] + (99, 0, 0), ball(2)[1]), box((97, -2, -2), (101, 2, 2)))
    return with_part(made, 1, instance_of=0)


@backends
@pytest.mark.parametrize(
    ("directions", "error"), [(256, 0.05), pytest.param(1000, 0.015, marks=slow), pytest.param(4000, 0.01, marks=slow)]
)
def test_instances_that_share_have_the_mean_of_what_they_see(backend, directions, error):
    baked = bake(open_and_closed(), backend, instances="share", occluders_only=("part 2",), directions=directions)
    assert np.sqrt(((values(baked) - 0.5) ** 2).mean()) < error
    assert baked.atlas.mapped.sum() == len(ball(2)[1])


@backends
def test_instances_that_do_not_share_have_what_each_sees(backend):
    apart = bake(open_and_closed(), backend, occluders_only=("part 2",), directions=128)
    assert on_part(apart, 0)[0].min() == 1
    assert on_part(apart, 1)[0].max() <= 1.5 * ONE_STEP


@pytest.mark.parametrize(
    ("backend", "count"),
    [
        ("ray", 3),
        *(pytest.param(*case, marks=slow) for case in product(["gl", "ray"], [2, 3, 20]) if case != ("ray", 3)),
    ],
)
def test_instances_with_the_same_surroundings_share_what_each_would_have(backend, count):
    """Also where a placement mirrors them, which turns the order of their corners."""
    positions, faces = clutter(3)
    copies = [(positions, faces)]
    for number in range(1, count):
        mirrored = number % 2 == 1
        place = positions * (-1 if mirrored else 1, 1, 1) + (40.0 * number, 0, 0)
        copies.append((place, faces[:, [0, 2, 1]] if mirrored else faces))
    uvs = triangle_a_cell(len(faces))
    of_copies = [uvs[:, [0, 2, 1]] if number % 2 else uvs for number in range(count)]
    made = scene_of_parts(*copies, uvs=np.concatenate(of_copies))
    parts = [
        replace(part, vertices=copies[at][1].astype(np.int32), instance_of=0 if at else None)
        for at, part in enumerate(made.parts)
    ]
    made = replace(made, parts=tuple(parts))
    alone = bake(scene(positions, faces, uvs), "ray", directions=1000)
    shared = bake(made, backend, instances="share", shadow_size=2048, directions=1000)
    one, two = on_part(alone, 0)[0], on_part(shared, 0)[0]
    assert one.min() < 0.6
    assert np.sqrt(((one - two) ** 2).mean()) < (
        (0.012 if count < 8 else 0.04) if backend == "ray" else 0.03 + 0.02 * count
    )
