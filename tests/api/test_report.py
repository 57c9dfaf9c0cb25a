"""The report of results: which files belong to one asset, what is told of it, two runs, and inputs that are none."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api import report_contents
from aoprecalc.api.report import write_report
from aoprecalc.api.report_assets import collect_assets
from aoprecalc.api.report_contents import asset_page, read_asset
from aoprecalc.api.report_facts import changes
from aoprecalc.io import read_image, write_image
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.render import report_page
from aoprecalc.render.preview import preview_pictures
from aoprecalc.render.report_page import Budget, web_picture
from aoprecalc.render.view_geometry import viewer_script
from shapes import bowl

SMALL = Budget(1 << 31, 64, 48, 16, 100)


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    """Pictures of few pixels; those of the mesh are grey, but for tests that draw them."""

    def grey(mesh, spheres, options, progress):
        return [np.full((options.height, options.width, 3), 99, np.uint8)]

    monkeypatch.setattr(report_page, "_BUDGETS", (SMALL,))
    monkeypatch.setattr(report_contents, "preview_pictures", grey)


def write_obj(path, shape):
    positions, faces = shape
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*row) for row in positions]
    path.write_text("\n".join([*lines, *("f {} {} {}".format(*row) for row in faces + 1)]) + "\n")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A mesh, `bowl.obj`, and its results in `after` and, of other options, in `before`."""
    folder = tmp_path_factory.mktemp("runs")
    write_obj(folder / "bowl.obj", bowl())
    for name, directions, count in (("before", 64, 5), ("after", 128, 6)):
        result = ao.bake(folder / "bowl.obj", ao.BakeOptions(size=64, directions=directions, ground=name == "before"))
        (folder / name).mkdir()
        result.save(folder / name / "bowl_ao.png", report=folder / name / "bowl_report.json")
        ao.fit_spheres(folder / "bowl.obj", ao.SphereOptions(count, samples=500)).save(f"{folder}/{name}/")
    return folder


@pytest.fixture
def after(runs, tmp_path):
    """A copy of the results, to change."""
    return shutil.copytree(runs / "after", tmp_path / "after")


def only(results):
    (asset,) = collect_assets(results)
    return asset


def names(*paths):
    return [None if path is None else path.name for path in paths]


# Which files belong together.


@pytest.mark.parametrize(
    "given",
    ["", "bowl_ao.obj", "bowl_ao.png", "bowl_report.json"],
)
def test_the_mesh_is_found_from_a_folder_and_from_each_of_its_files(runs, given):
    asset = only(runs / "after" / given)
    assert asset.name == "bowl"
    assert names(asset.mesh, asset.texture)[0] == "bowl_ao.obj"
    assert read_asset(asset).ao.shape == (64, 64)


def test_files_of_one_stem_are_one_asset(runs):
    asset = only(runs / "after")
    assert names(asset.mesh, asset.texture, asset.spheres) == ["bowl_ao.obj", "bowl_ao.png", "bowl_spheres.json"]
    assert asset.bake.directions == 128
    assert asset.others == ()
    together = only([runs / "after" / name for name in ("bowl_spheres.json", "bowl_report.json")])
    assert (together.mesh, together.spheres) == (asset.mesh, asset.spheres)


def test_assets_of_folders_have_names_below_the_one_that_is_given(runs, tmp_path):
    for name in ("a", "b/c"):
        shutil.copytree(runs / "after", tmp_path / name)
    (tmp_path / "b" / "notes.txt").write_text("nothing")
    (tmp_path / "b" / "package.json").write_text('{"name": "other"}')
    (tmp_path / "broken.json").write_text("{")
    assert [asset.name for asset in collect_assets(tmp_path)] == ["a/bowl", "b/c/bowl"]
    (tmp_path / ".hidden").mkdir()
    shutil.copytree(runs / "after", tmp_path / ".hidden" / "d")
    assert len(collect_assets(tmp_path)) == 2


