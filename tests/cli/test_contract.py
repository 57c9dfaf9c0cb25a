"""The command line as scripts use it: outputs, exit codes, one line of error, nothing left behind."""

import json
import os
import subprocess
import sys

import pytest

from aoprecalc.io import load_scene, read_image
from shapes import box, join, torus

QUICK = ["--size", "64", "-n", "64"]


def start(folder, *words, **given):
    """Run `aoprecalc` in a folder as a shell would."""
    command = [sys.executable, "-m", "aoprecalc", *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **given)


def write_obj(path, positions, faces):
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def ring(tmp_path):
    return write_obj(tmp_path / "ring.obj", *torus(around=16, across=8))


def listing(folder):
    return sorted(path.name for path in folder.rglob("*"))


def test_bake_writes_texture_and_mesh(ring, tmp_path):
    done = start(tmp_path, "bake", "ring.obj", *QUICK)
    assert done.returncode == 0, done.stderr
    assert listing(tmp_path) == ["ring.obj", "ring_ao.mtl", "ring_ao.obj", "ring_ao.png"]
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["ring_ao.png", "ring_ao.obj", "map_Kd"]
    assert "unwrap:" in done.stderr
    baked = load_scene(tmp_path / "ring_ao.obj")
    assert baked.uvs is not None
    assert baked.normals is not None
    picture = read_image(tmp_path / "ring_ao.png")
    assert picture.shape == (64, 64)
    assert 0.2 < picture.mean() < 0.95


def test_the_same_command_gives_the_same_bytes_in_another_process(ring, tmp_path, run):
    def bytes_of(folder, launch):
        assert launch(tmp_path, "bake", "ring.obj", *QUICK, "-o", f"{folder}/").returncode == 0
        assert launch(tmp_path, "spheres", "ring.obj", "-n", "5", "-s", "500", "-o", f"{folder}/").returncode == 0
        return {path.name: path.read_bytes() for path in sorted((tmp_path / folder).iterdir())}

    first, second = bytes_of("a", run), bytes_of("b", start)
    assert len(first) == 4
    assert first == second


def test_the_report_has_what_scripts_read(ring, tmp_path, run):
    done = run(tmp_path, "bake", "ring.obj", *QUICK, "--padding", "2", "--json", "--report", "report.json", "-q")
    assert done.returncode == 0
    assert done.stderr == ""
    report = json.loads(done.stdout)
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["schema"] == 1
    expected = {"path": "ring.obj", "triangles": 256, "vertices": 128, "components": 1, "watertight": True}
    assert report["input"] == expected
    assert report["outputs"] == {
        "texture": "ring_ao.png",
        "mesh": "ring_ao.obj",
        "others": ["ring_ao.mtl"],
        "figures": [],
        "references": [{"slot": "map_Kd", "materials": 1, "uvs": "vt", "packed": False, "strength": None}],
        "inverted": False,
        "textures": ["ring_ao.png"],
        "bent_normals": [],
        "sh": [],
    }
    assert report["directions"] == 64
    assert report["backend"] == "gl"
    assert set(report["unwrap"]) >= {"method", "charts", "used_share", "gutter", "first_unsafe_mip"}
    assert report["texels"]["width"] == report["texels"]["height"] == 64
    assert set(report["seconds"]) >= {"load", "unwrap", "visibility", "total"}
    picture = read_image(tmp_path / "ring_ao.png")
    assert report["ao"]["min"] >= picture.min() - 1 / 255
    assert report["ao"]["max"] == pytest.approx(picture.max(), abs=1 / 255)


@pytest.mark.parametrize("output", ["made/", "there", "picture.exr", "there/picture.tif"])
def test_output_is_a_file_or_a_folder(ring, tmp_path, output, run):
    (tmp_path / "there").mkdir()
    assert run(tmp_path, "bake", "ring.obj", *QUICK, "-o", output).returncode == 0
    texture = tmp_path / output if "." in output else tmp_path / output / "ring_ao.png"
    assert texture.is_file()
    assert texture.with_suffix(".obj").is_file()


def test_sizes_need_not_be_square(ring, tmp_path, run):
    assert run(tmp_path, "bake", "ring.obj", "--size", "96x48", "-n", "64").returncode == 0
    assert read_image(tmp_path / "ring_ao.png").shape == (48, 96)


