"""A batch makes again what must be, and nothing else."""

import json
import os
import shutil
from collections import Counter
from pathlib import Path

import pytest

from aoprecalc.options import BakeOptions, BatchOptions, SphereOptions
from aoprecalc.pipeline import batch
from aoprecalc.pipeline import state as inputs
from aoprecalc.pipeline import state as records_module
from aoprecalc.pipeline.state import AssetRecord, FileStamp, InputFiles, StateFolder
from gltf_kit.gltf_documents import STACKED, corner, pictured
from gltf_kit.gltf_maker import GltfMaker
from pipeline.helpers import BAKE, SPHERES, STATE_FOLDER, contents, said, statuses, without_times, write_ring

OLD = (10**18, 10**18)  # a time that tools may give to any file


@pytest.fixture
def rings(tmp_path, monkeypatch):
    """Two meshes, in the present folder, whose times are trusted at once."""
    monkeypatch.setattr(inputs, "_TIMESTAMP_RESOLUTION", -(10**12))
    monkeypatch.chdir(tmp_path)
    for name, minor in (("a", 0.4), ("b", 0.3)):
        os.utime(write_ring(tmp_path / f"in/{name}.obj", minor), ns=OLD)
    return tmp_path / "in"


def make(bake=None, spheres=SPHERES, patterns="in", **options):
    """Run a batch; return what became of each asset."""
    cache = options.pop("cache", None)
    return statuses(batch(patterns, "out", bake=bake, spheres=spheres, cache=cache, options=BatchOptions(**options)))


def record(name="a"):
    return json.loads(Path(f"out/{STATE_FOLDER}/assets/{name}.asset.json").read_text())


@pytest.fixture
def made(rings, pool):
    """The output folder of a batch that has been made."""
    assert make() == {"a": "made", "b": "made"}
    pool.jobs.clear()
    return rings.parent / "out"


def test_what_is_there_stays(made, pool):
    before = contents(made)
    times = {path: path.stat().st_mtime_ns for path in made.rglob("*.json")}
    assert make() == {"a": "unchanged", "b": "unchanged"}
    assert pool.jobs == []
    assert contents(made) == before
    assert {path: path.stat().st_mtime_ns for path in times} == times


def test_a_summary_is_remembered(made):
    remembered = [entry.summary for entry in batch("in", "out", spheres=SPHERES).results]
    shutil.rmtree(made)
    assert [entry.summary for entry in batch("in", "out", spheres=SPHERES).results] == remembered
    assert [entry["spheres"] for entry in remembered] == [8, 8]


def test_a_touched_input_is_looked_at_once(made, rings, pool):
    os.utime(rings / "a.obj", ns=(OLD[0], OLD[1] + 1))
    assert make() == {"a": "unchanged", "b": "unchanged"}
    assert pool.jobs == []
    assert record()["inputs"]["files"]["a.obj"]["times"][0] == OLD[1] + 1


def test_a_changed_input_is_made_again(made, rings, pool):
    before = contents(made)
    write_ring(rings / "a.obj", 0.2)
    os.utime(rings / "a.obj", ns=(OLD[0], OLD[1] - 1))  # by one that is older than it
    assert make() == {"a": "made", "b": "unchanged"}
    assert pool.jobs == ["a"]
    assert contents(made).keys() == before.keys()
    assert [name for name, data in contents(made).items() if data != before[name]] == ["a_spheres.json"]
    assert make() == {"a": "unchanged", "b": "unchanged"}


def test_a_material_that_appears_makes_it_again(rings, pool):
    write_ring(rings / "a.obj", mtllib="a.mtl", usemtl="stone")
    make()
    assert make() == {"a": "unchanged", "b": "unchanged"}
    (rings / "a.mtl").write_text("newmtl stone\nd 0\n")
    assert make() == {"a": "made", "b": "unchanged"}
    (rings / "a.mtl").unlink()
    assert make() == {"a": "made", "b": "unchanged"}


def test_other_options_make_it_again(made, pool):
    before = contents(made)
    assert make(spheres=SphereOptions(9, samples=500)) == {"a": "made", "b": "made"}
    assert make() == {"a": "made", "b": "made"}
    assert contents(made) == before


def test_another_version_makes_it_again(made, monkeypatch):
    monkeypatch.setattr("aoprecalc.pipeline.state.__version__", "99.0")
    assert make() == {"a": "made", "b": "made"}


def test_force_makes_it_again(made, pool):
    assert make(force=True) == {"a": "made", "b": "made"}
    assert sorted(pool.jobs) == ["a", "b"]