def test_assets_of_one_name_get_distinct_ones(runs):
    found = collect_assets([runs / "after" / "bowl_ao.obj", runs / "before" / "bowl_ao.obj"])
    assert len({asset.name for asset in found}) == 2


def test_a_report_finds_its_files_wherever_the_folder_has_gone(after):
    document = json.loads((after / "bowl_report.json").read_text())
    document["outputs"] |= {"mesh": "/elsewhere/bowl_ao.obj", "texture": "/elsewhere/bowl_ao.png"}
    (after / "bowl_report.json").write_text(json.dumps(document))
    assert names(only(after / "bowl_report.json").mesh) == ["bowl_ao.obj"]


def test_a_verified_texture_has_its_errors_and_its_heat_map(after):
    ao.verify(
        after / "bowl_ao.obj",
        options=ao.VerifyOptions(points=100, rays=64),
        report=after / "checked.json",
        heat_map=after / "bowl_heat_map.png",
    )
    asset = only(after)
    assert asset.verify.points == 100
    page = asset_page(read_asset(asset), SMALL)
    assert page.figure("error").value == asset.verify.error
    assert page.heat_map is not None
    assert {"errors", "worst"} <= {table.key for table in page.tables}
    alone = only([after / "checked.json"])
    assert names(alone.mesh, alone.heat_map) == ["bowl_ao.obj", "bowl_heat_map.png"]


@pytest.mark.parametrize("ending", [".obj", ".glb", ".ply"])
def test_spheres_in_formats_of_meshes_are_known_by_their_ending(runs, tmp_path, ending):
    ao.fit_spheres(runs / "bowl.obj", ao.SphereOptions(2, samples=100)).save(tmp_path / f"bowl_spheres{ending}")
    for given in (tmp_path, tmp_path / f"bowl_spheres{ending}"):
        asset = only(given)
        assert names(asset.mesh, asset.spheres) == [None, f"bowl_spheres{ending}"]


def test_reports_may_be_given_as_they_are(runs, monkeypatch):
    monkeypatch.chdir(runs)
    write_obj(runs / "bad.obj", (np.zeros((3, 3)), np.array([[0, 1, 2]])))
    done = ao.batch(["bowl.obj", "bad.obj"], "made", bake=ao.BakeOptions(size=64, directions=64))
    found = collect_assets(done.report)
    assert [(asset.name, asset.failed) for asset in found] == [("bad", True), ("bowl", False)]
    pages = [asset_page(read_asset(asset), SMALL) for asset in found]
    assert [page.status for page in pages] == ["failed", "made"]
    assert "bad.obj" in pages[0].error
    assert pages[1].commands == ("aoprecalc bake --size 64 --directions 64 bowl.obj",)
    shutil.rmtree("made")


def batch_document(**changes):
    """The report of a batch of one asset, the bowl, as the file in the folder of its results has it."""
    asset = {
        "name": "bowl",
        "path": "bowl.obj",
        "status": "made",
        "outputs": ["made/bowl_ao.obj", "made/bowl_ao.png"],
        "summary": {"mean": 0.8, "warnings": ["charts may mix"]},
        "error": None,
        "commands": [],
        "seconds": 1.0,
    }
    return {"schema": SCHEMAS["batch"], "counts": {}, "output": "made", "assets": [asset | changes]}


def test_a_batch_whose_folder_was_moved_finds_its_files_and_tells_its_warnings(after):
    asset = only(write(after / "batch.json", json.dumps(batch_document())))
    assert names(asset.mesh, asset.texture) == ["bowl_ao.obj", "bowl_ao.png"]
    assert asset_page(read_asset(asset), SMALL).warnings == ("charts may mix",)


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 5000])
def test_names_that_no_file_can_have_are_files_that_are_not_there(after, name):
    document = batch_document(name=name, path=name, outputs=[name]) | {"output": name}
    (asset,) = collect_assets(write(after / "batch.json", json.dumps(document)))
    assert (asset.mesh, asset.texture) == (None, None)
    report = json.loads((after / "bowl_report.json").read_text())
    report["input"]["path"], report["outputs"] = name, report["outputs"] | {"mesh": name, "texture": name}
    write(after / "bowl_report.json", json.dumps(report))
    assert only(after / "bowl_report.json").mesh is None


