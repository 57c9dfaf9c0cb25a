"""`aoprecalc preview`: its files, its line, its errors, and that it opens what it made."""

import json
import os

import click
import numpy as np
import pytest
from PIL import Image

from aoprecalc import system
from aoprecalc.io import write_image
from shapes import quad, quad_uvs

SMALL = ["--size", "48x36", "--backend", "ray"]


@pytest.fixture
def folder(tmp_path):
    """A sheet with UVs, its texture beside it, a texture and spheres for it, and broken ones."""
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells=2)
    lines = ["mtllib sheet.mtl", "usemtl sheet"]
    lines += [f"v {x} {y} {z}" for x, y, z in positions] + [f"vt {x} {y}" for x, y, _ in positions]
    lines += ["f " + " ".join(f"{corner + 1}/{corner + 1}" for corner in face) for face in faces]
    assert quad_uvs((0, 0), (1, 1), 2).shape == (8, 3, 2)
    (tmp_path / "sheet.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "sheet.mtl").write_text("newmtl sheet\nmap_Kd sheet_ao.png\n")
    write_image(tmp_path / "sheet_ao.png", np.full((4, 4), 0.5, np.float32))
    write_image(tmp_path / "other.png", np.ones((4, 4), np.float32))
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "s.csv").write_text("x,y,z,radius\n0.5,0.5,0,0.25\n")
    (tmp_path / "broken.json").write_text('{"spheres": [{"center": [0, 0], "radius": 1}]}')
    (tmp_path / "broken.png").write_bytes(b"no picture")
    return tmp_path


