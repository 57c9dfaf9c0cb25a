"""After `bake ring.obj`, `verify ring.obj` found no texture, though ring_ao.obj was beside it."""

import pytest

import aoprecalc as ao
from shapes import torus


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with a ring that has UVs, one that has none, and the bake of both."""
    monkeypatch.chdir(tmp_path)
    result = ao.bake(ao.Mesh(*torus(around=12, across=8)), ao.BakeOptions(size=32, directions=16, backend="ray"))
    for name in ("plain", "textured"):
        result.save(tmp_path / f"{name}_ao.png", mesh_output=tmp_path / f"{name}_ao.obj")
    lines = (tmp_path / "textured_ao.obj").read_text().splitlines(keepends=True)
    told = [line for line in lines if not line.startswith(("mtllib", "usemtl", "#"))]
    (tmp_path / "textured.obj").write_text("".join(told))
    positions, faces = torus(around=12, across=8)
    bare = ["v {} {} {}\n".format(*row) for row in positions] + ["f {} {} {}\n".format(*row) for row in faces + 1]
    (tmp_path / "plain.obj").write_text("".join(bare))
    return tmp_path


@pytest.mark.parametrize("name", ["plain", "textured"])
def test_the_error_names_it(folder, command, name):
    done = command("verify", f"{name}.obj")
    assert done.returncode == 4
    assert done.stderr.endswith(f"; did you mean {name}_ao.obj?\n")


def test_a_picture_is_no_mesh(folder, command):
    done = command("verify", "plain_ao.png")
    expected = "error: plain_ao.png: is a picture, verify takes its mesh: aoprecalc verify plain_ao.obj\n"
    assert (done.returncode, done.stderr) == (2, expected)
    (folder / "plain_ao.obj").unlink()
    assert command("verify", "plain_ao.png").stderr.endswith("pass that, and the picture with --texture\n")