@pytest.mark.parametrize(
    "changes",
    [{"summary": {"warnings": True}}, {"summary": {"warnings": [1]}}, {"error": "none"}, {"status": "\ud800"}],
)
def test_damaged_reports_of_batches_are_refused(after, changes):
    path = write(after / "batch.json", json.dumps(batch_document(**changes)))
    with pytest.raises(ao.InputError, match="is no whole report"):
        collect_assets(path)


# What is told.


def test_figures_are_those_of_the_files(runs):
    asset = only(runs / "after")
    page = asset_page(read_asset(asset), SMALL)
    values = read_image(asset.texture)
    assert page.figure("triangles").value == len(bowl()[1])
    assert page.figure("texels").text == "64 x 64"
    assert page.figure("mean").value == asset.bake.ao.mean
    assert page.figure("spheres").value == 6
    assert sum(page.histogram.counts) > 0
    assert abs(page.histogram.mean - asset.bake.ao.mean) < 0.03  # by centres of texels, not by all that are covered
    assert values.min() <= page.histogram.median <= 1
    assert [name for name, _ in page.stages] == [name for name in asset.bake.seconds if name != "total"]
    assert {table.key for table in page.tables} == {"parts", "options", "spheres"}


def test_stills_are_previews(runs, monkeypatch):
    monkeypatch.setattr(report_contents, "preview_pictures", preview_pictures)
    asset = only(runs / "after")
    page = asset_page(read_asset(asset), SMALL)
    shown = ao.preview(asset.mesh, ao.PreviewOptions(size=(48, 36))).image
    assert [still.mode for still in page.stills] == ["ao", "spheres"]
    assert page.stills[0].picture.source == web_picture(shown, "", 48).source
    assert page.thumbnail.source == web_picture(shown, "", 16).source


def test_the_command_makes_it_again(runs, tmp_path, monkeypatch, command):
    page = asset_page(read_asset(only(runs / "after")), SMALL)
    monkeypatch.chdir(tmp_path)
    words = page.commands[0].split()
    assert words[:2] == ["aoprecalc", "bake"]
    assert command(*words[1:], "-o", "again.png", "-q").returncode == 0
    again, first = read_image(tmp_path / "again.png"), read_image(runs / "after" / "bowl_ao.png")
    assert np.array_equal(again, first)


def test_what_is_missing_is_told(after):
    (after / "bowl_report.json").unlink()
    shutil.move(after / "bowl_ao.obj", after / "elsewhere.obj")
    page = asset_page(read_asset(only(after / "bowl_ao.png")), SMALL)
    assert any("no mesh" in line for line in page.missing)
    assert any("no report" in line for line in page.missing)
    assert page.layout is None
    assert page.stills == ()


def test_spheres_alone_are_shown_on_the_mesh_beside_them(runs, after):
    asset = only(after / "bowl_spheres.json")
    assert asset.mesh is None
    assert read_asset(asset).quality.silhouette_iou > 0
    both = only([after / "bowl_spheres.json", after / "bowl_ao.obj"])
    assert [still.mode for still in asset_page(read_asset(both), SMALL).stills] == ["ao", "spheres"]


# Two runs.


