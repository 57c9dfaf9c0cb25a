"""What `verify` takes from the bake of a texture, and what it is told instead."""

import pytest

import aoprecalc as ao
from aoprecalc.errors import ArgumentError
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.options.fields import option_fields

BAKED = ValueOptions(ground=True, up="z", two_sided=True, exclude=("pot",), estimator="mean", crease_angle=40)
QUICK = {"points": 200, "rays": 64}


def test_verify_has_the_options_that_define_the_value_and_bake_too():
    names = [{field.name for field in option_fields(kind)} for kind in (ValueOptions, VerifyOptions, BakeOptions)]
    value, verify, bake = names
    assert value - verify == {"instances"}  # which verify sees by the UVs
    assert value < bake
    assert verify & bake - value == {"seed", "threads"}
    assert all(getattr(VerifyOptions(), name) is None for name in value & verify)


def test_what_is_given_wins_over_the_bake_and_the_bake_over_the_default():
    assert VerifyOptions().value_options() == ValueOptions()
    assert VerifyOptions().value_options(BAKED) == BAKED
    given = VerifyOptions(two_sided=False, exclude=(), estimator="ratio", ground=True)
    expected = ValueOptions(ground=True, up="z", crease_angle=40)
    assert given.value_options(BAKED) == expected
    assert VerifyOptions(ground=False).value_options(BAKED).up == "auto"
    assert VerifyOptions(up="x").value_options(BAKED).up == "x"
    with pytest.raises(ArgumentError, match="up is 'x', but there is no ground"):
        VerifyOptions(up="x").value_options()


def test_none_takes_away_the_maximum_distance_of_a_bake():
    baked = ValueOptions(max_distance="10%", falloff="smooth", cone=90)
    assert VerifyOptions().value_options(baked) == baked
    assert VerifyOptions(max_distance="none").value_options(baked) == ValueOptions(cone=90)
    assert VerifyOptions(max_distance="none").value_options() == ValueOptions()
    assert BakeOptions(max_distance="none") == BakeOptions()
    with pytest.raises(ArgumentError, match="falloff is 'linear', but occluders count at any distance"):
        VerifyOptions(max_distance="none", falloff="linear").value_options(baked)
    with pytest.raises(ArgumentError, match="such as '10%', or 'none'"):
        VerifyOptions(max_distance="nothing")


@pytest.fixture
def blocks(tmp_path):
    """The path of a file with two parts."""
    lines = []
    for name, x in (("table", 0), ("pot", 2)):
        lines += [f"o {name}", f"v {x} 0 0", f"v {x + 1} 0 0", f"v {x} 1 0", f"v {x} 0 1"]
        lines += ["f -4 -2 -3", "f -4 -3 -1", "f -4 -1 -2", "f -3 -2 -1"]
    (tmp_path / "blocks.obj").write_text("\n".join(lines) + "\n")
    return tmp_path / "blocks.obj"


def bake(mesh, **options):
    return ao.bake(mesh, BakeOptions(size=64, directions=64, backend="ray", **options)).save(f"{mesh.parent}/out/").mesh


def test_a_part_that_is_gone_is_a_warning(blocks):
    mesh = bake(blocks, exclude=("pot", "pot*"))
    mesh.write_text(mesh.read_text().replace("o pot", "o vase").replace("g pot", "g vase"))
    report = ao.verify(mesh, options=VerifyOptions(**QUICK))
    assert [line for line in report.warnings if "of a part" in line] == [
        f"{mesh.parent / 'blocks_ao.png'} was baked with --exclude {name!r}, which is not the name of a part of "
        f"{mesh}; it is left out"
        for name in ("pot", "pot*")
    ]
    assert report.options == ValueOptions()
    with pytest.raises(ArgumentError, match="exclude has 'pot', which is not the name of a part"):
        ao.verify(mesh, options=VerifyOptions(**QUICK, exclude=("pot",)))


def test_the_axis_and_the_angle_of_stl_travel_too(tmp_path):
    import trimesh

    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.stl")
    mesh = bake(tmp_path / "box.stl", ground=True)
    assert mesh.suffix == ".glb"
    report = ao.verify(mesh, options=VerifyOptions(**QUICK))
    assert report.options == ValueOptions(ground=True, up="z", crease_angle=40)
    assert report.options_from == f"image 0 of {mesh}"
    assert report.to_dict()["options"]["up"] == "z"


def test_a_texture_of_another_program_is_measured_by_the_defaults(blocks):
    from PIL import Image

    mesh = bake(blocks, ground=True)
    picture = mesh.parent / "blocks_ao.png"
    with Image.open(picture) as image:
        image.copy().save(mesh.parent / "other.png")
    report = ao.verify(mesh, mesh.parent / "other.png", VerifyOptions(**QUICK))
    assert (report.options, report.options_from) == (ValueOptions(), None)
    assert ao.verify(mesh, picture, VerifyOptions(**QUICK)).options.ground


def test_the_command_line_tells_given_from_default(blocks, command):
    mesh = bake(blocks, ground=True, estimator="mean")
    words = ("verify", mesh, "--points", "200", "--rays", "64")
    picture = mesh.parent / "blocks_ao.png"
    assert command(*words).stderr == f"as baked, by {picture}: --estimator mean --ground --up y\n"
    done = command(*words, "--estimator", "ratio", "--no-ground")
    assert (done.returncode, done.stderr) == (0, "")
    assert command(*words, "-q").stderr == ""


def test_the_parts_of_the_bake_are_those_that_are_measured(blocks):
    mesh = bake(blocks, exclude="pot", only="table")
    report = ao.verify(mesh, options=VerifyOptions(**QUICK))
    assert (report.options.exclude, report.options.only) == (("pot",), ("table",))
    assert report.texture.triangles == 4
    assert not [line for line in report.warnings if "left out" in line]
