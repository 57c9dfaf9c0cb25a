"""Which files a batch takes, and what it calls them."""

import os

import pytest
import trimesh

from aoprecalc.options import BakeOptions
from aoprecalc.pipeline import batch, plan_batch
from aoprecalc.pipeline.jobs import JobSpec
from pipeline.helpers import BAKE, SPHERES, contents, said, statuses, write_ring

FILES = [
    "rock.obj",
    "notes.txt",
    ".hidden.obj",
    "props/rock.obj",
    "props/chair.GLB",
    "props/old/chair.stl",
    "props/old/table.ply",
    "walls [new]/wall [1].obj",
    "walls [new]/wall 1.obj",
]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with files that are not read, in which one is."""
    for file in FILES:
        (tmp_path / "assets" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "assets" / file).touch()
    monkeypatch.chdir(tmp_path / "assets")
    return tmp_path / "assets"


def found(*patterns, output="../out"):
    """Name -> mesh, as a batch would find them."""
    return {asset.name: asset.mesh.as_posix() for asset in plan_batch(patterns, output, None).assets}


PATTERNS = {
    ("*.obj",): {"rock": "rock.obj"},
    ("*",): {"rock": "rock.obj"},
    ("props/*",): {"rock": "props/rock.obj", "chair": "props/chair.GLB"},
    ("props/r??k.obj",): {"rock": "props/rock.obj"},
    ("*/rock.obj",): {"props/rock": "props/rock.obj"},
    ("**/rock.obj",): {"rock": "rock.obj", "props/rock": "props/rock.obj"},
    ("props/**/*",): {"rock": "props/rock.obj", "chair": "props/chair.GLB"}
    | {"old/chair": "props/old/chair.stl", "old/table": "props/old/table.ply"},
    ("props/old",): {"chair": "props/old/chair.stl", "table": "props/old/table.ply"},
    ("props/old/",): {"chair": "props/old/chair.stl", "table": "props/old/table.ply"},
    ("props/rock.obj",): {"rock": "props/rock.obj"},
    ("rock.obj", "props/rock.obj"): {"rock": "rock.obj", "props/rock": "props/rock.obj"},
    ("props/old/table.ply", "props/rock.obj"): {"old/table": "props/old/table.ply", "rock": "props/rock.obj"},
    ("rock.obj", "*.obj", "./rock.obj", "props/../rock.obj"): {"rock": "rock.obj"},
    (".hidden.obj",): {".hidden": ".hidden.obj"},
    ("missing.obj", "rock.obj"): {"missing": "missing.obj", "rock": "rock.obj"},
    ("walls [new]/wall [1].obj",): {"wall [1]": "walls [new]/wall [1].obj"},
    ("walls [new]",): {"wall [1]": "walls [new]/wall [1].obj", "wall 1": "walls [new]/wall 1.obj"},
    ("*/wall [[]*.obj",): {"walls [new]/wall [1]": "walls [new]/wall [1].obj"},
    ("*/wall ?.obj",): {"walls [new]/wall 1": "walls [new]/wall 1.obj"},
}


@pytest.mark.parametrize("patterns", PATTERNS, ids=" ".join)
def test_patterns_stand_for_meshes(patterns, here):
    assert found(*patterns) == PATTERNS[patterns]


def test_patterns_count_from_any_folder(here, monkeypatch):
    monkeypatch.chdir(here / "walls [new]")
    assert found("wall*") == {"wall [1]": "wall [1].obj", "wall 1": "wall 1.obj"}
    assert found("missing.obj") == {"missing": "missing.obj"}
    assert found(str(here / "props/r*"), "../props/rock.obj") == {"rock": f"{here}/props/rock.obj"}


@pytest.mark.parametrize("pattern", ["*.stl", "**/*.fbx", "no/*", "notes.*", "empty", "missing", "[ab].obj"])
def test_a_pattern_that_fits_nothing_is_an_error(pattern, here):
    (here / "empty").mkdir()
    message, code = said(plan_batch, ["rock.obj", pattern], "../out", None)
    assert code == 4
    assert message.startswith(f"{pattern}: matches no mesh")
    assert "; one of .obj, " in message


ALIKE = {
    "kinds apart": (["rock.obj", "rock.glb"], ["rock_obj", "rock_glb"]),
    "folders apart": (["a/rock.obj", "b/rock.obj"], ["a/rock", "b/rock"]),
    "kinds apart in one of the folders": (["a/r.obj", "a/r.ply", "b/r.obj"], ["a/r_obj", "a/r_ply", "b/r"]),
    "capitals": (["Rock.obj", "rock.glb"], ["Rock_obj", "rock_glb"]),
    "capitals of kinds": (["rock.OBJ", "rock.glb"], ["rock_obj", "rock_glb"]),
    "dots": (["rock.low.obj", "rock.high.obj"], ["rock.low", "rock.high"]),
}


@pytest.mark.parametrize("case", ALIKE)
def test_no_two_assets_have_one_name(case, tmp_path, monkeypatch):
    files, names = ALIKE[case]
    for file in files:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).touch()
    monkeypatch.chdir(tmp_path)
    assert found(*files) == dict(zip(names, files, strict=True))


CLASHES = {
    "capitals alone": ["Rock.obj", "rock.obj"],
    "capitals of folders": ["A/rock.obj", "a/rock.obj"],
    "a kind as the end of a name": ["rock.obj", "rock.glb", "rock_obj.ply"],
}


@pytest.mark.parametrize("case", CLASHES)
def test_names_that_cannot_be_told_apart_are_an_error(case, tmp_path, monkeypatch):
    """Not every file system tells capitals apart, and results should lie as they do on every one."""
    monkeypatch.chdir(tmp_path)
    for file in CLASHES[case]:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).touch()
    message, code = said(found, *CLASHES[case])
    assert code == 2
    assert "would both be written as" in message


def test_names_do_not_depend_on_what_else_is_there(here):
    """A pattern's names count from its fixed part, however few files it fits."""
    everything = found("**/*")
    for file in ("rock.obj", "props/chair.GLB", "props/old/chair.stl"):
        (here / file).unlink()
    fewer = found("**/*")
    assert fewer == {name: mesh for name, mesh in everything.items() if os.path.exists(mesh)}
    assert len(fewer) == len(everything) - 3