def test_differences_are_those_that_compare_measures(runs):
    before, after = only(runs / "before"), only(runs / "after")
    change, comparison = changes(
        before, asset_page(read_asset(before), SMALL), after, asset_page(read_asset(after), SMALL)
    )
    assert change == "changed"
    measured = ao.compare(before.mesh, after.mesh).details
    rows = dict(next(table for table in comparison.tables if table.key == "differences").rows)
    assert float(rows["Root mean square of after - before"]) == measured["texture"]["surface"]["rms"]
    assert float(rows["Visible difference (FLIP), 0 to 1"]) == measured["texture"]["surface"]["flip"]
    assert float(rows["Greatest move of a UV"]) == measured["uv"]
    tables = {table.key: table.rows for table in comparison.tables}
    assert ("--ground", "yes", "no") in tables["changed-options"]
    assert ("Spheres", "5", "6", "+1") in tables["before"]
    assert {slider.label for slider in comparison.sliders} == {"Mesh", "Texture", "Spheres"}


def test_a_run_compared_with_itself_is_the_same(runs):
    asset = only(runs / "after")
    page = asset_page(read_asset(asset), SMALL)
    change, comparison = changes(asset, page, asset, page)
    assert change == "same"
    assert "equal" in comparison.answer
    assert "changed-options" not in {table.key for table in comparison.tables}


@pytest.mark.parametrize(("status", "change"), [("unchanged", "same"), ("cached", "same"), ("stopped", "changed")])
def test_how_a_batch_came_by_a_file_is_no_change(after, status, change):
    before, again = (
        only(write(after / f"{given}.json", json.dumps(batch_document(status=given)))) for given in ("made", status)
    )
    found, comparison = changes(
        before, asset_page(read_asset(before), SMALL), again, asset_page(read_asset(again), SMALL)
    )
    assert (found, "It was made before" in comparison.answer) == (change, change == "changed")


def test_what_only_one_run_has_is_added_or_removed(runs, tmp_path):
    for folder, name in (("one", "new"), ("one", "both"), ("two", "both"), ("two", "old")):
        shutil.copytree(runs / "after", tmp_path / folder / name)
    written = write_report(tmp_path / "one", tmp_path / "page.html", before=tmp_path / "two")
    assert {asset.name: asset.change for asset in written.assets} == {
        "new/bowl": "added",
        "both/bowl": "same",
        "old/bowl": "removed",
    }
    assert written.assets[-1].name == "both/bowl"


def test_two_files_are_compared_whatever_their_names(runs, tmp_path):
    shutil.copy(runs / "before" / "bowl_ao.png", tmp_path / "other_ao.png")
    written = write_report(runs / "after" / "bowl_ao.png", tmp_path / "p.html", before=tmp_path / "other_ao.png")
    assert [asset.change for asset in written.assets] == ["changed"]


@pytest.mark.parametrize(("triangles", "shown"), [(10_000, True), (10, False)])
def test_without_the_simplifier_large_meshes_have_still_pictures_and_the_page_says_why(
    triangles, shown, runs, monkeypatch
):
    monkeypatch.setitem(sys.modules, "opengl_decimate", None)
    page = asset_page(read_asset(only(runs / "after")), replace(SMALL, triangles=triangles), interactive=True)
    assert (page.view is not None) == shown
    told = "Still pictures: opengl_decimate, which simplifies meshes for the 3D view, is not installed."
    assert page.view_note == ("" if shown else told)
    assert page.stills


@pytest.mark.parametrize("text", ["{", "[]", '{"unwrap": 1, "texels": 2}', '{"unwrap": 1, "texels": 2, "schema": -1}'])
def test_a_damaged_report_in_a_folder_costs_no_other_asset(after, tmp_path, text):
    write(after / "bowl_report.json", text)
    with pytest.raises(ao.InputError, match=r"bowl_report\.json"):
        collect_assets(after / "bowl_report.json")
    listed = batch_document(outputs=[f"{after}/bowl_ao.obj", f"{after}/bowl_ao.png", f"{after}/bowl_report.json"])
    for results in (after, write(tmp_path / "batch.json", json.dumps(listed | {"output": str(after)}))):
        written = write_report(results, tmp_path / "p.html")
        assert [(asset.name, asset.status) for asset in written.assets] == [("bowl", "unreadable")]
        assert "bowl_report.json" in written.path.read_text()


