"""A name of 300 characters was answered by "check the disk", and one of 250 by "change its permissions"."""

import pytest

from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors

LONG = "n" * 300
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n"
QUICK = ("--size", "16", "-n", "16", "--backend", "ray")


@pytest.fixture
def triangle(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.obj").write_text(TRIANGLE)
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ("bake", "a.obj", "-o", f"{LONG}.png"),
        ("bake", "a.obj", "-o", f"{LONG}/"),
        ("bake", "a.obj", "-o", "b.png", "--report", f"{LONG}.json"),
        ("spheres", "a.obj", "-o", f"{LONG}.json"),
        ("report", f"{LONG}.json"),
        ("batch", "a.obj", "-o", LONG),
    ],
    ids=lambda words: " ".join(words)[:24],
)
def test_the_name_is_said_to_be_too_long(triangle, command, words):
    done = command(*words)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert line.startswith("error: ")
    assert "is too long (30" in line
    assert line.endswith("choose a shorter one")
    assert [path.name for path in triangle.iterdir()] == ["a.obj"]


@pytest.mark.parametrize(
    "words",
    [
        ("preview", f"{LONG}.obj", "-o", "p.png"),
        ("verify", f"{LONG}.obj"),
        ("verify", "a.obj", "--texture", f"{LONG}.png"),
    ],
)
def test_no_such_file_can_be_there(triangle, command, words):
    done = command(*words)
    assert done.returncode == 4
    assert f"{LONG}." in done.stderr
    assert "no such file" in done.stderr


@pytest.mark.parametrize("length", [236, 243, 251])
def test_names_that_fit_are_written(triangle, command, length):
    done = command("bake", "a.obj", "-o", f"{'n' * length}.png", *QUICK)
    assert (done.returncode, done.stderr.count("error")) == (0, 0)
    assert len(list(triangle.glob("nn*"))) == 3


def test_a_mesh_whose_texture_would_not_fit(triangle, command):
    (triangle / f"{'n' * 251}.obj").write_text(TRIANGLE)
    done = command("bake", f"{'n' * 251}.obj", *QUICK)
    assert "_ao.png: the name is too long (258 bytes" in done.stderr
    assert command("bake", f"{'n' * 251}.obj", "-o", "b.png", *QUICK).returncode == 0


@pytest.mark.parametrize("keyword", ["map_Kd", "map_Ka", "map_d", "bump"])
def test_a_material_may_name_such_a_file(triangle, command, keyword):
    (triangle / "a.obj").write_text(f"mtllib {LONG}.mtl\nmtllib a.mtl\n{TRIANGLE}")
    (triangle / "a.mtl").write_text(f"newmtl wood\n{keyword} {LONG}.png\n")
    scene = load_scene(triangle / "a.obj")
    assert base_colors(scene)[0][0].texture is None
    for output in ("b.glb", "c.obj"):
        done = command("bake", "a.obj", "-o", output, *QUICK)
        assert (done.returncode, done.stderr.count("error")) == (0, 0)


def test_parts_may_have_such_names(triangle, command):
    (triangle / "a.obj").write_text(TRIANGLE.replace("usemtl wood", f"o {LONG}\ng {LONG}\nusemtl {LONG}"))
    for output in ("b.glb", "c.obj", "d.ply"):
        assert command("bake", "a.obj", "-o", output, *QUICK).returncode == 0
        assert load_scene(triangle / output).parts
