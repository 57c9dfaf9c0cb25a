"""A bake into a TGA with --ground was verified without: an RMS error of 0.53, and no word about it."""

import pytest

from shapes import torus

QUICK = ("--points", "500", "--rays", "64")


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """A ring, `ring.obj`, in the current folder."""
    positions, faces = torus(around=12, across=8)
    lines = ["v {} {} {}".format(*row) for row in positions] + ["f {} {} {}".format(*row) for row in faces + 1]
    (tmp_path / "ring.obj").write_text("\n".join(lines) + "\n")
    monkeypatch.chdir(tmp_path)


def bake(command, *words):
    done = command("bake", "ring.obj", "--size", "32", "-n", "16", "--backend", "ray", *words)
    assert done.returncode == 0, done.stderr
    return [line for line in done.stderr.splitlines() if "options of the bake" in line]


def test_both_commands_say_so(ring, command):
    (line,) = bake(command, "-o", "w.tga", "--ground", "--up", "z", "--only", "me*")
    assert line.startswith("w.tga cannot hold the options of the bake: pass them to verify (--only 'me*' --ground")
    assert line.endswith("), or write a .png")
    done = command("verify", "w.obj", *QUICK)
    assert (done.returncode, done.stderr) == (0, "w.tga does not say how it was baked: the defaults are assumed\n")
    assert command("verify", "w.obj", *QUICK, "--ground", "--up", "z").stderr == ""


@pytest.mark.parametrize(
    "words", [("-o", "w.tga"), ("-o", "w.png", "--ground"), ("-o", "w.bmp", "-o", "w.glb", "--ground")]
)
def test_nothing_is_said_where_nothing_is_lost(ring, command, words):
    assert bake(command, *words) == []
    if "--ground" in words:
        mesh = next(word.replace("png", "obj") for word in words if word in ("w.glb", "w.png"))
        assert command("verify", mesh, *QUICK).stderr.startswith("as baked, by ")
