"""`aoprecalc compare` on what `aoprecalc` wrote, against itself and against what others wrote or spoiled."""

import json
import shutil

import numpy as np
import pytest

import aoprecalc
from aoprecalc.io import read_image, write_image
from aoprecalc.io.images import read_pixels
from shapes import torus

TEXTURE, SIZE = "plain_ao.png", 64


def compared(a, b, **options):
    return aoprecalc.compare(a, b, aoprecalc.CompareOptions(**options)).to_dict()


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A folder with a ring, `plain.obj`, and in `a` and `b` the same bake and spheres of it, in `c` others."""
    folder = tmp_path_factory.mktemp("ring")
    positions, faces = torus(around=24, across=12)
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*row) for row in positions]
    lines += ["f {} {} {}".format(*row) for row in faces + 1]
    (folder / "plain.obj").write_text("\n".join(lines) + "\n")
    for name, directions, count in (("a", 64, 20), ("b", 64, 20), ("c", 8, 30)):
        options = aoprecalc.BakeOptions(width=SIZE, height=SIZE, directions=directions)
        report = folder / f"{name}_bake.json"
        result = aoprecalc.bake(folder / "plain.obj", options)
        result.save(f"{folder}/{name}/", report=report)
        result.save(folder / name / "g.png", mesh_output=folder / name / "g.glb")
        report.rename(folder / name / "bake.json")
        spheres = aoprecalc.fit_spheres(folder / "plain.obj", aoprecalc.SphereOptions(count, samples=2000))
        for kind in ("json", "csv", "npz"):
            spheres.save(folder / name / f"s.{kind}")
    return folder


KINDS = {TEXTURE: "texture", "plain_ao.obj": "mesh", "g.glb": "mesh", "bake.json": "report", "s.csv": "spheres"}


@pytest.mark.parametrize("name", [*KINDS, "s.json", "s.npz"])
def test_the_same_made_again_is_equal_and_another_is_different(ring, name):
    same, other = compared(ring / "a" / name, ring / "b" / name), compared(ring / "a" / name, ring / "c" / name)
    assert (same["answer"], same["difference"], same["reason"]) == ("equal", 0, "")
    assert same["kind"] == other["kind"] == KINDS.get(name, "spheres")
    assert other["answer"] == "different"
    assert (other["difference"] is None) == bool(other["reason"])


def test_a_texture_is_as_different_as_its_pixels(ring, tmp_path):
    for name in "ac":
        shutil.copy(ring / name / TEXTURE, tmp_path / f"{name}.png")  # without its mesh
    report = compared(tmp_path / "a.png", tmp_path / "c.png")
    apart = read_image(ring / "c" / TEXTURE).astype(float) - read_image(ring / "a" / TEXTURE)
    assert report["details"]["surface"] is None
    details = report["details"]["picture"]
    assert report["difference"] == pytest.approx(np.sqrt(np.mean(apart**2)))
    assert details["texels"] == apart.size
    assert details["rms"] == pytest.approx(report["difference"], rel=1e-5)
    assert details["bias"] == pytest.approx(apart.mean(), rel=1e-4)
    assert details["max"] == pytest.approx(np.abs(apart).max(), rel=1e-5)
    assert details["share"] == pytest.approx(np.mean(np.abs(apart) * 255 > 2.5), rel=1e-5)
    assert 0 < details["flip"] < 1


def test_the_surface_is_that_of_the_mesh_beside_or_of_the_option_or_in_the_mesh(ring, tmp_path):
    whole = compared(ring / "a" / TEXTURE, ring / "c" / TEXTURE)
    for name in "ac":
        shutil.copy(ring / name / TEXTURE, tmp_path / f"{name}.png")
    given = aoprecalc.compare(tmp_path / "a.png", tmp_path / "c.png", mesh=ring / "b" / "plain_ao.obj").to_dict()
    assert given["difference"] == whole["difference"]
    assert given["details"] == whole["details"]
    assert 0 < whole["details"]["surface"]["texels"] < SIZE * SIZE == whole["details"]["picture"]["texels"]
    for mesh in ("plain_ao.obj", "g.glb"):  # which lie on one another but for the texture
        found = compared(ring / "a" / mesh, ring / "c" / mesh)
        assert found["difference"] == whole["difference"]
        assert found["details"] == {"triangles": 576, "position": 0, "uv": 0, "normal": 0, "texture": whole["details"]}


def test_a_mesh_beside_that_cannot_be_used_is_said(ring, tmp_path):
    shutil.copy(ring / "a" / TEXTURE, tmp_path / "a.png")
    shutil.copy(ring / "plain.obj", tmp_path / "a.obj")
    report = compared(tmp_path / "a.png", tmp_path / "a.png")
    assert (report["answer"], report["details"]["surface"]) == ("equal", None)
    (line,) = report["warnings"]
    assert "the whole picture counts, as the mesh beside it cannot be used: " in line
    assert "has no UVs" in line


def test_other_options_of_the_bake_are_said_where_they_may_be_the_reason(ring, tmp_path, run):
    options = aoprecalc.BakeOptions(size=SIZE, directions=64, ground=True, two_sided=True)
    files = aoprecalc.bake(ring / "plain.obj", options).save(f"{tmp_path}/")
    expected = "B was baked with --two-sided --ground --up y, A without; bake both with the same options"
    for a, b in ((ring / "a" / TEXTURE, files.texture), (ring / "a" / "plain_ao.obj", files.mesh)):
        report = compared(a, b)
        assert report["answer"] == "different"
        assert report["warnings"] == [expected]
        near = compared(a, b, tolerance=1)
        assert (near["warnings"], near["notes"]) == ([], [expected])
    done = run(tmp_path, "compare", ring / "a" / TEXTURE, files.texture)
    assert done.stderr.splitlines()[0] == f"warning: {expected}"
    surface, picture = done.stdout.splitlines()[2:]
    details = compared(ring / "a" / TEXTURE, files.texture)["details"]
    assert surface.startswith(f"surface, {details['surface']['texels']} texels: root mean square ")
    assert picture.startswith(f"whole picture, {SIZE} x {SIZE}: root mean square {details['picture']['rms']:.6f}, ")


def test_formats_of_one_thing_are_near_or_equal(ring):
    for kind in ("csv", "npz"):
        assert compared(ring / "a" / "s.json", ring / "a" / f"s.{kind}")["answer"] == "equal"
    report = compared(ring / "a" / "plain_ao.obj", ring / "a" / "g.glb")
    assert report["details"]["texture"]["picture"]["max"] == 0
    assert 0 < report["difference"] < 1e-5  # a GLB has 32-bit numbers


def test_spheres_in_another_order_are_equal(ring, tmp_path):
    header, *rows = (ring / "a" / "s.csv").read_text().splitlines()
    (tmp_path / "s.csv").write_text("\n".join([header, *rows[7:], *rows[:7][::-1]]) + "\n")
    assert compared(ring / "a" / "s.csv", tmp_path / "s.csv")["answer"] == "equal"


def test_coarser_levels_count(ring, tmp_path):
    options = aoprecalc.SphereOptions(samples=2000, levels=(4, 12))
    aoprecalc.fit_spheres(ring / "plain.obj", options).save(tmp_path / "a.json")
    document = json.loads((tmp_path / "a.json").read_text())
    document["levels"][0]["spheres"][2]["center"][0] += 0.5
    (tmp_path / "b.json").write_text(json.dumps(document))
    assert compared(tmp_path / "a.json", tmp_path / "a.json")["details"]["spheres"] == [4, 12]
    assert compared(tmp_path / "a.json", tmp_path / "b.json")["difference"] > 0.05


def test_what_a_mesh_lost_is_said(ring, tmp_path):
    shutil.copy(ring / "a" / "plain_ao.obj", tmp_path / "bare.obj")
    report = compared(ring / "a" / "plain_ao.obj", tmp_path / "bare.obj")
    assert report["answer"] == "different"
    assert report["reason"] == "only A has a picture of ambient occlusion"
    assert compared(tmp_path / "bare.obj", tmp_path / "bare.obj")["answer"] == "equal"


def brightened(ring, folder, by):
    """Write the texture with every pixel brighter by as many levels, and return its path."""
    values = read_image(ring / "a" / TEXTURE) * np.float32(0.5)
    write_image(folder / "dark.png", values)
    write_image(folder / "bright.png", read_image(folder / "dark.png") + np.float32(by / 255))
    return folder / "dark.png", folder / "bright.png"


@pytest.mark.parametrize(
    ("levels", "words", "answer"),
    [
        (0, [], "equal"),
        (1, [], "near"),  # 0.0039
        (2, [], "different"),
        (2, ["--tolerance", "0.01"], "near"),
        (1, ["--tolerance", "0"], "different"),
        (0, ["--tolerance", "0"], "equal"),
    ],
)
def test_the_tolerance_decides_the_answer_and_the_exit_code(ring, tmp_path, levels, words, answer, run):
    dark, bright = brightened(ring, tmp_path, levels)
    done = run(tmp_path, "compare", dark, bright, *words)
    assert done.returncode == (answer == "different")
    assert done.stdout.startswith(f"{answer}: {dark} and {bright}\n")
    assert f"difference {levels / 255:.6f}" in done.stdout
    if answer == "different":
        note, line = done.stderr.splitlines()
        assert line == f"error: {bright}: differs from {dark}; if the change is meant, replace {dark} by {bright}"
    else:
        (note,) = done.stderr.splitlines()
    assert note.startswith("no mesh was found beside the textures: the whole picture counts")


def test_a_difference_leaves_its_report_and_picture(ring, tmp_path, run):
    words = [ring / "a" / "g.glb", ring / "c" / "g.glb"]
    done = run(tmp_path, "compare", *words, "--json", "--report", "r.json", "--picture", "p.png")
    assert done.returncode == 1
    report = json.loads(done.stdout)
    assert report == json.loads((tmp_path / "r.json").read_text())
    assert list(report) == [
        *("schema", "version", "kind", "a", "b", "answer", "difference", "tolerance", "reason", "details", "warnings"),
        "notes",
    ]
    assert (report["schema"], report["tolerance"], report["kind"]) == (1, 0.005, "mesh")
    assert (report["a"], report["b"]) == tuple(map(str, words))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.png", "r.json"]
    pixels = np.round(read_pixels(tmp_path / "p.png") * 255)
    gap = (pixels.shape[1] - 4 * 256) // 5
    assert pixels.shape[1] == 4 * 256 + 5 * gap
    first = np.round(read_image(ring / "a" / TEXTURE) * 255).repeat(4, axis=0).repeat(4, axis=1)
    np.testing.assert_array_equal(pixels[gap : gap + 256, gap : gap + 256, 0], first)
    again = run(tmp_path, "compare", *words, "--json", "--report", "r.json", "--picture", "q.png")
    assert again.stdout == done.stdout
    assert (tmp_path / "q.png").read_bytes() == (tmp_path / "p.png").read_bytes()


def test_other_sizes_are_different_and_shown(ring, tmp_path, run):
    write_image(tmp_path / "small.png", np.ones((16, 32), np.float32))
    done = run(tmp_path, "compare", ring / "a" / TEXTURE, "small.png", "--picture", "p.png")
    assert done.returncode == 1
    assert "64 x 64 and 32 x 16 pixels" in done.stdout
    assert len(done.stderr.splitlines()) == 1
    assert "64 x 64 and 32 x 16 pixels" not in done.stderr
    assert (tmp_path / "p.png").is_file()


def test_reports_say_where_they_differ(ring, tmp_path, run):
    document = json.loads((ring / "a" / "bake.json").read_text())
    document["ao"]["mean"] += 0.002
    document["version"], document["renderer"], document["input"]["path"] = "9", "another", "elsewhere.obj"
    (tmp_path / "near.json").write_text(json.dumps(document))
    report = compared(ring / "a" / "bake.json", tmp_path / "near.json")
    assert (report["answer"], report["difference"]) == ("near", pytest.approx(0.002))
    assert [place["at"] for place in report["details"]["places"]] == ["ao.mean"]
    document["backend"] = "ray"
    (tmp_path / "other.json").write_text(json.dumps(document))
    done = run(tmp_path, "compare", ring / "a" / "bake.json", "other.json")
    assert done.returncode == 1
    assert "  backend: 'gl' became 'ray'" in done.stdout.splitlines()


def test_warnings_name_the_file(ring, tmp_path, run):
    (tmp_path / "ring.obj").write_text((ring / "plain.obj").read_text() + "f 1 2\n")
    done = run(tmp_path, "compare", ring / "plain.obj", "ring.obj")
    assert done.returncode == 0
    assert done.stderr == "warning: ring.obj: 1 face of fewer than 3 corners is skipped\n"
    assert run(tmp_path, "compare", ring / "plain.obj", "ring.obj", "-q").stderr == done.stderr


@pytest.fixture(scope="module")
def damaged(ring):
    """The same folder with files that nobody can use."""
    (ring / "bad.png").write_bytes(b"no picture")
    write_image(ring / "nan.exr", np.full((8, 8), np.nan, np.float32))
    (ring / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 2 9\n")
    (ring / "bad.glb").write_bytes((ring / "a" / "g.glb").read_bytes()[:200])
    (ring / "bad.json").write_text('{"schema": 1,')
    (ring / "inf.json").write_text('{"schema": 1, "x": 1e999}')
    (ring / "deep.json").write_text("[" * 100_000)
    (ring / "list.json").write_text("[1, 2]")
    (ring / "else.json").write_text('{"name": "package"}')
    (ring / "levels.json").write_text('{"spheres": [{"center": [0, 0, 0], "radius": 1}], "levels": [3]}')
    (ring / "none.json").write_text('{"spheres": []}')
    (ring / "bad.csv").write_text("x,y,z\n1,2,3\n")
    (ring / "bad.npz").write_bytes(b"PK\x03\x04 no more")
    return ring


BAD = {
    "a missing picture": ([f"a/{TEXTURE}", "none.png"], 4, "none.png: there is no such file"),
    "a damaged picture": (["bad.png", f"a/{TEXTURE}"], 4, "bad.png: cannot be read as an image"),
    "a picture of no numbers": (["nan.exr", "nan.exr"], 4, "not finite"),
    "a missing mesh": (["a/g.glb", "none.glb"], 4, "none.glb: there is no such file"),
    "a damaged mesh": (["a/plain_ao.obj", "bad.obj"], 4, "bad.obj"),
    "a cut GLB": (["bad.glb", "a/g.glb"], 4, "bad.glb"),
    "a missing document": (["missing.json", "a/bake.json"], 4, "missing.json: cannot be read"),
    "a damaged document": (["a/bake.json", "bad.json"], 4, "bad.json: is not JSON"),
    "a number beyond all": (["a/bake.json", "inf.json"], 4, "1e999 is not a finite number"),
    "a bottomless document": (["a/bake.json", "deep.json"], 4, "deep.json: is not JSON"),
    "a list": (["list.json", "list.json"], 4, "list.json: holds no JSON object"),
    "a document of others": (["else.json", "else.json"], 4, "a sphere set or a report was expected"),
    "levels that are none": (["levels.json", "levels.json"], 4, "levels"),
    "no spheres": (["none.json", "none.json"], 4, "none.json"),
    "a table of others": (["a/s.csv", "bad.csv"], 4, "bad.csv"),
    "a damaged archive": (["bad.npz", "a/s.npz"], 4, "bad.npz"),
    "a texture and a mesh": ([f"a/{TEXTURE}", "a/g.glb"], 2, "is a texture and a/g.glb a mesh"),
    "spheres and a report": (["a/s.json", "a/bake.json"], 2, "is a sphere set and a/bake.json a report"),
    "one file": (["a/g.glb"], 2, "Missing argument"),
    "a tolerance out of range": (["a/g.glb", "b/g.glb", "--tolerance", "1.5"], 2, "--tolerance"),
    "a mesh of meshes": (["a/g.glb", "b/g.glb", "--mesh", "a/g.glb"], 2, "--mesh is for textures"),
    "a mesh without UVs": ([f"a/{TEXTURE}", f"b/{TEXTURE}", "--mesh", "plain.obj"], 4, "has no UVs"),
    "no such mesh": ([f"a/{TEXTURE}", f"b/{TEXTURE}", "--mesh", "none.obj"], 4, "none.obj: there is no such file"),
    "a picture of spheres": (["a/s.csv", "b/s.csv", "--picture", "p.png"], 2, "which --picture cannot show"),
    "a picture of reports": (["a/bake.json", "b/bake.json", "--picture", "p.png"], 2, "which --picture cannot show"),
    "a picture of bare meshes": (["plain.obj", "plain.obj", "--picture", "p.png"], 2, "for --picture to show"),
    "a picture of no kind": (["a/g.glb", "b/g.glb", "--picture", "p.txt"], 2, ".txt"),
    "a picture that cannot hold colours": (["a/g.glb", "b/g.glb", "--picture", "p.exr"], 2, "half, float"),
    "the picture on the texture": (["a/plain_ao.obj", "b/plain_ao.obj", "--picture", f"b/{TEXTURE}"], 2, "belongs to"),
    "the report on the input": (["a/bake.json", "b/bake.json", "--report", "b/bake.json"], 2, "belongs to the input"),
    "two outputs of one name": ([f"a/{TEXTURE}", f"b/{TEXTURE}", "--picture", "x.png", "--report", "x.png"], 2, "two"),
    "a report nowhere": (["a/g.glb", "b/g.glb", "--report", "nowhere/r.json"], 1, "nowhere"),
}


@pytest.mark.parametrize("case", BAD)
def test_failures_are_one_line_and_leave_nothing(case, damaged, run):
    words, code, expected = BAD[case]
    before = sorted(damaged.rglob("*"))
    done = run(damaged, "compare", *words)
    assert done.returncode == code, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert done.stdout == ""
    assert sorted(damaged.rglob("*")) == before


def test_a_cut_picture_is_no_fault_of_the_program(ring, tmp_path, run):
    (tmp_path / "cut.png").write_bytes((ring / "a" / TEXTURE).read_bytes()[:100])
    done = run(tmp_path, "compare", ring / "a" / TEXTURE, "cut.png")
    assert done.returncode == 4
    assert done.stderr.splitlines()[-1].startswith("error: cut.png: cannot be read as an image")  # after libpng's own
    assert "Traceback" not in done.stderr
