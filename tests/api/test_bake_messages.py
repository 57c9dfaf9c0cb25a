"""Lines about a bake that ask for another one: soft edges, parts without texels, surroundings, equal names."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.surface import share_at_bends
from aoprecalc.options import BakeOptions
from aoprecalc.types import Material
from shapes import ball, bowl, box, city, join, quad, scene, scene_of_parts, torus

STOOL = join(box((-1, -1, 1), (1, 1, 1.3)), box((-0.4, -0.4, 0), (0.4, 0.4, 1)))


def bake(made, **options):
    return bake_scene(made, BakeOptions(**{"size": 64, "padding": 1, "directions": 64, "backend": "ray", **options}))


def notes_on_normals(made, **options):
    return [line for line in bake(made, **options).notes if "normals" in line]


def test_the_share_along_bends_is_that_of_the_faces_there():
    assert share_at_bends(scene(*box()), 40) == 1
    assert share_at_bends(scene(*box()), 95) == 0
    assert share_at_bends(scene(*ball(3)), 20) == 0
    tent = join(quad((0, 0, 0), (4, 0, 0), (0, 4, 0), 4), quad((4, 0, 0), (0, 0, -1), (0, 4, 0)))
    positions, same = np.unique(tent[0], axis=0, return_inverse=True)
    lone = scene(positions, same.ravel()[tent[1]])  # whose edge of four pieces meets one of a single piece: no bend
    assert share_at_bends(lone, 40) == 0
    finer = join(quad((0, 0, 0), (4, 0, 0), (0, 4, 0), 4), quad((4, 0, 0), (0, 0, -4), (0, 4, 0), 4))
    positions, same = np.unique(finer[0], axis=0, return_inverse=True)
    assert share_at_bends(scene(positions, same.ravel()[finer[1]]), 40) == pytest.approx(1 / 8)


def test_the_sides_of_a_thin_sheet_are_no_bend():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 3)
    assert share_at_bends(scene(positions, np.concatenate([faces, faces[:, ::-1]])), 40) == 0


def test_edges_that_became_soft_are_told():
    (line,) = notes_on_normals(scene(*box()))
    assert "100% of the surface" in line
    assert "--crease-angle 40" in line
    assert notes_on_normals(scene(*bowl()))  # its rim


@pytest.mark.parametrize("options", [{"crease_angle": 40.0}, {"crease_angle": 180.0}, {"normals": "flat"}], ids=str)
def test_who_has_chosen_normals_is_told_nothing(options):
    assert not notes_on_normals(scene(*box()), **options)


def test_smooth_shapes_stl_and_normals_of_the_file_are_told_nothing():
    cube = scene(*box())
    normals = np.ones((12, 3, 3)) / np.sqrt(3)
    for made in (scene(*torus()), replace(cube, format="stl"), scene(*box(), normals=normals)):
        assert not notes_on_normals(made)


@pytest.mark.parametrize(("width", "told"), [(20, False), (800, True)])
def test_a_part_that_a_floor_leaves_no_texels_is_told(width, told):
    floor = quad((-width / 2, -width / 2, 0), (width, 0, 0), (0, width, 0))
    (line,) = bake(scene_of_parts(STOOL, floor), size=256).warnings
    assert line.startswith("'part 1': ")
    assert ("leaves 1 part fewer than 64 texels ('part 0': " in line) == told


def test_parts_with_few_texels_are_told_where_their_ao_varies():
    block = box((-4, -4, -4), (4, 4, 4))
    inside, outside = ((0.05 * STOOL[0] + (x, 0, 0), STOOL[1]) for x in (0, 5))
    others = [(block[0] + (9 * i, 0, 0), block[1]) for i in (1, 2, 3)]  # so that no part has most of the texture
    baked = bake(scene_of_parts(block, inside, outside, *others), normals="flat")
    (line,) = [line for line in baked.warnings if "fewer than" in line]
    assert line.startswith("1 part has fewer than 64 texels ('part 2': ")
    assert line.endswith("use a larger --size, or bake it alone with --only")


def test_a_sky_is_told_in_one_line():
    made = city(boxes=20)  # the box of the sky faces inwards
    about = [line for line in bake(made, size=256, normals="flat").warnings if "gutters" not in line]
    assert len(about) == 1
    assert about[0].startswith("'sky': ")


def test_parts_of_one_name_are_named_once():
    made = scene_of_parts(box((-3, -3, -3), (3, 3, 3)), *(box((x, -1, -1), (x + 1, 1, 1)) for x in (-2, 0)))
    names = "room", "shelf", "shelf"
    made = replace(made, parts=tuple(replace(part, name=name) for part, name in zip(made.parts, names, strict=True)))
    (line,) = [line for line in bake(made, normals="flat").notes if "dark" in line]
    assert "('shelf', 2 times: 100%)" in line


def warnings_on_backs(made, **options):
    return [line for line in bake(made, two_sided=True, backfaces="ignore", **options).warnings if "backs" in line]


def test_two_sides_of_a_closed_surface_without_backs_are_told():
    (line,) = warnings_on_backs(scene_of_parts(STOOL, quad((9, 0, 0), (1, 0, 0), (0, 1, 0))))
    area, sheet = 2 * 4 + 8 * 0.3 + 2 * 0.64 + 4 * 0.8, 1  # the seat and the leg are boxes
    assert line.startswith(f"{area / (area + sheet):.0%} of the surface is closed and too light")
    assert not warnings_on_backs(scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0))))
    (part,) = scene_of_parts(STOOL).parts
    double = replace(scene(*STOOL), parts=(replace(part, material=Material(double_sided=True)),))
    assert not warnings_on_backs(double)  # whose faces occlude from both sides
    assert not [line for line in bake(scene(*STOOL), two_sided=True).warnings if "backs" in line]


def test_the_inner_side_of_a_bowl_is_light_through_backs():
    """What the warning says: alone, either option keeps the shadow inside the bowl."""
    means = [
        float((texture := bake(scene(*bowl()), size=128, **options).texture).values[texture.valid].mean())
        for options in ({}, {"two_sided": True}, {"backfaces": "ignore"}, {"two_sided": True, "backfaces": "ignore"})
    ]
    assert means[:3] == pytest.approx([means[0]] * 3, abs=0.01)
    assert means[3] > means[0] + 0.1


def test_options_of_bent_normals_alone_are_told():
    def told(**options):
        return [line for line in bake(scene(*STOOL), **options).notes if "no effect" in line]

    assert told(green="down") == ["--green has no effect without --bent-normals or --sh"]
    assert told(bent_space="world", green="down") == [
        "--bent-space and --green have no effect without --bent-normals or --sh"
    ]
    assert told(bent_space="tangent", green="up") == told(green="down", bent_normals=True) == []