@pytest.mark.parametrize("output", ["assets/made", "assets", "."], ids=["inside", "among them", "above"])
def test_outputs_are_no_inputs_of_the_next_batch(output, tmp_path, monkeypatch, pool):
    monkeypatch.chdir(tmp_path)
    write_ring(tmp_path / "assets/ring.obj")
    write_ring(tmp_path / "assets/props/ring.obj")
    options = {"bake": BAKE, "spheres": SPHERES}
    first = batch("assets", output, **options)
    assert statuses(first) == {"ring": "made", "props/ring": "made"}
    before = contents(tmp_path)
    assert sum(name.endswith("ring_ao.obj") for name in before) == 2
    assert statuses(batch("assets", output, **options)) == {"ring": "unchanged", "props/ring": "unchanged"}
    assert contents(tmp_path) == before


def test_not_even_where_a_shell_has_named_them(tmp_path, monkeypatch, pool):
    """As it does for a pattern without quotes."""
    monkeypatch.chdir(tmp_path)
    write_ring(tmp_path / "ring.obj")
    batch("ring.obj", ".", bake=BAKE)
    named = sorted(path.name for path in tmp_path.glob("*.obj"))
    assert named == ["ring.obj", "ring_ao.obj"]
    assert statuses(batch(named, ".", bake=BAKE)) == {"ring": "unchanged"}
    message, code = said(plan_batch, ["ring_ao.obj"], ".", None)
    assert code == 4
    assert message.startswith("ring_ao.obj: matches only outputs of batches, ")


