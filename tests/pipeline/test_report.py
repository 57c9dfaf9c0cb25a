"""What is told of a batch when it is over: the report and the JUnit file."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from aoprecalc import __version__
from aoprecalc.io.outputs import json_text
from aoprecalc.pipeline.jobs import Asset, Failure, JobSpec
from aoprecalc.pipeline.report import AssetResult, BatchReport, junit
from pipeline.helpers import BAKE, SPHERES

ODD = "ä 日本 <&>\"' \x00\x07\x1b[31m\r\n\t\ud800\ufffe]]> --"
ORDER = JobSpec(BAKE, SPHERES)


def result(name, status, failure=None, warnings=()):
    summary = {"triangles": 2, "warnings": list(warnings)} if failure is None and status != "stopped" else None
    outputs = (f"{name.rpartition('/')[2]}_ao.png",) if summary else ()
    return AssetResult(Asset(name, Path(f"in/{name}.obj"), ORDER), status, outputs, summary, failure, seconds=1.23456)


RESULTS = [
    result("rock", "made", warnings=["is small", "is dark"]),
    result("props/chair", "cached"),
    result("props/old/table", "unchanged"),
    result("broken", "failed", Failure("error", "in/broken.obj: is empty", 4)),
    result("dead", "failed", Failure("crash", "in/dead.obj: its process died (Killed)", details="Traceback:\n  it")),
    result("late", "stopped"),
]


def test_the_report_counts_and_has_every_field():
    reported = BatchReport.of(RESULTS, Path("out"), 12.3456)
    assert (reported.counts.failed, reported.assets[1].name, reported.seconds) == (2, "props/chair", 12.346)
    report = reported.to_dict()
    assert report == json.loads(json_text(report))
    assert {key: value for key, value in report.items() if key != "assets"} == {
        "schema": 1,
        "version": __version__,
        "output": "out",
        "counts": {"made": 1, "unchanged": 1, "cached": 1, "failed": 2, "stopped": 1},
        "seconds": 12.346,
    }
    assert [entry["name"] for entry in report["assets"]] == [entry.asset.name for entry in RESULTS]
    words = "--size 64 --directions 64"
    assert report["assets"][1] == {
        "name": "props/chair",
        "path": "in/props/chair.obj",
        "status": "cached",
        "outputs": ["out/props/chair_ao.png"],
        "summary": {"triangles": 2, "warnings": []},
        "error": None,
        "commands": [
            f"aoprecalc bake {words} in/props/chair.obj",
            "aoprecalc spheres --spheres 8 --samples 500 in/props/chair.obj",
        ],
        "seconds": 1.235,
    }
    assert report["assets"][3]["error"] == {"kind": "error", "message": "in/broken.obj: is empty", "exit_code": 4}
    assert (report["assets"][3]["outputs"], report["assets"][3]["summary"]) == ([], None)


def test_names_that_are_no_text_leave_the_report_legible():
    results = [result("b\udcff", "made", warnings=["b\udcff is small"])]
    text = json_text(BatchReport.of(results, Path("out\udcff"), 0.0).to_dict())
    report = json.loads(text.encode())
    (asset,) = report["assets"]
    assert (report["output"], asset["name"], asset["path"]) == ("out?", "b?", "in/b?.obj")
    assert asset["outputs"] == ["out?/b?_ao.png"]
    assert asset["summary"]["warnings"] == ["b? is small"]


def cases(text):
    """The suite of a JUnit file, and the cases by their names."""
    suites = ElementTree.fromstring(text.encode())
    assert suites.tag == "testsuites"
    (suite,) = suites
    assert set(suites.items()) < set(suite.items())
    return suite, {case.get("name"): case for case in suite}


def test_a_junit_file_has_a_case_for_each_asset():
    suite, found = cases(junit(RESULTS, 12.3456))
    counts = {"tests": "6", "failures": "2", "errors": "0", "skipped": "1", "time": "12.346"}
    assert {key: suite.get(key) for key in counts} == counts
    assert list(found) == ["rock", "chair", "table", "broken", "dead", "late"]
    classes = ["assets", "props", "props.old", "assets", "assets", "assets"]
    assert [case.get("classname") for case in found.values()] == classes
    assert found["chair"].get("file") == "in/props/chair.obj"
    assert found["chair"].get("time") == "1.235"
    assert {name: [child.tag for child in case] for name, case in found.items()} == {
        "rock": ["system-out"],
        "chair": [],
        "table": [],
        "broken": ["failure"],
        "dead": ["failure"],
        "late": ["skipped"],
    }
    assert found["rock"][0].text == "is small\nis dark"
    failure = found["dead"][0]
    assert failure.get("type") == "crash"
    assert failure.get("message") == "in/dead.obj: its process died (Killed)"
    assert failure.text.splitlines()[0].startswith("aoprecalc bake --size 64 ")
    assert failure.text.splitlines()[-2:] == ["Traceback:", "  it"]


def test_a_junit_file_of_nothing_is_one():
    suite, found = cases(junit([], 0.0))
    assert (suite.get("tests"), found) == ("0", {})


@pytest.mark.parametrize("status", ["made", "failed", "stopped"])
def test_odd_characters_leave_xml_well_formed(status):
    failure = Failure("error", ODD, details=ODD) if status == "failed" else None
    text = junit([result(f"{ODD}/{ODD}".replace("\x00", ""), status, failure, [ODD])], 0.0)
    (case,) = cases(text)[0]
    assert case.get("name").startswith("ä 日本 <&>\"' ")
    assert case.get("file").startswith("in/ä 日本 <&>\"' ")
    if status == "failed":
        assert case[0].get("message").startswith("ä 日本 <&>\"' ")
        assert "]]> --" in case[0].text