def test_spheres_writes_the_contracts_json(ring, tmp_path):
    done = start(tmp_path, "spheres", "ring.obj", "-n", "8", "-s", "2000")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "ring_spheres.json").read_text())
    assert document["schema"] == 1
    assert len(document["spheres"]) == 8
    assert set(document) == {
        "schema", "spheres", "method", "radius_rule", "samples", "seed", "iterations", "converged", "quality",
    }  # fmt: skip
    assert document["converged"] is True
    assert "8 spheres, converged" in done.stdout


def test_too_few_iterations_are_said(ring, tmp_path, run):
    done = run(tmp_path, "spheres", "ring.obj", "-n", "20", "-s", "5000", "--max-iterations", "2")
    assert done.returncode == 0
    assert "warning:" in done.stderr
    assert json.loads((tmp_path / "ring_spheres.json").read_text())["converged"] is False


BAD = {
    "unknown command": (["bakes"], 2, "No such command"),
    "unknown option": (["bake", "ring.obj", "--sise", "9"], 2, "--sise"),
    "no mesh": (["bake"], 2, "MESH"),
    "no directions": (["bake", "ring.obj", "-n", "0"], 2, "-n"),
    "no texels": (["bake", "ring.obj", "--size", "0"], 2, "--size is 0"),
    "a size of letters": (["bake", "ring.obj", "--size", "big"], 2, "expected a number of texels"),
    "a size beyond the renderer": (["bake", "ring.obj", "--size", "30000"], 2, "was expected"),
    "a picture of no kind": (["bake", "ring.obj", "-o", "ring.xyz"], 2, ".xyz"),
    "a depth that PNG lacks": (["bake", "ring.obj", "--bit-depth", "half"], 2, "half"),
    "a mesh output of no kind": (["bake", "ring.obj", "--mesh-output", "ring.stl"], 2, ".stl"),
    "a mesh of no kind": (["bake", "ring.doc"], 2, ".doc"),
    "the input as output": (["bake", "ring.obj", "--mesh-output", "ring.obj"], 2, "belongs to the input itself"),
    "a missing mesh": (["bake", "missing.obj"], 4, "no such file"),
    "an empty mesh": (["bake", "empty.obj"], 4, "is empty"),
    "garbage": (["bake", "garbage.ply"], 4, "garbage.ply"),
    "a mesh that is not finite": (["bake", "nan.obj"], 4, "not finite"),
    "points without faces": (["bake", "points.obj"], 4, "no faces"),
    "a mesh without area": (["bake", "flat.obj"], 4, "area"),
    "UVs to keep where there are none": (["bake", "ring.obj", "--unwrap", "keep"], 4, "cannot hold a bake"),
    "normals that the file lacks": (["bake", "ring.obj", "--normals", "file"], 4, "has no normals"),
    "the report on the texture": (["bake", "ring.obj", "--report", "./ring_ao.png"], 2, "two outputs"),
    "the report on a file beside the mesh": (["bake", "ring.obj", *QUICK, "--report", "ring_ao.mtl"], 2, "two outputs"),
    "a size without room for charts": (["bake", "ring.obj", "--size", "8"], 2, "use at least 16"),
    "a time-out of nothing": (["bake", "ring.obj", "--unwrap-timeout", "0"], 2, "--unwrap-timeout"),
    "an unwrap that takes too long": (["bake", "ring.obj", "--unwrap-timeout", "0.01"], 1, "within 0.01 s"),
    "a device as output": (["bake", "ring.obj", "--report", "/dev/null"], 1, "no regular file"),
    "a folder that is missing": (["bake", "ring.obj", "-o", "missing/ring.png"], 1, "missing"),
    "a report nowhere": (["bake", "ring.obj", "--report", "missing/r.json"], 1, "missing"),
    "a file for a folder": (["bake", "ring.obj", "-o", "ring.obj/"], 1, "ring.obj"),
    "no spheres": (["spheres", "ring.obj", "-n", "0"], 2, "-n"),
    "more spheres than samples": (["spheres", "ring.obj", "-n", "50", "-s", "20"], 2, "20 samples"),
    "a sphere set of no kind": (["spheres", "ring.obj", "-o", "s.txt"], 2, ".txt"),
    "spheres of a missing mesh": (["spheres", "missing.obj"], 4, "no such file"),
    "spheres without area": (["spheres", "flat.obj"], 4, "area"),
}


