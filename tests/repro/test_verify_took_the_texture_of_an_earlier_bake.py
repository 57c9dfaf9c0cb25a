"""A part of a GLB was baked again: verify measured the earlier texture, and the part was left out."""

import pytest

import aoprecalc as ao
from shapes import torus

QUICK = ao.BakeOptions(size=32, directions=16, backend="ray")


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """A GLB with the parts `wheel` and `tyre`, baked together, and then `tyre` alone."""
    folder = tmp_path_factory.mktemp("again")
    positions, faces = torus(around=12, across=8)
    lines = []
    for number, name in enumerate(("wheel", "tyre")):
        lines += [f"o {name}", f"usemtl {name}", *("v {} {} {}".format(*row) for row in positions + (0, 0, number))]
        lines += ["f {} {} {}".format(*row) for row in faces + 1 + number * len(positions)]
    (folder / "car.obj").write_text("\n".join(lines) + "\n")
    ao.bake(folder / "car.obj", QUICK).save(folder / "car.glb")
    ao.bake(folder / "car.glb", ao.BakeOptions(**vars(QUICK) | {"only": ("tyre",)})).save(folder / "again.glb")
    return folder / "again.glb"


def measured(mesh, *only):
    given = ao.VerifyOptions(points=500, rays=64, only=only or None)
    report = ao.verify(mesh, options=given)
    return report.texture.path, report.texture.triangles, report.options.only, report.warnings


def test_the_texture_is_that_of_the_parts_that_are_asked_for(again):
    tyre, wheel = measured(again, "tyre"), measured(again, "wheel")
    assert tyre[1:] == (192, ("tyre",), ())
    assert wheel[1:] == (192, ("wheel",), ())
    assert tyre[0] != wheel[0]


def test_without_a_name_it_is_one_that_covers_all_parts_of_its_bake(again):
    assert measured(again) == measured(again, "tyre")
    assert ao.compare(again, again).warnings == ()