DAMAGE = {
    "deleted": lambda path: path.unlink(),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "empty": lambda path: path.write_bytes(b""),
    "another of the same size": lambda path: path.write_bytes(path.read_bytes().replace(b"0.", b"1.", 1)),
}


@pytest.mark.parametrize("how", DAMAGE)
@pytest.mark.parametrize("cached", [False, True], ids=["", "cache"])
def test_an_output_that_is_not_as_it_was_comes_again(how, cached, rings, pool):
    cache = "cache" if cached else None
    make(BAKE, cache=cache)
    before = contents(rings.parent / "out")
    pool.jobs.clear()
    DAMAGE[how](rings.parent / "out/a_spheres.json")
    assert make(BAKE, cache=cache) == {"a": "cached" if cached else "made", "b": "unchanged"}
    assert pool.jobs == ([] if cached else ["a"])
    assert without_times(contents(rings.parent / "out")) == without_times(before)
    assert make(BAKE, cache=cache) == {"a": "unchanged", "b": "unchanged"}


def test_an_output_that_was_touched_is_as_it_was(made, pool):
    os.utime(made / "a_spheres.json", ns=OLD)
    assert make() == {"a": "unchanged", "b": "unchanged"}


RECORDS = {
    "cut off": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "no text": lambda text: "\udcff",
    "a list": lambda text: "[]",
    "null": lambda text: "null",
    "of another version": lambda text: text.replace('"schema": 2', '"schema": 1'),
    "without inputs": lambda text: text.replace('"inputs"', '"imports"'),
    "with inputs of another kind": lambda text: json.dumps(json.loads(text) | {"inputs": {"files": ["a.obj"]}}),
    "with outputs of another kind": lambda text: json.dumps(json.loads(text) | {"outputs": "a_spheres.json"}),
    "with stamps of another kind": lambda text: text.replace('"digest"', '"hash"'),
}


@pytest.mark.parametrize("how", RECORDS)
def test_a_damaged_record_is_as_none(how, made, pool):
    before = contents(made)
    file = made / STATE_FOLDER / "assets/a.asset.json"
    text = RECORDS[how](file.read_text())
    file.write_bytes(text.encode(errors="surrogateescape"))
    assert make() == {"a": "made", "b": "unchanged"}
    assert contents(made) == before
    assert make() == {"a": "unchanged", "b": "unchanged"}


def test_records_that_are_deleted_lose_nothing_but_time(rings, pool):
    make(BAKE)
    before = contents(rings.parent / "out")
    shutil.rmtree(rings.parent / "out" / STATE_FOLDER)
    assert make(BAKE) == {"a": "made", "b": "made"}
    assert without_times(contents(rings.parent / "out")) == without_times(before)


def test_what_a_killed_batch_left_is_removed(made):
    left = made / STATE_FOLDER / "staging/0123"
    left.mkdir(parents=True)
    (left / ".half.a_spheres.json").write_text("{")
    make()
    assert not (made / STATE_FOLDER / "staging").exists()
    assert sorted(path.name for path in (made / STATE_FOLDER).iterdir()) == ["assets", "lock"]


def test_two_batches_do_not_write_to_one_folder(made):
    before = contents(made)
    with StateFolder(made).locked():
        message, code = said(make)
    assert code == 1
    assert message == "out: another batch writes there; wait for it, or choose another -o"
    assert contents(made) == before
    assert make() == {"a": "unchanged", "b": "unchanged"}


def test_outputs_that_are_no_longer_asked_for_go(rings, pool):
    make(BAKE, SPHERES)
    both = contents(rings.parent / "out")
    make(BAKE, None)
    assert {name for name in both if name not in contents(rings.parent / "out")} == {
        "a_spheres.json",
        "b_spheres.json",
    }
    make(None, SPHERES)
    assert contents(rings.parent / "out") == {name: both[name] for name in ("a_spheres.json", "b_spheres.json")}


def test_outputs_that_the_user_has_changed_do_not_go(rings, pool):
    make(BAKE, SPHERES)
    (rings.parent / "out/a_spheres.json").write_text("mine")
    make(BAKE, None)
    assert (rings.parent / "out/a_spheres.json").read_text() == "mine"
    assert not (rings.parent / "out/b_spheres.json").exists()


def test_other_files_in_the_folder_do_not_go(made):
    (made / "notes.txt").write_text("mine")
    make(BAKE, None)
    assert (made / "notes.txt").read_text() == "mine"