@pytest.mark.parametrize("case", BAD)
def test_failures_are_one_line_and_leave_nothing(case, ring, tmp_path, run):
    words, code, expected = BAD[case]
    (tmp_path / "empty.obj").write_text("")
    (tmp_path / "garbage.ply").write_bytes(bytes(range(256)))
    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    (tmp_path / "ring_ao.png").write_bytes(b"an earlier output")
    before = listing(tmp_path)
    done = run(tmp_path, *words)
    assert done.returncode == code, done.stderr
    lines = done.stderr.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1
    assert lines[-1] == errors[0]
    assert expected in errors[0]
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert listing(tmp_path) == before
    assert (tmp_path / "ring_ao.png").read_bytes() == b"an earlier output"


@pytest.mark.skipif(os.name == "posix" and os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(ring, tmp_path, run):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    done = run(tmp_path, "bake", "ring.obj", *QUICK, "-o", "closed/")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("error: closed")


@pytest.mark.parametrize("words", [[], ["cache"]], ids=str)
def test_without_a_command_there_is_the_help(words, tmp_path, run):
    done, asked = run(tmp_path, *words), run(tmp_path, *words, "--help")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == asked.stdout
    assert done.stderr.startswith("Usage: ")


def test_verbose_adds_no_traceback_to_wrong_usage(ring, tmp_path, run):
    for words in (["--sise", "9"], ["--size", "0"], ["-o", "ring.xyz"]):
        done = run(tmp_path, "bake", "ring.obj", *words, "-v")
        assert done.returncode == 2
        assert done.stderr.splitlines()[-1].startswith("error: ")
        assert "Traceback" not in done.stderr


def test_verbose_adds_the_traceback(tmp_path):
    done = start(tmp_path, "bake", "missing.obj", "-v")
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("error: ")


@pytest.mark.gl
@pytest.mark.parametrize("backend", ["gl", "auto", "ray"])
def test_without_opengl_rays_are_traced_or_the_code_is_three(backend, ring, tmp_path, run):
    """No EGL device and no OSMesa: libraries are looked for where there are none."""
    program = (
        "import sys, moderngl\n"
        "from aoprecalc.gl import context as osmesa\n"
        "def none(**given): raise Exception('eglInitialize failed (0x3001)')\n"
        "moderngl.create_context = none\n"
        "osmesa.LIBRARIES = ()\n"
        "small = ['--size', '64', '-n', '64', '--json']\n"
        f"sys.argv = ['aoprecalc', 'bake', 'ring.obj', '--backend', '{backend}', *small]\n"
        "from aoprecalc.cli import main; main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    if backend == "gl":
        assert done.returncode == 3
        assert done.stderr.startswith("error: no OpenGL")
        assert listing(tmp_path) == ["ring.obj"]
        return
    assert done.returncode == 0, done.stderr
    assert ("rays are traced" in done.stderr) == (backend == "auto")
    report = json.loads(done.stdout)
    assert (report["backend"], report["renderer"], report["shadow_size"]) == ("ray", "Embree", None)
    assert "ring_ao.png" in listing(tmp_path)


def test_parts_inside_others_are_dark_and_not_a_failure(tmp_path, run):
    write_obj(tmp_path / "nested.obj", *join(box(), (box()[0] * 0.5, box()[1])))
    assert run(tmp_path, "bake", "nested.obj", *QUICK, "--normals", "flat").returncode == 0
    picture = read_image(tmp_path / "nested_ao.png")
    assert picture.min() == 0
    assert picture.max() == 1


def test_help_is_instant_because_nothing_heavy_is_loaded(run):
    program = (
        "import sys; sys.argv = ['aoprecalc', 'bake', '--help']\n"
        "from aoprecalc.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'moderngl', 'trimesh', 'rich', 'OpenImageIO'} & set(sys.modules)\n"
        "sys.exit(f'loaded: {heavy}' if heavy else 0)"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, check=False).returncode == 0