@pytest.mark.parametrize("folder", ["in/props/made", "in/props", "in"])
def test_outputs_of_another_batch_are_no_inputs_and_hide_none(folder, tmp_path, monkeypatch, pool):
    """They may lie apart, or among the meshes, of which it has had some or all."""
    monkeypatch.chdir(tmp_path)
    write_ring(tmp_path / "in/ring.obj")
    write_ring(tmp_path / "in/props/ring.obj")
    batch("in" if folder == "in" else "in/props", folder, bake=BAKE)
    assert found("in", output="out") == {"ring": "in/ring.obj", "props/ring": "in/props/ring.obj"}
    assert found("in/props", output="out") == {"ring": "in/props/ring.obj"}


def test_outputs_of_an_asset_that_is_gone_are_no_inputs_either(tmp_path, monkeypatch, pool):
    monkeypatch.chdir(tmp_path)
    for name in ("ring.obj", "other.obj"):
        write_ring(tmp_path / name)
    batch("*.obj", ".", bake=BAKE)
    (tmp_path / "ring.obj").unlink()
    assert list(found("*", output=".")) == ["other"]


def test_a_bake_is_made_where_nothing_is_said(here):
    (asset,) = plan_batch(["rock.obj"], "../out", None).assets
    assert asset.spec == JobSpec(bake=BakeOptions())


@pytest.mark.parametrize(
    ("patterns", "output", "words"),
    [
        (["rock.obj"], None, "no output folder was given"),
        (["a.toml", "rock.obj"], "out", "a.toml is a manifest, but other inputs were given as well"),
        (["rock.obj", "A.TOML"], "out", "A.TOML is a manifest, but other inputs were given as well"),
    ],
)
def test_what_a_plan_needs(patterns, output, words, here):
    message, code = said(plan_batch, patterns, output, None)
    assert code == 2
    assert words in message


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"patterns": None}, "has a value of type NoneType, a path or a sequence of paths was expected"),
        ({"patterns": ["rock.obj", 5]}, "has a value of type int, a path or a sequence of paths was expected"),
        ({"patterns": b"rock.obj"}, "has a value of type int, a path or a sequence of paths was expected"),
        ({"patterns": []}, "has no value, a path or a sequence of paths was expected"),
        ({"output": 3}, "is of type int, a path was expected"),
        ({"bake": "--size 64"}, "is of type str, BakeOptions was expected"),
        ({"spheres": {}}, "is of type dict, SphereOptions was expected"),
        ({"cache": True}, "is of type bool, a path was expected"),
        ({"options": BAKE}, "is of type BakeOptions, BatchOptions was expected"),
    ],
    ids=str,
)
def test_arguments_of_another_type_are_named(wrong, problem, here):
    (argument,) = wrong
    assert said(lambda: batch(**{"patterns": "rock.obj", "output": "../out"} | wrong)) == (f"{argument} {problem}", 2)
    assert not (here / "../out").exists()


def test_links_to_folders_are_no_way_for_two_stars(here):
    """They may lead in circles."""
    (here / "props/up").symlink_to("..")
    (here / "self").symlink_to(".")
    assert not [name for name in found("**/*") if "up" in name or "self" in name]
    assert not [name for name in found(".") if "up" in name or "self" in name]


def test_what_has_its_kind_in_its_name_has_it_in_all_names(tmp_path, monkeypatch, pool):
    """An STL becomes a GLB, and would have the name of the other one's."""
    monkeypatch.chdir(tmp_path)
    for kind in ("glb", "stl"):
        trimesh.creation.icosphere(1).export(tmp_path / f"ball.{kind}")
    assert statuses(batch("*.*", "out", bake=BAKE)) == {"ball_glb": "made", "ball_stl": "made"}
    names = [name for name in contents(tmp_path / "out") if name.endswith(".glb")]
    assert names == ["ball_glb_ao.glb", "ball_stl_ao.glb"]


def test_what_is_no_mesh_is_refused_before_any_work(here):
    (here / "wood.png").touch()
    message, code = said(plan_batch, ["wood.png"], "../out", None)
    assert code == 4
    assert message.startswith("wood.png: matches no mesh")