def test_what_is_made_of_no_mesh_any_more_goes_where_that_is_asked_for(made, rings, pool):
    (rings / "a.obj").unlink()
    assert make() == {"b": "unchanged"}
    assert list(contents(made)) == ["a_spheres.json", "b_spheres.json"]
    assert make(prune=True) == {"b": "unchanged"}
    assert list(contents(made)) == ["b_spheres.json"]
    assert pool.jobs == []


def test_what_the_user_has_changed_is_not_pruned(made, rings):
    (rings / "a.obj").unlink()
    (made / "a_spheres.json").write_text("mine")
    (made / "notes.txt").write_text("mine")
    make(prune=True)
    assert list(contents(made)) == ["a_spheres.json", "b_spheres.json", "notes.txt"]


def test_the_outputs_of_a_failure_are_not_pruned(made, rings):
    before = contents(made)
    (rings / "a.obj").write_text("")
    assert make(prune=True) == {"a": "failed", "b": "unchanged"}
    assert contents(made) == before


@pytest.mark.parametrize("text", ["", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "v 0 0 0\n", None])
def test_a_failure_leaves_earlier_outputs_as_they_were(text, made, rings, pool):
    before = contents(made)
    if text is None:
        (rings / "a.obj").unlink()
    else:
        (rings / "a.obj").write_text(text)
    assert make(patterns=["in/a.obj", "in/b.obj"]) == {"a": "failed", "b": "unchanged"}
    assert contents(made) == before
    assert make(patterns=["in/a.obj", "in/b.obj"]) == {"a": "failed", "b": "unchanged"}
    write_ring(rings / "a.obj")
    assert make() == {"a": "unchanged", "b": "unchanged"}  # it is again what those were made from


def test_an_input_that_changes_under_the_work_is_a_failure(rings, pool, monkeypatch):
    real = pool.run

    def run(jobs):
        for event in real(jobs):
            write_ring(rings / f"{event.job.name}.obj", 0.25)
            yield event

    monkeypatch.setattr(pool, "run", run)
    result = batch("in/a.obj", "out", spheres=SPHERES)
    assert statuses(result) == {"a": "failed"}
    assert "in/a.obj: was changed while it was worked on" in result.results[0].failure.message
    assert contents(rings.parent / "out") == {}


@pytest.mark.parametrize("place", ["out", "out/.aoprecalc", "out/.aoprecalc/lock", "out/.aoprecalc/staging"])
def test_an_output_folder_that_cannot_be_one(place, rings, pool):
    path = rings.parent / place
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.name == "lock":
        path.mkdir()
    else:
        path.write_text("a file")
    message, code = said(make)
    assert code == 1
    assert message.startswith("out: cannot be written (")
    assert pool.jobs == []


def test_a_record_is_read_as_it_was_written(tmp_path):
    records = StateFolder(tmp_path / "out")
    with records.locked():
        assert records.get("props/rock") is None
        stamp = FileStamp(7, OLD, "abcd")
        written = AssetRecord(
            "order", InputFiles({"rock.obj": stamp}), {"rock_spheres.json": stamp}, {"warnings": ["ä"]}
        )
        records.put("props/rock", written)
        assert records.get("props/rock") == written
    assert StateFolder(tmp_path / "out").get("props/rock") == written


