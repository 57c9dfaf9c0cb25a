"""A texture that was baked with --ground --two-sided was verified without: an RMS error of 0.37, and no hint."""

import pytest

import aoprecalc as ao

DISC = [[0, 0.1, 0], [1, 0.1, 0], [1, 0.1, -1], [0, 0.1, -1]]
GIVEN = ao.BakeOptions(size=64, directions=256, backend="ray", ground=True, up="y", two_sided=True)


@pytest.fixture
def sheets():
    """Two sheets over one another, which look down."""
    vertices = [*DISC, *([x, y + 0.3, z] for x, y, z in DISC)]
    return ao.Mesh(vertices, [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]], name="sheets")


def test_the_options_travel_with_the_texture(sheets, tmp_path):
    result = ao.bake(sheets, GIVEN)
    files = result.save(f"{tmp_path}/")
    measured = [
        ao.verify(mesh, texture, ao.VerifyOptions(points=1000, rays=256))
        for mesh, texture in ((files.mesh, None), (files.mesh, files.texture), (result.mesh, None))
    ]
    assert [(report.options.ground, report.options.two_sided) for report in measured] == [(True, True)] * 3
    assert max(report.error for report in measured) < 0.05
    wrong = ao.VerifyOptions(points=1000, rays=256, ground=False, two_sided=False)
    assert ao.verify(files.mesh, options=wrong).error > 0.3


def test_the_command_line_says_what_it_took(sheets, tmp_path, command):
    mesh = ao.bake(sheets, GIVEN).save(f"{tmp_path}/").mesh
    words = ("verify", mesh, "--points", "500", "--rays", "64", "--tolerance", "0.1")
    done = command(*words)
    assert (done.returncode, done.stderr) == (0, f"as baked, by image 0 of {mesh}: --two-sided --ground --up y\n")
    assert command(*words, "--no-two-sided").returncode == 1
