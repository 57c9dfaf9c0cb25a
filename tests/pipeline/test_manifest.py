"""Manifests: what they say of each asset, and what is said where they make no sense."""

import re
from pathlib import Path

import pytest

from aoprecalc.errors import UsageError
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline import batch, plan_batch
from aoprecalc.pipeline.jobs import JobSpec
from pipeline.helpers import contents, error_of, run, write_ring

DEFAULT = JobSpec(bake=BakeOptions())


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with files that are not read; the present folder is another."""
    for file in ("rock.obj", "props/chair.obj", "props/old/chair.obj", "props/table.ply"):
        (tmp_path / "game" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "game" / file).touch()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "game"


@pytest.fixture
def planned(here):
    """planned(text, output) -> name -> asset, and the output folder, of a manifest of that text."""

    def plan_text(text, output=None):
        (here / "batch.toml").write_text(text, encoding="utf-8")
        made = plan_batch(["../game/batch.toml"], output, None)
        return {asset.name: asset for asset in made.assets}, made.output

    return plan_text


def specs(planned, text):
    """The order of each asset, by its name."""
    return {name: asset.spec for name, asset in planned('output = "out"\n' + text)[0].items()}


def test_all_paths_count_from_its_folder(planned, here):
    text = 'inputs = ["props/*"]\noutput = "built"\nbake = true\n[[asset]]\nmesh = "../game/rock.obj"\n'
    assets, output = planned(text)
    assert output.resolve() == here / "built"
    found = {name: asset.mesh.resolve() for name, asset in assets.items()}
    assert found == {
        "rock": here / "rock.obj",
        "chair": here / "props/chair.obj",
        "table": here / "props/table.ply",
    }
    assert str(assets["chair"].mesh) == "../game/props/chair.obj"


MISSES = {
    "an override": ("", '[[override]]\nmatch = "prosp/*"\n', "match = 'prosp/*' matches none", "'props/*'"),
    "an override by name": ("", '[[override]]\nmatch = "tabel.ply"\n', "match = 'tabel.ply' matches", "'table.ply'"),
    "an asset": ("", '[[asset]]\nmesh = "props/chairs.obj"\n', "mesh = 'props/chairs.obj' is", "'props/chair.obj'"),
    "an asset in no folder": ("", '[[asset]]\nmesh = "prosp/a.obj"\n', "mesh = 'prosp/a.obj' is not a file", "'props/"),
    "a folder": ("", '[[override]]\nmatch = "props/"\n', "match = 'props/' matches none", "'props/*'"),
    "nothing like it": ("", '[[override]]\nmatch = "zzz"\n', "match = 'zzz' matches none of its meshes; correct", ""),
}  # fmt: skip


@pytest.mark.parametrize("case", MISSES)
def test_what_matches_nothing_is_an_error_with_the_nearest(case, here, command):
    keys, tables, words, nearest = MISSES[case]
    (here / "batch.toml").write_text(f'inputs = "**/*"\noutput = "out"\nbake = true\n{keys}{tables}')
    done = command("batch", "../game/batch.toml")
    assert done.returncode == 2
    assert words in error_of(done)
    assert nearest in error_of(done)
    assert "relative to the manifest's folder" in error_of(done)
    with pytest.raises(UsageError, match="correct this"):
        batch(here / "batch.toml")


def test_all_that_match_nothing_are_told_at_once(here, command):
    overrides = "".join(f'[[override]]\nmatch = "{name}"\n' for name in ("rock.obj", "one", "two/*"))
    text = 'inputs = "*.obj"\noutput = "out"\nbake = true\n'
    (here / "batch.toml").write_text(text + overrides + '[[asset]]\nmesh = "four.obj"\n')
    error = error_of(command("batch", here / "batch.toml"))
    assert [word in error for word in ("'one'", "'two/*'", "'four.obj'")] == [True] * 3
    assert "match = 'rock.obj'" not in error


def test_an_exclude_that_matches_nothing_is_a_note(here):
    """A folder of drafts that a fresh checkout lacks stops no batch."""
    keys = 'exclude = ["zzz/*", "rok.obj", "props/*"]\n'
    (here / "batch.toml").write_text(f'inputs = "**/*"\noutput = "out"\nbake = true\n{keys}')
    plan = plan_batch(["../game/batch.toml"], None, None)
    assert [asset.name for asset in plan.assets] == ["rock"]
    missed = [line.partition(" (nearest: 'rock.obj'")[0] for line in plan.notes]
    assert missed == [
        "../game/batch.toml: exclude = 'zzz/*' matches none of its meshes",
        "../game/batch.toml: exclude = 'rok.obj' matches none of its meshes",
    ]


PATTERNS = {
    "rock.obj": ["rock"],
    "chair.obj": ["props/chair", "props/old/chair"],
    "*.ply": ["props/table"],
    "props/*": ["props/chair", "props/old/chair", "props/table"],
    "./props/chair.obj": ["props/chair"],
    "{here}/props/chair.obj": ["props/chair"],
    "{here}/props/old/*": ["props/old/chair"],
    "../game/rock.obj": ["rock"],
    "props/**/chair.obj": ["props/chair", "props/old/chair"],
    "**/chair.obj": ["props/chair", "props/old/chair"],
    "**/rock.obj": ["rock"],
    "**/old/**/*": ["props/old/chair"],
    "*/t?ble.ply": ["props/table"],
}


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("inputs", ["**/*", "{here}/**/*", "../game/**/*"])
@pytest.mark.parametrize("manifest", ["../game/batch.toml", "{here}/batch.toml", "../link/batch.toml"])
def test_what_matches_does_not_depend_on_how_paths_are_written(pattern, inputs, manifest, here):
    (here.parent / "link").symlink_to(here)
    text = f'output = "out"\ninputs = "{inputs}"\nbake = true\n[[override]]\nmatch = "{pattern}"\nspheres = true\n'
    (here / "batch.toml").write_text(text.format(here=here))
    assets = plan_batch([manifest.format(here=here)], None, None).assets
    assert sorted(asset.name for asset in assets if asset.spec.spheres) == PATTERNS[pattern]


def test_another_output_counts_from_the_present_folder(planned):
    assert str(planned('inputs = "*.obj"\noutput = "built"\nbake = true\n', "here")[1]) == "here"


def test_absolute_paths_are_themselves(planned, here):
    assets, output = planned(f"inputs = ['{here}/props/*.ply']\noutput = '{here}/built'\nbake = true\n")
    assert {name: asset.mesh for name, asset in assets.items()} == {"table": here / "props/table.ply"}
    assert output == here / "built"


def test_its_own_folder_may_have_any_name(planned, here):
    odd = here.rename(here.parent / "game [v2]")
    (odd / "batch.toml").write_text('inputs = ["*.obj", "missing.obj"]\noutput = "out"\nbake = true\n')
    assets = plan_batch([str(odd / "batch.toml")], None, None).assets
    assert [asset.name for asset in assets] == ["rock", "missing"]


def test_a_byte_order_mark_is_no_fault(planned):
    assert list(planned('\ufeffinputs = "*.obj"\noutput = "out"\nbake = true\n')[0]) == ["rock"]


def test_defaults_are_for_all(planned):
    text = 'inputs = "**/*"\n[bake]\nsize = "512x256"\noutput = ".exr"\n[spheres]\nspheres = 20\noutput = ".csv"\n'
    expected = JobSpec(BakeOptions(size=(512, 256)), SphereOptions(20), bake_output=(".exr",), spheres_output=(".csv",))
    assert specs(planned, text) == dict.fromkeys(["rock", "props/chair", "props/old/chair", "props/table"], expected)


@pytest.mark.parametrize("text", ["bake = true\n", "[bake]\n", "bake = {}\nspheres = false\n"])
def test_true_and_an_empty_table_are_the_defaults(text, planned):
    assert specs(planned, f'inputs = "*.obj"\n{text}') == {"rock": DEFAULT}


def test_exclude_leaves_out(planned):
    text = 'inputs = "**/*"\nbake = true\nexclude = '
    assert list(specs(planned, text + '"props/*"')) == ["rock"]
    assert list(specs(planned, text + '["*/old/*", "rock.*"]')) == ["props/chair", "props/table"]
    assert list(specs(planned, text + '"chair.obj"')) == ["props/table", "rock"]


OVERRIDES = """
inputs = "**/*"
[bake]
directions = 64
padding = 4
[[override]]
match = "props/*"
bake = {directions = 128, fill = "none"}
[[override]]
match = "*chair*"
bake = {directions = 256}
spheres = {spheres = 9}
[[override]]
match = "*/old/*"
bake = false
"""


def test_later_overrides_win_key_by_key(planned):
    chair = {"padding": 4, "directions": 256, "fill": "none"}
    assert specs(planned, OVERRIDES) == {
        "rock": JobSpec(BakeOptions(directions=64, padding=4)),
        "props/table": JobSpec(BakeOptions(directions=128, padding=4, fill="none")),
        "props/chair": JobSpec(BakeOptions(**chair), SphereOptions(9)),
        "props/old/chair": JobSpec(None, SphereOptions(9)),
    }


def test_overrides_win_however_their_keys_are_spelt(planned):
    spellings = ("shadow_size = 64", "shadow-size = 128", "shadow_size = 256")
    text = 'inputs = "*.obj"\n[bake]\nshadow-size = 32\n'
    for spelling in spellings:
        text += f'[[override]]\nmatch = "*"\nbake = {{{spelling}}}\n'
    assert specs(planned, text) == {"rock": JobSpec(BakeOptions(shadow_size=256))}


# bake of all, then of two overrides -> what is baked in the end
SWITCHES = {
    "off": ("{padding = 4}", "false", None, None),
    "off and on again, as before": ("{padding = 4}", "false", "true", BakeOptions(padding=4)),
    "off and on with more": ("{padding = 4}", "false", "{directions = 64}", BakeOptions(padding=4, directions=64)),
    "off for all, on for some": ("false", "true", None, BakeOptions()),
    "off for all, on for some with a table": ("false", "{padding = 4}", None, BakeOptions(padding=4)),
    "on, which it is": ("{padding = 4}", "{directions = 64}", "true", BakeOptions(padding=4, directions=64)),
}


@pytest.mark.parametrize("case", SWITCHES)
def test_false_is_none_and_true_is_the_default(case, planned):
    first, *others, bake = SWITCHES[case]
    text = f'inputs = "*.obj"\nspheres = true\nbake = {first}\n'
    for other in filter(None, others):
        text += f'[[override]]\nmatch = "rock.obj"\nbake = {other}\n'
    assert specs(planned, text) == {"rock": JobSpec(bake, SphereOptions())}


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("tolerance = 0.05", {"tolerance": 0.05}),
        ("levels = [2, 8]", {"levels": (2, 8)}),
        ("levels = '2,8'", {"levels": (2, 8)}),
        ("spheres = 7", {"spheres": 7}),
    ],
)
@pytest.mark.parametrize("before", ["tolerance = 0.1", "levels = [3, 9]", "spheres = 5"])
def test_how_many_spheres_is_what_was_said_last(before, said, meant, planned):
    text = f'inputs = "*.obj"\n[spheres]\nseed = 3\n{before}\n[[override]]\nmatch = "*"\nspheres = {{{said}}}\n'
    assert specs(planned, text) == {"rock": JobSpec(spheres=SphereOptions(seed=3, **meant))}


def test_single_assets_have_names_and_options_of_their_own(planned, here):
    text = """
        inputs = "**/*"
        exclude = ["rock.obj"]
        bake = {padding = 4}
        [[override]]
        match = "*"
        bake = {directions = 64}
        [[asset]]
        mesh = "rock.obj"
        name = "nature/stone"
        bake = {directions = 256}
        [[asset]]
        mesh = "./props/table.ply"
        bake = false
        spheres = true
        """
    usual = JobSpec(BakeOptions(padding=4, directions=64))
    assert specs(planned, text) == {
        "nature/stone": JobSpec(BakeOptions(padding=4, directions=256)),
        "props/table": JobSpec(spheres=SphereOptions()),
        "props/chair": usual,
        "props/old/chair": usual,
    }
    assets, _ = planned('output = "out"\n' + text)
    assert assets["nature/stone"].mesh.resolve() == here / "rock.obj"
    assert (assets["nature/stone"].folder, assets["nature/stone"].stem) == ("nature", "stone")


def test_an_asset_alone_needs_no_inputs(planned):
    assert specs(planned, '[[asset]]\nmesh = "rock.obj"\nspheres = {spheres = 3}\n') == {
        "rock": JobSpec(spheres=SphereOptions(3))
    }


GOOD = 'inputs = "*.obj"\noutput = "out"\n'
WRONG = {
    "no TOML": ("inputs = [", 2, "is not valid TOML: "),
    "no text": (b"\xff\xfe\x00", 2, "is not valid TOML: "),
    "nothing": ("", 2, "says nothing about bake or spheres"),
    "nothing to make": (GOOD, 2, "says nothing about bake or spheres"),
    "nothing for an asset": (f"{GOOD}bake = false\n", 2, "rock.obj: neither bake nor spheres is asked for"),
    "no output": ('inputs = "*.obj"\nbake = true\n', 2, 'names no output folder; add output = "build"'),
    "no inputs": ('output = "out"\nbake = true\n', 4, "names no meshes"),
    "all left out": (f'{GOOD}bake = true\nexclude = "*"\n', 4, "leaves out all meshes"),
    "a pattern that fits nothing": ('inputs = "*.stl"\noutput = "out"\nbake = true\n', 4, "*.stl: matches no mesh"),
    "an unknown key": (f"{GOOD}bake = true\njobs = 4\n", 2, ".toml: unknown key 'jobs'; expected one of bake"),
    "an unknown key of an override": (
        f'{GOOD}bake = true\n[[override]]\nmatch = "*"\nname = "x"\n', 2, ".toml: unknown key 'override[0].name'"
    ),
    "an unknown key of an asset": (
        f'{GOOD}bake = true\n[[asset]]\nmesh = "rock.obj"\nmatch = "x"\n', 2, ".toml: unknown key 'asset[0].match'"
    ),
    "an unknown option": (f"{GOOD}[bake]\nsise = 9\n", 2, ".toml: unknown key 'bake.sise'; did you mean 'size'?"),
    "a wrong value": (f"{GOOD}[bake]\ndirections = 0\n", 2, "rock.obj: directions is 0; expected a whole number"),
    "a wrong value in an override": (
        f'{GOOD}bake = true\n[[override]]\nmatch = "*"\nspheres = {{seed = -1}}\n', 2, "rock.obj: seed is -1"
    ),
    "two spellings of a key": (f"{GOOD}[bake]\nshadow-size = 64\nshadow_size = 64\n", 2, "shadow-size is given twice"),
    "inputs that are numbers": ('inputs = [1]\noutput = "out"\nbake = true\n', 2, "inputs is [1]; expected a list"),
    "an output that is a number": ('inputs = "*.obj"\noutput = 1\nbake = true\n', 2, "output is 1; expected a text"),
    "a bake that is a text": (f'{GOOD}bake = "yes"\n', 2, "bake is 'yes'; expected a table"),
    "overrides in one table": (f'{GOOD}bake = true\n[override]\nmatch = "*"\n', 2, "write [[override]] above each"),
    "an override of nothing": (f"{GOOD}bake = true\n[[override]]\nbake = false\n", 2, "override[0].match is missing"),
    "an asset without a mesh": (f'{GOOD}bake = true\n[[asset]]\nname = "x"\n', 2, "asset[0].mesh is missing"),
    "an asset that is a pattern": (f'{GOOD}bake = true\n[[asset]]\nmesh = "r*.obj"\n', 2, "'r*.obj', one file was"),
    "an asset that is a folder": (f'{GOOD}bake = true\n[[asset]]\nmesh = "props"\n', 2, "'props', one file was"),
    "an asset said twice": (
        f'{GOOD}bake = true\n[[asset]]\nmesh = "rock.obj"\n[[asset]]\nmesh = "./rock.obj"\n', 2, "two [[asset]]"
    ),
    "a name that others have": (
        'inputs = "props/*"\noutput = "out"\nbake = true\n[[asset]]\nmesh = "props/table.ply"\nname = "chair"\n',
        2,
        "would both be written as chair",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_makes_no_sense_is_one_line_of_error(case, here, command):
    text, code, words = WRONG[case]
    (here / "batch.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    before = contents(here)
    done = command("batch", "../game/batch.toml")
    assert done.returncode == code
    assert words in error_of(done)
    assert "../game/" in error_of(done)
    assert done.stdout == ""
    assert contents(here) == before
    assert not (here / "out").exists()


@pytest.mark.parametrize(
    "name",
    ["../rock", "props/../../rock", "/rock", "", ".", "..", "props/", "props//rock", "./rock", "props/./rock", "/"]
    + ["a\\u0000b", "a\\nb", ".aoprecalc/assets/rock", " "],
)
def test_names_stay_in_the_output_folder(name, here, command):
    (here / "batch.toml").write_text(f'output = "out"\nbake = true\n[[asset]]\nmesh = "rock.obj"\nname = "{name}"\n')
    done = command("batch", "../game/batch.toml")
    assert done.returncode == 2
    assert "expected one below the output folder, such as props/rock" in error_of(done)


@pytest.mark.parametrize("manifest", ["missing.toml", "props.toml"])
def test_a_manifest_that_cannot_be_read(manifest, here, command):
    (here / "props.toml").mkdir()
    done = command("batch", here / manifest)
    assert done.returncode == 4
    assert "cannot be read (" in error_of(done)
    assert "a manifest was expected" in error_of(done)


@pytest.mark.parametrize("words", [["--bake", "-n 64"], ["--spheres", ""]])
def test_what_a_manifest_says_is_not_said_beside_it(words, here, command):
    (here / "batch.toml").write_text(f"{GOOD}bake = true\n")
    done = command("batch", here / "batch.toml", *words)
    assert done.returncode == 2
    assert "is a manifest and says itself what is made" in error_of(done)


def test_a_manifest_from_another_folder_makes_what_it_says(tmp_path):
    write_ring(tmp_path / "game/props/ring.obj")
    write_ring(tmp_path / "game/stone.obj")
    (tmp_path / "game/batch.toml").write_text("""
        inputs = ["props/*"]
        output = "../built"
        bake = {size = 64, directions = 64, output = [".tif", ".glb"]}
        [[asset]]
        mesh = "stone.obj"
        name = "nature/rock"
        bake = false
        spheres = {spheres = 8, samples = 500, output = ".csv"}
        """)
    done = run(tmp_path, "batch", "game/batch.toml", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert list(contents(tmp_path / "built")) == [
        "nature/rock_spheres.csv",
        "ring_ao.glb",
        "ring_ao.tif",
        "ring_report.json",
    ]


def test_files_of_options_count_from_its_folder(planned, here):
    hill = here.parent / "far/hill.obj"
    for file in (here / "around/wall.obj", hill):
        file.parent.mkdir()
        file.touch()
    text = f'inputs = ["props/*"]\n[bake]\noccluder = ["around/wall.obj", "{hill.as_posix()}"]\n'
    found = {spec.bake.occluder for spec in specs(planned, text).values()}
    assert len(found) == 1
    assert [Path(path).resolve() for path in found.pop()] == [here / "around/wall.obj", hill]


def test_files_of_options_that_are_not_there_are_all_named_before_any_work(here, planned):
    (here / "wall.obj").touch()
    tables = '[[override]]\nmatch = "rock.obj"\nbake = {high = ["rok.obj", "wall.obj"], cage = "around/cage.obj"}\n'
    text = f'inputs = ["**/*"]\noutput = "out"\n[bake]\noccluder = "wal.obj"\nsky = "studio.hdr"\n{tables}'
    with pytest.raises(UsageError) as raised:
        planned(text)
    error = str(raised.value)
    assert error.startswith("../game/batch.toml: cage = 'around/cage.obj' is not a file")
    assert "; high = 'rok.obj' is not a file (nearest: 'rock.obj'" in error
    assert "; occluder = 'wal.obj' is not a file (nearest: 'wall.obj'" in error
    assert error.endswith(
        "; sky = 'studio.hdr' is not a file; correct this: paths are relative to the manifest's folder"
    )
    assert "= 'wall.obj'" not in error


@pytest.mark.parametrize("option", ['cage = "2%"', 'match = "nothing"'])
def test_a_cage_without_details_is_refused_before_any_work(planned, option):
    with pytest.raises(UsageError, match=r"batch.toml, for .*: (cage|match) is .*no detailed mesh; add high"):
        planned(f'inputs = ["rock.obj"]\noutput = "out"\n[bake]\n{option}\n')


def test_errors_name_files_of_options_as_the_manifest_does(tmp_path):
    write_ring(tmp_path / "game/ring.obj")
    (tmp_path / "game/around").mkdir()
    (tmp_path / "game/around/wall.obj").write_text("no mesh\n")
    text = 'inputs = ["ring.obj"]\noutput = "../built/deep"\n[bake]\noccluder = "around/wall.obj"\n'
    (tmp_path / "game/batch.toml").write_text(text)
    for folder, named in ((tmp_path, "game/around/wall.obj: "), (tmp_path / "game", "around/wall.obj: ")):
        done = run(folder, "batch", (tmp_path / "game/batch.toml").relative_to(folder))
        (line,) = (line for line in done.stdout.splitlines() if "wall.obj" in line)
        assert re.match(rf"failed +\d+\.\d s +ring +{named}", line), line
