"""The JSON Schemas in the package: current, valid, and true of what the commands write."""

import copy
import json
import re
import tomllib
from functools import partial
from importlib import resources

import pytest
import trimesh
from jsonschema import Draft202012Validator
from scripts.schemas import DOCUMENTS, schemas

from aoprecalc.errors import AoprecalcError
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import VerifyOptions
from aoprecalc.pipeline.manifest import read_manifest
from shapes import torus

BAKE = ("--size", "64", "-n", "64", "--backend", "ray")
SPHERES = ("-n", "4", "-s", "300")
SHIPPED = {file.name: file.read_text("utf-8") for file in resources.files("aoprecalc.schemas").iterdir()}


def validator(name):
    """The validator of a kind of document, from the schema as it is installed."""
    return Draft202012Validator(json.loads(SHIPPED[f"{name}.schema.json"]))


def faults(name, document):
    """What is wrong with a document, as JSON pointers with the keyword that says so."""
    return sorted(
        f"/{'/'.join(map(str, it.absolute_path))} {it.validator}" for it in validator(name).iter_errors(document)
    )


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with the mesh ring.obj."""
    monkeypatch.chdir(tmp_path)
    trimesh.Trimesh(*torus(around=12, across=6), process=False).export("ring.obj")
    return tmp_path


@pytest.fixture
def printed(folder, command):
    """printed(*words): the JSON that a command prints."""
    return lambda *words: json.loads(command(*words).stdout)


def test_they_are_current():
    assert schemas() == SHIPPED, "run python scripts/schemas.py"


@pytest.mark.parametrize("name", SHIPPED)
def test_they_are_schemas_and_say_who_they_are(name):
    schema = json.loads(SHIPPED[name])
    Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    assert schema["$id"].endswith(f"/{name}")
    assert schema["title"]
    assert schema["description"]
    references = set(re.findall(r'"#/\$defs/(\w+)"', SHIPPED[name]))
    assert references == schema.get("$defs", {}).keys()


def test_there_is_one_for_each_kind_of_document():
    internal = {"batch record"}
    assert SCHEMAS.keys() - internal == DOCUMENTS.keys() - {"measure"}
    assert {name.removesuffix(".schema.json") for name in SHIPPED} == {*DOCUMENTS, "manifest"}


def test_bake_verify_and_compare(folder, printed, monkeypatch):
    monkeypatch.setattr("aoprecalc.api.bake.VerifyOptions", partial(VerifyOptions, points=200, rays=64))
    bake = printed("bake", "ring.obj", *BAKE, "--ground", "--verify", "--report", "bake.json", "--json")
    assert faults("bake", bake) == []
    assert faults("bake", json.loads((folder / "bake.json").read_bytes())) == []
    verify = printed("verify", "ring_ao.obj", "--points", "200", "--rays", "64", "--heat-map", "h.png", "--json")
    assert faults("verify", verify) == []
    for file in ("ring_ao.png", "ring_ao.obj", "bake.json"):
        assert faults("compare", printed("compare", file, file, "--json")) == []
    printed("bake", "ring.obj", *BAKE, "-o", "small/", "--size", "32", "--json")
    for file in ("ring_ao.png", "ring_ao.obj"):
        different = printed("compare", file, f"small/{file}", "--json")
        assert different["answer"] == "different"
        assert faults("compare", different) == []


@pytest.mark.parametrize("output", ["out.glb", "out.gltf", "out.exr", "folder/"])
def test_bakes_with_other_outputs(output, printed):
    assert faults("bake", printed("bake", "ring.obj", *BAKE, "-o", output, "--json")) == []


@pytest.mark.parametrize("words", [[], ["--views", "2"], ["--spheres", "3.json"]], ids=str)
def test_previews(words, printed):
    printed("spheres", "ring.obj", "-n", "3", "-s", "300", "-o", "3.json", "--json")
    assert faults("preview", printed("preview", "ring.obj", "--size", "48", *words, "--json")) == []


def test_compare_says_what_differs(folder, printed):
    bake = printed("bake", "ring.obj", *BAKE, "--report", "a.json", "--json")
    (folder / "b.json").write_text(json.dumps(bake | {"directions": None, "sampling": "random"}), encoding="utf-8")
    (folder / "c.png").write_bytes((folder / "ring_ao.png").read_bytes())
    for count in (3, 4):
        printed("spheres", "ring.obj", "-n", count, "-s", "300", "-o", f"{count}.json", "--json")
    found = {}
    for pair in (("a.json", "b.json"), ("3.json", "4.json"), ("c.png", "c.png")):
        found[pair] = printed("compare", *pair, "--json")
        assert faults("compare", found[pair]) == []
    assert found["a.json", "b.json"]["details"]["differing"] == 2
    assert found["3.json", "4.json"]["details"] == {"spheres": [[3], [4]]}
    wrong = found["c.png", "c.png"]
    wrong["details"]["picture"]["median"] = 0
    assert faults("compare", wrong) == ["/details anyOf"]


@pytest.mark.parametrize("method", ["lloyd", "algebraic", "shadow", pytest.param("collision", marks=pytest.mark.slow)])
def test_sphere_sets(method, folder, printed):
    spheres = printed("spheres", "ring.obj", *SPHERES, "--method", method, "--json")
    assert faults("spheres", spheres) == []
    assert faults("spheres", json.loads((folder / "ring_spheres.json").read_bytes())) == []
    assert faults("measure", printed("spheres", "ring.obj", "--measure", "ring_spheres.json", "--json")) == []
    assert faults("compare", printed("compare", "ring_spheres.json", "ring_spheres.json", "--json")) == []


def test_sphere_sets_with_levels(printed):
    spheres = printed("spheres", "ring.obj", "--levels", "2,4", "-s", "300", "--json")
    assert len(spheres["levels"]) == 1
    assert faults("spheres", spheres) == []


def test_the_quality_of_an_open_mesh_lacks_volumes(folder, printed):
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export("face.obj")
    spheres = printed("spheres", "face.obj", *SPHERES, "--json")
    assert "inside_volume" not in spheres["quality"]
    assert faults("spheres", spheres) == []


def test_batches_and_their_cache(folder, printed):
    (folder / "broken.obj").write_text("v 0 0\n", encoding="utf-8")
    words = ("ring.obj", "broken.obj", "-o", "out", "--cache", "cache", "--spheres", " ".join(SPHERES))
    first = printed("batch", *words, "--bake", " ".join(BAKE), "--json")
    assert sorted(asset["status"] for asset in first["assets"]) == ["failed", "made"]
    assert faults("batch", first) == []
    report = json.loads((folder / "out/ring_report.json").read_bytes())
    assert faults("bake", report) == []
    for words in (("info",), ("prune", "--all")):
        assert faults("cache", printed("cache", *words, "--cache", "cache", "--json")) == []


@pytest.mark.slow
def test_doctor(printed):
    assert faults("doctor", printed("doctor", "--json")) == []


def test_a_wrong_document_is_refused(printed):
    bake = printed("bake", "ring.obj", *BAKE, "--json")

    def changed(change):
        document = copy.deepcopy(bake)
        change(document)
        return faults("bake", document)

    assert changed(lambda it: it.update(schema=2)) == ["/schema const"]
    assert changed(lambda it: it.pop("ao")) == ["/ required"]
    assert changed(lambda it: it.update(colour="red")) == ["/ additionalProperties"]
    assert changed(lambda it: it["ao"].update(mean="0.5")) == ["/ao/mean type"]
    assert changed(lambda it: it["ao"].update(deviation=0.1)) == ["/ao additionalProperties"]
    assert changed(lambda it: it["parts"][0].update(receives=1)) == ["/parts/0/receives type"]
    assert changed(lambda it: it.update(directions=64.5)) == ["/directions type"]


# Manifests. The schema and the program must agree; what no schema can say, such as one number of spheres, is left out.

MANIFESTS = [
    ("[bake]", True),
    ("bake = true", True),
    ("[bake]\nsize = 512\ncrease-angle = 40.5\nbit-depth = 16", True),
    ("[bake]\nsize = '512x256'\nmemory-limit = '2G'\nonly = 'wheel*'\nexclude = ['a', 'b']", True),
    ("[spheres]\nlevels = [8, 32]\nmethod = 'shadow'", True),
    ("exclude = 'draft.obj'\noutput = 'build'\n[bake]\n[[override]]\nmatch = '*.obj'\nspheres = { spheres = 8 }", True),
    ("[bake]\n[[asset]]\nmesh = 'ring.obj'\nname = 'props/ring'\nbake = { size = 64 }", True),
    ("[bake]\nsizes = 512", False),
    ("[bake]\nsize = 0", False),
    ("[bake]\ntarget-error = 2", False),
    ("[bake]\nunwrap-timeout = 0", False),
    ("[bake]\nestimator = 'median'", False),
    ("[bake]\nground = 1", False),
    ("[bake]\n[[override]]\nbake = false", False),
    ("[bakes]", False),
    ("bake = 'yes'", False),
]


@pytest.mark.parametrize(("text", "right"), MANIFESTS, ids=[text.replace("\n", " ") for text, _ in MANIFESTS])
def test_the_schema_of_manifests_agrees_with_the_program(text, right, folder):
    text = f"inputs = ['*.obj']\n{text}"
    (folder / "draft.obj").touch()
    file = folder / "aoprecalc.toml"
    file.write_text(text, encoding="utf-8")
    assert (faults("manifest", tomllib.loads(text)) == []) is right
    if right:
        read_manifest(file).assets_of(lambda path: False)
    else:
        with pytest.raises(AoprecalcError):
            read_manifest(file).assets_of(lambda path: False)