# The file.


def test_the_page_is_the_same_each_time_and_small(runs, tmp_path):
    first = write_report(runs / "after", tmp_path / "a.html")
    again = write_report(runs / "after", tmp_path / "b.html")
    assert first.path.read_bytes() == again.path.read_bytes()
    assert first.bytes == first.path.stat().st_size < len(viewer_script() or "") + 100_000
    assert first.interactive == (viewer_script() is not None)


def test_a_file_in_a_folder_that_cannot_be_read_is_told_on_the_page(after, tmp_path):
    (after / "bowl_ao.obj").write_text("f 1 2 3\n")
    written = write_report(after, tmp_path / "p.html")
    assert [asset.status for asset in written.assets] == ["unreadable"]
    with pytest.raises(ao.InputError, match=r"bowl_ao\.obj"):
        write_report(after / "bowl_ao.obj", tmp_path / "q.html")
    assert not (tmp_path / "q.html").exists()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda folder: folder / "none.glb", "there is no such file or folder"),
        (lambda folder: folder, r"has no results among 0 files"),
        (lambda folder: write(folder / "a.txt", "x"), r"has the extension \.txt"),
        (lambda folder: write(folder / "a.json", "{"), "is not JSON"),
        (lambda folder: write(folder / "a.json", "[]"), "holds no JSON object"),
        (lambda folder: write(folder / "a.json", '{"schema": 1}'), "is a JSON document of another kind"),
        (lambda folder: write(folder / "a.json", '{"unwrap": 1, "texels": 1, "schema": 99}'), "has the schema 99"),
        (lambda folder: write(folder / "a.json", '{"unwrap": 1, "texels": 1, "schema": 1}'), "is no whole report"),
        (lambda folder: write(folder / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "has no ambient occlusion"),
        (lambda folder: write(folder / "a.png", "not a picture"), "cannot be read as an image"),
        (lambda folder: write(folder / "s.csv", "x,y\n1,2\n"), r"s\.csv"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(make, told, tmp_path):
    (tmp_path / "in").mkdir()
    with pytest.raises(ao.InputError, match=told) as raised:
        write_report(make(tmp_path / "in"), tmp_path / "page.html")
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "page.html").exists()


def write(path, text):
    path.write_text(text)
    return path


def test_a_folder_without_results_is_refused_wherever_it_stands(runs, tmp_path):
    (tmp_path / "empty").mkdir()
    for given in ([runs / "after", tmp_path / "empty"], [tmp_path / "empty", runs / "after"]):
        with pytest.raises(ao.InputError, match="has no results among 0 files"):
            write_report(given, tmp_path / "page.html")
    again = write_report([runs / "after", runs / "after"], tmp_path / "page.html")
    assert [asset.name for asset in again.assets] == ["bowl"]


def test_a_folder_of_meshes_that_nobody_baked_has_no_results(runs, tmp_path):
    shutil.copy(runs / "bowl.obj", tmp_path)
    with pytest.raises(ao.InputError, match="none of 1 mesh has ambient occlusion"):
        write_report(tmp_path, tmp_path / "page.html")


def test_a_texture_of_colours_or_of_another_shape_does_not_stop_the_page(after, tmp_path):
    write_image(after / "bowl_ao.png", np.full((16, 32), 0.5, np.float32))
    assert write_report(after, tmp_path / "p.html").assets[0].status == "read"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (([],), "results is empty"),
        (([3],), "results has a value of type int"),
        (("x", "page.png"), "has the extension .png"),
    ],
)
def test_wrong_arguments_are_named(arguments, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ao.UsageError, match=told):
        write_report(*arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_cannot_be_written(runs, tmp_path):
    with pytest.raises(ao.OutputError, match="there is no folder"):
        write_report(runs / "after", tmp_path / "none" / "page.html")
