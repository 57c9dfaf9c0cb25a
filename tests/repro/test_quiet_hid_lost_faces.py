"""`-q` kept the loss of faces from the user; a batch told it only with `-v`."""

import pytest

from shapes import box

LOST = "1 face of fewer than 3 corners is skipped"
SMALL = ("--size", "32", "-n", "64", "--padding", "1")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The present folder, with a box of which one face has two corners."""
    monkeypatch.chdir(tmp_path)
    positions, faces = box()
    lines = [f"v {x} {y} {z}" for x, y, z in positions] + [f"f {a} {b} {c}" for a, b, c in faces + 1] + ["f 1 2"]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    return tmp_path


def test_bake_tells_it(folder, command):
    done = command("bake", "box.obj", "-q", *SMALL)
    assert (done.returncode, done.stderr) == (0, f"warning: {LOST}\n")
    assert LOST not in done.stdout


@pytest.mark.parametrize("words", [(), ("-q",)])
def test_a_batch_tells_it(folder, command, words):
    done = command("batch", "box.obj", "-o", "out", "--bake", " ".join(SMALL), "--no-cache", "-j", 1, *words)
    assert done.returncode == 0
    assert f"warning: box: {LOST}" in done.stderr.splitlines()