def listing(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def size_of(path):
    with Image.open(path) as picture:
        return picture.size


@pytest.mark.parametrize(
    ("words", "made", "size"),
    [
        (["sheet.obj"], ["sheet_preview.png"], (48, 36)),
        (["sheet_ao.png"], ["sheet_ao_preview.png"], (48, 36)),
        (["sheet.obj", "-o", "p.jpg"], ["p.jpg"], (48, 36)),
        (["sheet.obj", "-o", "made/"], ["made/sheet_preview.png"], (48, 36)),
        (["sheet.obj", "--turntable", "--frames", "2"], ["sheet_turntable.webp"], (48, 36)),
        (["sheet.obj", "--turntable", "--frames", "2", "-o", "f/"], ["f/0000.png", "f/0001.png"], (48, 36)),
        (["sheet.obj", "--views", "2", "-o", "p.webp"], ["p.webp"], None),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_it_writes_a_picture_and_says_so(folder, run, words, made, size):
    before = listing(folder)
    done = run(folder, "preview", *words, *SMALL)
    assert done.returncode == 0, done.stderr
    assert listing(folder) - before == {*made}
    assert size is None or size_of(folder / made[0]) == size
    (line,) = done.stdout.splitlines()
    assert line.startswith(made[0])
    assert "ao: sheet.obj, 8 triangles with sheet_ao.png" in line


def test_it_says_what_was_drawn(folder, run):
    done = run(folder, "preview", "sheet.obj", "--texture", "other.png", "--spheres", "s.csv", *SMALL)
    expected = "48 x 36, ao: sheet.obj, 8 triangles with other.png, 1 sphere\n"
    assert done.stdout == f"sheet_preview.png  {expected}"
    done = run(folder, "preview", "bare.obj", *SMALL)
    assert done.stdout == "bare_preview.png  48 x 36, clay: bare.obj, 1 triangle\n"
    assert "drawn as clay; to bake it: aoprecalc bake bare.obj" in done.stderr
    assert run(folder, "preview", "bare.obj", *SMALL, "-q").stderr == ""


def test_the_document(folder, run):
    report = json.loads(run(folder, "preview", "sheet.obj", "--turntable", "--frames", "3", *SMALL, "--json").stdout)
    assert report["input"] == {"path": "sheet.obj", "triangles": 8}
    assert (report["texture"], report["spheres"], report["shading"]) == ("sheet_ao.png", None, "ao")
    assert (report["width"], report["height"], report["pictures"]) == (48, 36, 3)
    assert report["outputs"] == ["sheet_turntable.webp"]
    assert {"load", "draw", "write", "total"} <= set(report["seconds"])


BAD = {
    "several meshes": (["sheet.obj", "bare.obj"], 2, "takes one mesh"),
    "a missing mesh": (["none.obj"], 4, "no such file"),
    "a picture without a mesh": (["other.png"], 2, "no mesh is beside it"),
    "a missing picture": (["none.png"], 4, "no such file"),
    "spheres for a mesh": (["s.csv"], 2, "is no mesh"),
    "a mesh of no kind": (["sheet.doc"], 2, ".doc"),
    "a picture of no kind": (["sheet.obj", "-o", "p.gif"], 2, ".gif is not one of .png, .jpg, .jpeg, .webp"),
    "a turntable of one picture": (["sheet.obj", "--turntable", "-o", "p.png"], 2, "a turntable is an animated .webp"),
    "frames of no turntable": (["sheet.obj", "--frames", "9"], 2, "--turntable"),
    "a turntable of views": (["sheet.obj", "--turntable", "--views", "2"], 2, "use one of them"),
    "more frames than memory": (
        ["sheet.obj", "--turntable", "--frames", "720", "--size", "4096"],
        2,
        "pixels, at most",
    ),
    "broken spheres": (["sheet.obj", "--spheres", "broken.json"], 4, "broken.json"),
    "missing spheres": (["sheet.obj", "--spheres", "none.json"], 4, "none.json"),
    "spheres of no kind": (["sheet.obj", "--spheres", "sheet.mtl"], 4, ".mtl"),
    "no spheres to lay over": (["sheet.obj", "--spheres-view", "over"], 2, "there are no --spheres"),
    "a broken texture": (["sheet.obj", "--texture", "broken.png"], 4, "cannot be read as an image"),
    "a texture without UVs": (["bare.obj", "--texture", "other.png"], 4, "has no UVs"),
    "the mesh as output": (["sheet.obj", "-o", "sheet.obj"], 2, "not one of .png"),
    "its texture as output": (["sheet.obj", "-o", "sheet_ao.png"], 2, "belongs to the input itself"),
    "a given texture as output": (["sheet.obj", "--texture", "other.png", "-o", "./other.png"], 2, "belongs to the"),
    "a folder that is missing": (["sheet.obj", "-o", "none/p.png"], 1, "no folder"),
    "a file for a folder": (["sheet.obj", "-o", "other.png/"], 1, "other.png"),
    "a folder for a frame": (["sheet.obj", "--turntable", "--frames", "2", "-o", "taken/"], 1, "is a folder"),
}


@pytest.mark.parametrize("case", BAD)
def test_failures_are_one_line_and_leave_nothing(case, folder, run):
    words, code, expected = BAD[case]
    (folder / "taken" / "0001.png").mkdir(parents=True)
    before = {path: (folder / path).read_bytes() for path in listing(folder)}
    done = run(folder, "preview", *SMALL, *words)
    assert done.returncode == code, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert expected in errors[0]
    assert done.stdout == ""
    assert {path: (folder / path).read_bytes() for path in listing(folder)} == before


@pytest.mark.skipif(os.name == "posix" and os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(folder, run):
    (folder / "closed").mkdir(mode=0o555)
    done = run(folder, "preview", "sheet.obj", "-o", "closed/", *SMALL)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("error: closed")


@pytest.mark.parametrize("way", ["opened", "no viewer", "no desktop"])
def test_it_opens_what_it_made(folder, run, monkeypatch, way):
    """Where there is no viewer a note tells; the picture is there all the same."""
    opened = []
    monkeypatch.setattr(click, "launch", lambda path: opened.append(path) or int(way == "no viewer"))
    monkeypatch.setattr(system, "has_desktop", lambda: way != "no desktop")
    done = run(folder, "preview", "sheet.obj", "--open", *SMALL)
    assert done.returncode == 0
    assert opened == ([] if way == "no desktop" else ["sheet_preview.png"])
    assert ("sheet_preview.png: no viewer was found to open it" in done.stderr) == (way != "opened")
    assert (folder / "sheet_preview.png").is_file()


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_the_same_command_gives_the_same_bytes(folder, run, backend):
    made = []
    for name in ("a.png", "b.png"):
        words = ["--size", "48x36", "--backend", backend, "--spheres", "s.csv", "--ground", "-o", name]
        assert run(folder, "preview", "sheet.obj", *words).returncode == 0
        made.append((folder / name).read_bytes())
    assert made[0] == made[1]