@pytest.fixture
def corners(tmp_path, monkeypatch):
    """Two glTF files that have a picture together, in the present folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    for name in ("a", "b"):
        maker = GltfMaker(tmp_path / "in")
        maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker, "wood.png"))))
        maker.save(f"{name}.gltf", f"{name}.bin")
    return tmp_path / "out"


@pytest.mark.parametrize(("one", "other"), ["ab", "ba"])
def test_a_file_of_two_assets_stays_while_one_has_it(one, other, corners, pool):
    assert make(BAKE, None) == {"a": "made", "b": "made"}
    (wood,) = corners.glob("wood*.png")
    assert make(None, SPHERES, patterns=f"in/{one}.gltf") == {one: "made"}
    assert make(BAKE, None, patterns=f"in/{other}.gltf") == {other: "unchanged"}
    assert wood.is_file()
    assert make(None, SPHERES) == {one: "unchanged", other: "made"}
    assert sorted(contents(corners)) == ["a_spheres.json", "b_spheres.json"]


@pytest.mark.parametrize(("one", "other"), ["ab", "ba"])
def test_a_failure_keeps_a_file_that_the_other_asset_has_no_more(one, other, corners, pool):
    make(BAKE, None)
    before = contents(corners)
    (corners.parent / f"in/{other}.gltf").write_text("damaged")
    assert make(None, SPHERES) == {one: "made", other: "failed"}
    kept = {name: data for name, data in before.items() if name.startswith((f"{other}_", "wood"))}
    assert contents(corners).items() >= kept.items()


@pytest.mark.parametrize("cached", [False, True], ids=["", "cache"])
def test_a_file_of_the_users_is_not_replaced(cached, corners, pool):
    """A copy of a picture that would have the name of another file gets another."""
    if cached:
        make(BAKE, None, cache="cache")
        shutil.rmtree(corners)
    corners.mkdir()
    (corners / "wood.png").write_text("mine")
    became = "cached" if cached else "made"
    assert make(BAKE, None, cache="cache") == {"a": became, "b": became}
    assert (corners / "wood.png").read_text() == "mine"
    assert len(list(corners.glob("wood*.png"))) == 2


@pytest.mark.slow
def test_files_of_one_name_are_told_apart_whatever_ends_first(tmp_path):
    """Three documents side by side, each with a picture of the same name in a folder of its own."""
    for number, name in enumerate("abc"):
        (tmp_path / "in" / name).mkdir(parents=True)
        maker = GltfMaker(tmp_path / "in")
        maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker, "wood.png"))))
        maker.json["images"][0]["uri"] = f"{name}/wood.png"
        maker.save(f"{name}.gltf", f"{name}.bin")
        picture = (tmp_path / "in/wood.png").read_bytes()
        (tmp_path / "in" / name / "wood.png").write_bytes(picture + bytes(number))
    folders = [tmp_path / "one by one", tmp_path / "together"]
    for jobs, folder in zip((1, 3), folders, strict=True):
        assert batch(tmp_path / "in", folder, bake=BAKE, options=BatchOptions(jobs=jobs)).passed
    first, second = (without_times(contents(folder)) for folder in folders)
    assert first == second
    assert sum(name.startswith("wood-") for name in first) == 3


def test_a_time_that_all_files_have_hides_no_change(made, rings, pool):
    """Reproducible archives give every file the same one."""
    before = (rings / "a.obj").read_bytes()
    after = before.replace(b"v 1.", b"v 2.", 1)
    assert len(after) == len(before)
    assert after != before
    for data in (before, after):
        (rings / "a.obj").write_bytes(data)
        os.utime(rings / "a.obj", ns=(0, 0))
        became = make()["a"]
    assert became == "made"


def test_an_output_that_is_a_link_is_replaced(made, rings, pool):
    """As a move replaces it; what it led to stays."""
    (rings.parent / "elsewhere.json").write_text("mine")
    (made / "a_spheres.json").unlink()
    (made / "a_spheres.json").symlink_to("../elsewhere.json")
    assert make() == {"a": "made", "b": "unchanged"}
    assert not (made / "a_spheres.json").is_symlink()
    assert (rings.parent / "elsewhere.json").read_text() == "mine"


def test_what_cannot_be_placed_whole_is_not_placed(rings, pool):
    """A folder has the name of the last file."""
    (rings.parent / "out/a_spheres.json/full").mkdir(parents=True)
    assert make(BAKE) == {"a": "failed", "b": "made"}
    assert not [name for name in contents(rings.parent / "out") if name.startswith("a_")]


def test_pruning_reads_each_record_a_few_times_however_many_there_are(rings, pool, monkeypatch):
    for number in range(6):
        write_ring(rings / f"more/{number}.obj", 0.2 + 0.05 * number)
    make()
    reads = []
    real = records_module._read
    monkeypatch.setattr(records_module, "_read", lambda file: reads.append(file.name) or real(file))
    assert make(patterns=["in/a.obj", "in/b.obj"], prune=True) == {"a": "unchanged", "b": "unchanged"}
    assert list(contents(rings.parent / "out")) == ["a_spheres.json", "b_spheres.json"]
    assert max(Counter(reads).values()) <= 4


def test_a_report_does_not_say_where_it_was_made(rings, pool):
    """It names results and the mesh by their way from its own folder, also in warnings."""
    reports = []
    for folder in ("one", "other"):
        assert batch("in/a.obj", folder, bake=BakeOptions(size=64, directions=64, unwrap="xatlas")).passed
        reports.append(without_times(contents(rings.parent / folder))["a_report.json"])
    assert reports[0] == reports[1]
    assert reports[0]["input"]["path"] == "../in/a.obj"
    assert any(line.startswith("a_ao.obj: ") for line in reports[0]["warnings"])
