"""`aoprecalc report` and `batch --html`: the page, its summary, exit codes, nothing left behind."""

import json
import re

import click
import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc import system
from aoprecalc.api import report_contents
from aoprecalc.render import report_page
from aoprecalc.render.report_page import Budget
from shapes import quad


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    def grey(mesh, spheres, options, progress):
        return [np.full((options.height, options.width, 3), 99, np.uint8)]

    monkeypatch.setattr(report_page, "_BUDGETS", (Budget(1 << 31, 64, 48, 16, 100),))
    monkeypatch.setattr(report_contents, "preview_pictures", grey)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder with `sheet.obj`, and its bake in `build`."""
    folder = tmp_path_factory.mktemp("results")
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 2)
    lines = ["v {} {} {}".format(*row) for row in positions] + ["f {} {} {}".format(*row) for row in faces + 1]
    (folder / "sheet.obj").write_text("\n".join(lines) + "\n")
    result = ao.bake(folder / "sheet.obj", ao.BakeOptions(size=64, directions=64, backend="ray"))
    result.save(f"{folder}/build/", report=folder / "build" / "sheet_report.json")
    return folder


def test_it_writes_a_page_and_says_what_is_on_it(run, results):
    done = run(results, "report", "build", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("report.html  1 asset; ")
    assert "<h1>sheet: ambient occlusion</h1>" in (results / "report.html").read_text(encoding="utf-8")


def test_a_title_and_a_folder_for_the_page(run, results):
    done = run(results, "report", "build/sheet_ao.png", "-o", "pages/", "--title", "Sheets & <more>", "--json")
    found = json.loads(done.stdout)
    assert found["title"] == "Sheets & <more>"
    assert found["assets"] == [{"name": "sheet", "status": "read", "change": None, "warnings": 0}]
    page = results / "pages" / "report.html"
    assert found["bytes"] == page.stat().st_size
    assert "<h1>Sheets &amp; &lt;more&gt;</h1>" in page.read_text(encoding="utf-8")


def test_open_opens_it(run, results, monkeypatch):
    opened = []
    monkeypatch.setattr(system, "has_desktop", lambda: True)
    monkeypatch.setattr(click, "launch", lambda path: opened.append(path) or 0)
    assert run(results, "report", "build", "-o", "shown.html", "--open", "-q").returncode == 0
    assert opened == ["shown.html"]


def test_the_same_run_before_is_no_change(run, results):
    done = run(results, "report", "build", "--before", "build", "-o", "same.html", "-q")
    assert done.stdout.startswith("same.html  1 asset: 1 same; ")


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        ((), 2, "Missing argument"),
        (("nothing.glb",), 4, "there is no such file or folder"),
        (("sheet.obj",), 4, "has no ambient occlusion"),
        (("build", "-o", "page.png"), 2, ".html or a folder was expected"),
        (("build", "-o", "none/page.html"), 1, "there is no folder none"),
        (("build", "--before", "none"), 4, "there is no such file or folder"),
        (("pyproject.toml",), 4, "expected"),
    ],
)
def test_what_cannot_be_is_one_line_and_no_file(run, results, words, code, told):
    (results / "pyproject.toml").write_text("")
    before = {path: path.read_bytes() for path in results.rglob("*") if path.is_file()}
    done = run(results, "report", *words)
    assert done.returncode == code
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    assert told in done.stderr
    assert {path: path.read_bytes() for path in results.rglob("*") if path.is_file()} == before


def test_a_batch_writes_its_page_with_what_failed(run, results):
    (results / "broken.obj").write_text("f 1 2 3\n")
    words = ["-o", "made", "--no-cache", "-j", "1", "--bake", "--size 64 -n 64 --backend ray"]
    done = run(results, "batch", "sheet.obj", "broken.obj", *words, "--html", "made/", "-q")
    (results / "broken.obj").unlink()
    assert done.returncode == 1
    page = (results / "made" / "batch.html").read_text(encoding="utf-8")
    assert re.findall(r'<tr data-asset="[^"]*" data-status="(\w+)"', page) == ["failed", "made"]
    assert "broken.obj" in page
    assert "aoprecalc bake --size 64" in page


def test_a_page_of_a_batch_is_refused_before_the_work(run, results):
    done = run(results, "batch", "sheet.obj", "-o", "never", "--html", "page.obj")
    assert (done.returncode, "--html is 'page.obj'" in done.stderr) == (2, True)
    assert not (results / "never").exists()
