"""`aoprecalc verify` on what `aoprecalc bake` wrote, and on what others might have."""

import json
import subprocess
import sys

import numpy as np
import pytest

import aoprecalc
from aoprecalc.io import read_image, write_image
from shapes import torus

QUICK = ["--points", "2000", "--rays", "256"]
FORMATS = ("obj", "ply", "glb", "gltf")


def verify(path, texture=None, **given):
    options = aoprecalc.VerifyOptions(**{"points": 2000, "rays": 256, **given})
    return aoprecalc.verify(path, texture, options).to_dict()


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A folder with a ring, `plain.obj`, and its bake in every format, each in a folder of its own."""
    folder = tmp_path_factory.mktemp("ring")
    positions, faces = torus(around=24, across=12)
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*row) for row in positions]
    lines += ["f {} {} {}".format(*row) for row in faces + 1]
    (folder / "plain.obj").write_text("\n".join(lines) + "\n")
    options = aoprecalc.BakeOptions(width=128, height=128, directions=64)
    for kind in FORMATS:
        (folder / kind).mkdir()
        aoprecalc.bake(folder / "plain.obj", options).save(
            f"{folder}/{kind}/", mesh_output=folder / kind / f"ring.{kind}"
        )
    return folder


def test_every_format_gives_back_what_was_baked(ring):
    reports = {kind: verify(ring / kind / f"ring.{kind}") for kind in FORMATS}
    errors = {kind: report["levels"][0]["rmse"] for kind, report in reports.items()}
    assert max(errors.values()) < 0.03
    assert max(errors.values()) - min(errors.values()) < 1e-3
    for report in reports.values():
        assert [level["level"] for level in report["levels"]] == [0, 1, 2, 3, 4]
        assert report["texture"]["triangles"] == report["input"]["triangles"]
        assert report["warnings"] == []
    assert reports["glb"]["texture"]["path"].startswith("image 0 of ")


def test_a_table_for_people(ring, tmp_path, run):
    done = run(tmp_path, "verify", ring / "glb" / "ring.glb", *QUICK)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"{ring / 'glb' / 'ring.glb'}, its own texture (image 0): texture minus reference ")
    assert lines[0].endswith(" at 2000 points of 256 rays")
    assert lines[1].split() == ["level", "rmse", "bias", "p50", "p95", "p99", "max"]
    assert [line.split()[0] for line in lines[2:7]] == list("01234")
    assert lines[7].startswith("worst at")
    assert [len(line.split()) for line in lines[8:]] == [7] * 10
    assert list(tmp_path.iterdir()) == []


def test_the_same_command_gives_the_same_report(ring, tmp_path, run):
    mesh = ring / "ply" / "ring.ply"
    first, second = (
        run(tmp_path, "verify", mesh, *QUICK, "--json", "--report", "r.json", "--heat-map", f"{name}.png")
        for name in "ab"
    )
    reports = [json.loads(done.stdout) for done in (first, second)]
    assert reports[1] == json.loads((tmp_path / "r.json").read_text())
    assert reports[0]["schema"] == 1
    assert reports[0]["outputs"] == {"heat_map": "a.png", "report": "r.json"}
    for report in reports:
        del report["seconds"], report["outputs"]
    assert reports[0] == reports[1]
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_corrupted_patch_is_found(ring, tmp_path):
    picture = read_image(ring / "obj" / "plain_ao.png")
    mesh = ring / "obj" / "ring.obj"
    u, v = verify(mesh)["worst"][0]["uv"]  # some place on the surface
    row, column = int((1 - v) * 128), int(u * 128)
    patch = np.s_[max(0, row - 3) : row + 4, max(0, column - 3) : column + 4]
    picture[patch] = 0
    write_image(tmp_path / "bad.png", picture)
    report = aoprecalc.verify(mesh, tmp_path / "bad.png", heat_map=tmp_path / "heat.png").to_dict()
    worst = report["worst"][0]
    assert np.abs(np.subtract(worst["uv"], (u, v))).max() < 6 / 128
    assert worst["error"] < -0.3
    assert worst["value"] < 0.3
    from PIL import Image

    colors = np.asarray(Image.open(tmp_path / "heat.png"))
    assert colors.shape == (512, 512, 3)
    at = int((1 - worst["uv"][1]) * 512), int(worst["uv"][0] * 512)
    assert colors[at].tolist() == [0, 0, 255]
    assert [48, 48, 48] in colors.reshape(-1, 3).tolist()


def test_a_foreign_texture_is_measured_as_it_is(ring, tmp_path):
    reports = []
    for value in (1.0, 0.5):
        write_image(tmp_path / f"{value}.exr", np.full((32, 48), value, np.float32))
        reports.append(verify(ring / "obj" / "ring.obj", tmp_path / f"{value}.exr"))
    white, grey = (report["levels"][0] for report in reports)
    assert [level["bias"] for level in reports[0]["levels"]] == [white["bias"]] * 5
    assert 0 < white["bias"] < white["rmse"] < white["max"] < 1
    assert grey["bias"] == pytest.approx(white["bias"] - 0.5, abs=2e-6)
    assert (reports[0]["texture"]["width"], reports[0]["texture"]["height"]) == (48, 32)


def test_a_tolerance_decides_the_exit_code_and_the_outputs_stay(ring, tmp_path, run):
    mesh = ring / "obj" / "ring.obj"
    good = run(tmp_path, "verify", mesh, *QUICK, "--tolerance", "0.1")
    assert (good.returncode, good.stderr) == (0, "")
    bad = run(tmp_path, "verify", mesh, *QUICK, "--tolerance", "0.0001", "--report", "r.json", "--heat-map", "h.jpg")
    assert bad.returncode == 1
    assert bad.stdout == good.stdout
    (line,) = bad.stderr.splitlines()
    report = json.loads((tmp_path / "r.json").read_text())
    assert line.startswith("error: ")
    assert f"{report['levels'][0]['rmse']:.5f}"[:6] in line
    assert line.endswith("at most 0.0001 was allowed; bake it with a larger --size or more --directions")
    assert report["passed"] is False
    assert sorted(path.name for path in tmp_path.iterdir()) == ["h.jpg", "r.json"]


def test_the_maximum_distance_of_a_bake_is_taken_away(ring, tmp_path, run):
    limited = ["bake", ring / "plain.obj", "--size", "64", "-n", "64", "--max-distance", "2%", "-o", "a.glb"]
    assert run(tmp_path, *limited).returncode == 0
    for words, distance in ([], "2%"), (["--max-distance", "none"], None):
        report = json.loads(run(tmp_path, "verify", "a.glb", *QUICK, *words, "--json").stdout)
        assert report["options"]["max_distance"] == distance
        assert (report["levels"][0]["bias"] > 0.05) == (distance is None)


def test_rays_are_rounded_up_and_it_is_said(ring):
    report = verify(ring / "obj" / "ring.obj", rays=250)
    assert report["rays"] == 256
    assert report["notes"] == ["250 rays per point are rounded up to 256, the next square"]


def test_faces_without_a_place_are_left_out_and_said(ring, tmp_path):
    text = (ring / "obj" / "ring.obj").read_text()
    (tmp_path / "ring.obj").write_text(text + "v 9 0 0\nv 9 1 0\nv 9 0 1\nf -3/1/1 -2/1/1 -1/1/1\n")
    report = verify(tmp_path / "ring.obj", ring / "obj" / "plain_ao.png")
    assert report["texture"]["triangles"] == report["input"]["triangles"] - 1
    assert "1 of 577 faces has no UVs in the texture and is left out" in report["warnings"][0]


def test_repeating_uvs_read_a_repeating_picture(ring, tmp_path):
    lines = (ring / "obj" / "ring.obj").read_text().splitlines()
    moved = [
        f"vt {float(line.split()[1]) - 3!r} {float(line.split()[2]) + 2!r}" if line.startswith("vt ") else line
        for line in lines
    ]
    (tmp_path / "ring.obj").write_text("\n".join(moved) + "\n")
    there, here = verify(tmp_path / "ring.obj", ring / "obj" / "plain_ao.png"), verify(ring / "obj" / "ring.obj")
    assert there["texture"]["repeats"]
    assert not here["texture"]["repeats"]
    assert there["levels"][0]["rmse"] == pytest.approx(here["levels"][0]["rmse"], abs=1e-4)


BAD = {
    "no texture": (["plain.obj", "--texture", "none.png"], 4, "has no UVs"),
    "a missing texture": (["obj/ring.obj", "--texture", "none.png"], 4, "none.png: there is no such file"),
    "a texture that is no picture": (["obj/ring.obj", "--texture", "plain.obj"], 4, "cannot be read as an image"),
    "a missing mesh": (["none.obj"], 4, "no such file"),
    "a tolerance out of range": (["obj/ring.obj", "--tolerance", "2"], 2, "--tolerance"),
    "few rays": (["obj/ring.obj", "--rays", "9"], 2, "--rays"),
    "a heat map of no kind": (["obj/ring.obj", "--heat-map", "h.txt"], 2, ".txt"),
    "a heat map that cannot hold colours": (["obj/ring.obj", "--heat-map", "h.exr"], 2, "half, float"),
    "the heat map on the texture": (["obj/ring.obj", "--heat-map", "obj/plain_ao.png"], 2, "belongs to the input"),
    "two outputs of one name": (["obj/ring.obj", "--heat-map", "a.png", "--report", "a.png"], 2, "two outputs"),
    "a report nowhere": (["obj/ring.obj", "--report", "none/r.json"], 1, "none"),
}


@pytest.mark.parametrize("case", BAD)
def test_failures_are_one_line_and_leave_nothing(case, ring, run):
    words, code, expected = BAD[case]
    before = sorted(ring.rglob("*"))
    done = run(ring, "verify", *words)
    assert done.returncode == code, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert done.stdout == ""
    assert sorted(ring.rglob("*")) == before


def test_without_embree_the_code_is_three(ring, tmp_path, run):
    program = (
        "import sys\n"
        "sys.modules['embreex'] = None\n"
        f"sys.argv = ['aoprecalc', 'verify', {str(ring / 'obj' / 'ring.obj')!r}, '--report', 'r.json']\n"
        "from aoprecalc.cli import main; main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert "embreex" in done.stderr
    assert list(tmp_path.iterdir()) == []
