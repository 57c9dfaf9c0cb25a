"""Which parts receive, and which occlude."""

from dataclasses import replace

import pytest

from aoprecalc.errors import InputError, UsageError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.options import LightOptions
from aoprecalc.types import Ground, Material
from shapes import box, scene_of_parts

CAR = {"body": {"car", "paint"}, "window": {"car", "glass"}, "sign": {"shop", "neon"}, "road": {"asphalt"}}
LOOKS = {"window": Material(transparent=True), "sign": Material(unlit=True)}


@pytest.fixture
def street():
    """Four boxes: a car's body and window, an unlit sign, a road."""
    made = scene_of_parts(*[box()] * len(CAR))
    parts = [
        replace(part, name=name, names=frozenset({name, *CAR[name]}), material=LOOKS.get(name, Material()))
        for part, name in zip(made.parts, CAR, strict=True)
    ]
    return replace(made, parts=tuple(parts))


def roles(scene, **options):
    """(names of those that receive, names of those that occlude)."""
    parts = assign_roles(scene, LightOptions(**options)).parts
    return {part.name for part in parts if part.receives}, {part.name for part in parts if part.occludes}


@pytest.mark.parametrize(
    ("options", "receive", "occlude"),
    [
        ({}, "body window road", "body sign road"),
        ({"glass_occludes": True}, "body window road", "body window sign road"),
        ({"only": ("car",)}, "body window", "body sign road"),
        ({"only": ("bod?", "asph*")}, "body road", "body sign road"),
        ({"exclude": ("car",)}, "road", "sign road"),
        ({"occluders_only": ("road", "paint")}, "window", "body sign road"),
        ({"only": ("car",), "exclude": ("glass",), "occluders_only": ("shop",)}, "body", "body sign road"),
    ],
    ids=str,
)
def test_who_receives_and_who_occludes(street, options, receive, occlude):
    assert roles(street, **options) == (set(receive.split()), set(occlude.split()))


def test_leaves_have_two_sides_and_with_the_option_all(street):
    leaf = replace(street, parts=(*street.parts[:3], replace(street.parts[3], material=Material(foliage=True))))
    assert assign_roles(leaf, LightOptions()).two_sided.reshape(4, 12).all(axis=1).tolist() == [False] * 3 + [True]
    assert assign_roles(leaf, LightOptions(two_sided=True)).two_sided.all()


def test_masks_follow_the_parts(street):
    made = assign_roles(street, LightOptions(exclude=("road",)))
    assert made.receives.reshape(4, 12).all(axis=1).tolist() == [True, True, False, False]
    assert made.occludes.reshape(4, 12).all(axis=1).tolist() == [True, False, True, False]


@pytest.mark.parametrize("option", ["only", "exclude", "occluders_only"])
def test_a_name_that_no_part_has_is_refused_with_those_that_there_are(street, option):
    with pytest.raises(UsageError, match=rf"{option} has 'Body', .*mean 'body'\?.*'asphalt', .*, 'window'$"):
        assign_roles(street, LightOptions(**{option: ("Body",)}))


def test_brackets_are_parts_of_names(street):
    wheel = replace(street, parts=(*street.parts[:3], replace(street.parts[3], name="wheel[0]")))
    assert roles(wheel, only=("wheel[0]",))[0] == {"wheel[0]"}
    assert roles(wheel, only=("wheel[*",))[0] == {"wheel[0]"}


def test_an_unlit_part_that_is_asked_for_is_refused_with_the_reason(street):
    with pytest.raises(InputError, match="nothing to bake: its materials are unlit"):
        assign_roles(street, LightOptions(only=("neon",)))


def test_an_upward_axis_without_a_floor_is_refused():
    with pytest.raises(UsageError, match="up is 'z', but there is no ground"):
        LightOptions(up="z")


def test_nothing_left_to_bake_is_refused(street):
    with pytest.raises(UsageError, match="leave no part that receives"):
        assign_roles(street, LightOptions(exclude=("*",)))
    neon = replace(street, parts=tuple(replace(part, material=Material(unlit=True)) for part in street.parts))
    with pytest.raises(InputError, match="unlit"):
        assign_roles(neon, LightOptions())


@pytest.mark.parametrize(
    ("kind", "up", "floor"), [("glb", "auto", (0, 1, 0)), ("stl", "auto", (0, 0, 1)), ("stl", "x", (1, 0, 0))]
)
def test_the_floor_is_below(street, kind, up, floor):
    made = replace(street, format=kind)
    assert assign_roles(made, LightOptions()).around.ground is None
    assert assign_roles(made, LightOptions(ground=True, up=up)).around.ground == Ground(floor)


def test_instances_share_with_the_first_that_receives(street):
    first, *others = (replace(part, material=Material()) for part in street.parts)
    repeated = replace(others[1], instance_of=0, duplicate_of=1)
    made = replace(street, parts=(first, replace(others[0], instance_of=0), repeated, others[2]))

    def shares(share, **options):
        return [part.uv_owner for part in assign_roles(made, LightOptions(**options), share=share).parts]

    assert shares(False) == [None, None, 1, None]
    assert shares(True) == [None, 0, 0, None]
    assert shares(True, exclude=("body",)) == [None, None, 1, None]
    assert shares(True, occluders_only=("window",)) == [None, None, 0, None]
