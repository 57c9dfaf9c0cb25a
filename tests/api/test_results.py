"""Results are saved as the command line writes them, and reports are its JSON documents, key by key."""

import json

import pytest
import trimesh

import aoprecalc as ao
from shapes import torus

SIZE = ["--size", "64", "-n", "64"]
OPTIONS = ao.BakeOptions(size=64, directions=64)


@pytest.fixture(params=["ring.obj", "ring.glb"])
def ring(request, tmp_path):
    """A ring, in a file."""
    trimesh.Trimesh(*torus(around=16, across=8), process=False).export(tmp_path / request.param)
    return tmp_path / request.param


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def document(text):
    """A JSON document without seconds and paths, in which the order of keys counts."""
    pairs = json.loads(text) if isinstance(text, str) else text
    return json.dumps(pairs | {"seconds": None, "outputs": list(pairs.get("outputs", []))})


def test_a_bake_is_saved_as_the_command_writes_it(ring, tmp_path, command):
    done = command("bake", ring, *SIZE, "-o", f"{tmp_path}/shell/", "--json")
    assert done.returncode == 0, done.stderr
    result = ao.bake(ring, OPTIONS)
    files = result.save(f"{tmp_path}/python/", report=tmp_path / "report.json")
    assert contents(tmp_path / "python") == contents(tmp_path / "shell")
    assert files.texture == tmp_path / "python" / "ring_ao.png"
    assert files.mesh == tmp_path / "python" / f"ring_ao{ring.suffix}"
    assert document(result.report.to_dict()) == document(done.stdout)
    assert document((tmp_path / "report.json").read_text()) == document(done.stdout)
    saved = json.loads((tmp_path / "report.json").read_text())["outputs"]
    assert (saved["texture"], saved["mesh"]) == (str(files.texture), str(files.mesh))


def test_a_bake_of_arrays_is_saved_as_a_glb_with_its_name(tmp_path):
    result = ao.bake(ao.Mesh(*torus(around=16, across=8), name="v1.2 ring"), OPTIONS)
    files = result.save(tmp_path, mesh_output=None)
    assert {path.name for path in tmp_path.iterdir()} == {"v1.2 ring_ao.png", "v1.2 ring_ao.glb"}
    back = ao.load(files.mesh)
    assert back.uvs == pytest.approx(result.mesh.uvs, abs=1e-6)
    assert result.save(tmp_path / "a.exr", mesh_output=tmp_path / "a.obj").mesh.name == "a.obj"


def test_nothing_is_written_where_a_name_is_wrong(tmp_path):
    result = ao.bake(ao.Mesh(*torus(around=16, across=8)), OPTIONS)
    with pytest.raises(ao.UsageError):
        result.save(tmp_path / "a.png", mesh_output=tmp_path / "a.stl")
    with pytest.raises(ao.OutputError):
        result.save(tmp_path / "missing" / "a.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_bake_may_be_measured():
    pytest.importorskip("embreex")
    result = ao.bake(ao.Mesh(*torus(around=16, across=8)), OPTIONS, verify=True)
    assert result.report.verify.levels[0].rmse < 0.05
    assert result.report.to_dict()["verify"]["levels"][0]["rmse"] == result.report.verify.levels[0].rmse


@pytest.mark.parametrize("options", [["-n", "6"], ["--levels", "2,6"]], ids=" ".join)
def test_spheres_are_saved_as_the_command_writes_them(tmp_path, command, options):
    trimesh.Trimesh(*torus(around=16, across=8), process=False).export(tmp_path / "ring.obj")
    done = command("spheres", tmp_path / "ring.obj", "-s", "300", *options, "-o", tmp_path / "shell.json", "--json")
    assert done.returncode == 0, done.stderr
    how = {"spheres": 6} if options[0] == "-n" else {"levels": (2, 6)}
    spheres = ao.fit_spheres(ao.load(tmp_path / "ring.obj"), ao.SphereOptions(samples=300, **how))
    assert spheres.save(tmp_path) == tmp_path / "ring_spheres.json"
    assert (tmp_path / "ring_spheres.json").read_bytes() == (tmp_path / "shell.json").read_bytes()
    assert spheres.to_json() == done.stdout
    assert (len(spheres), spheres.centers.shape, spheres.radii.shape) == (6, (6, 3), (6,))
    if options[0] == "--levels":
        with pytest.raises(ao.UsageError):
            spheres.save(tmp_path / "a.csv")


def test_spheres_are_measured_alike_from_arrays_and_files(tmp_path, command):
    mesh = ao.Mesh(*torus(around=16, across=8), name="ring")
    options = ao.SphereOptions(6, samples=300)
    spheres = ao.fit_spheres(mesh, options)
    quality = ao.measure_spheres(mesh, spheres.centers, spheres.radii, options)
    assert quality == ao.measure_spheres(mesh, *ao.load_spheres(spheres.save(tmp_path)), options)
    assert quality.silhouette_iou == spheres.quality.silhouette_iou
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "ring.obj")
    measured = ["--measure", tmp_path / "ring_spheres.json", "-s", "300", "--json"]
    done = command("spheres", tmp_path / "ring.obj", *measured)
    assert list(json.loads(done.stdout)["quality"]) == list(quality.to_dict())


def test_reports_are_the_documents_of_the_commands(tmp_path, command):
    pytest.importorskip("embreex")
    files = ao.bake(ao.Mesh(*torus(around=16, across=8)), OPTIONS).save(tmp_path)
    done = command("verify", files.mesh, "--points", "300", "--rays", "64", "--json")
    report = ao.verify(files.mesh, options=ao.VerifyOptions(points=300, rays=64))
    assert document(report.to_dict()) == document(done.stdout)
    assert report.error == report.levels[0].rmse
    done = command("compare", files.texture, files.texture, "--json")
    compared = ao.compare(files.texture, files.texture)
    assert json.dumps(compared.to_dict()) == json.dumps(json.loads(done.stdout))
    assert (compared.answer, compared.passed) == ("equal", True)
