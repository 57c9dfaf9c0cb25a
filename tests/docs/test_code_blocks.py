"""All code on the pages of the documentation is right: it runs, or at least a reader of its language takes it."""

import json
import re
import shutil
import subprocess
import sys

import pytest
import trimesh
import yaml

from aoprecalc.cli import main
from aoprecalc.pipeline.manifest import read_manifest
from docs.pages import blocks, blocks_of, pages
from docs.scratch import environment, furnish

RUN = ("sh", "python", "toml")
READ = ("console", "json", "yaml", "glsl", "js")
SHOWN = ("text", "cpp", "csharp", "gdscript", "hlsl", "html", "dockerfile", "makefile", "bat", "powershell")
QUICK = ("docs/reference/cache.md",)  # of the pages that run something; the others bake
MADE = re.compile(r"# (?:->|writes) (.*)")
FILE = re.compile(r"[\w./-]+\.(?:png|exr|obj|ply|glb|gltf|json|csv|npz|urdf|usda|yml|html)\b")


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """The present folder, with what pages find there; the commands are on the path."""
    furnish(tmp_path)
    monkeypatch.chdir(tmp_path)
    for name, value in environment(tmp_path).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(trimesh.Trimesh, "show", lambda mesh, **_: None)  # opens a window
    return tmp_path


def run_shell(block):
    done = subprocess.run(["bash", "-e", "-o", "pipefail", "-c", block.text], capture_output=True, text=True)
    assert done.returncode == 0, f"{block.where}: exit code {done.returncode}\n{done.stdout}{done.stderr}"


def by_block(*languages):
    return pytest.mark.parametrize("block", blocks(*languages), ids=lambda block: block.where)


@pytest.mark.parametrize("page", pages())
def test_every_block_says_its_language(page):
    for block in blocks_of(page):
        assert block.language in RUN + READ + SHOWN, f"{block.where}: one of {RUN + READ + SHOWN} was expected"


def runs(page):
    return [block for block in blocks_of(page) if block.language in RUN]


@pytest.mark.parametrize(
    "page", [pytest.param(it, marks=[] if it in QUICK else pytest.mark.slow) for it in pages() if runs(it)]
)
def test_what_a_page_says_can_be_done(page, scratch):
    """Its blocks are run from top to bottom, as a reader would, in one folder and one Python."""
    names = {"__name__": "__main__"}
    for block in blocks_of(page):
        if block.name:
            (scratch / block.name).parent.mkdir(parents=True, exist_ok=True)
            (scratch / block.name).write_text(block.text)
        if block.language == "toml":
            (scratch / (block.name or "aoprecalc.toml")).write_text(block.text)
        elif block.language == "sh":
            run_shell(block)
        elif block.language == "python":
            exec(compile("\n" * (block.line - 1) + block.text, block.page, "exec"), names)
        if block.language in ("sh", "python"):
            for line in MADE.findall(block.text):
                for file in FILE.findall(line):
                    assert (scratch / file).exists(), f"{block.where}: {file} was not written"


def commands_in(block):
    """The command lines of a console block: those after a `$`, or all where no line has one."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line[2:] for line in lines if line.startswith("$ ")] or lines


@pytest.mark.skipif(sys.platform == "win32" or shutil.which("bash") is None, reason="bash is not installed")
@by_block("console")
def test_console_lines_are_shell(block):
    lines = commands_in(block)
    checked = subprocess.run([shutil.which("bash"), "-n"], input="\n".join(lines), capture_output=True, text=True)
    assert checked.returncode == 0, f"{block.where}: {checked.stderr}"


@by_block("sh", "console")
def test_options_exist(block):
    """Every `aoprecalc COMMAND` has the options that a line gives it."""
    for line in commands_in(block):
        for command, rest in re.findall(r"(?:^|[\s/;&|])aoprecalc (\w+)([^;&|#]*)", line):
            assert command in main.commands, block.where
            parsed = [main.commands[command], *getattr(main.commands[command], "commands", {}).values()]
            known = {name for one in parsed for entry in one.params for name in entry.opts + entry.secondary_opts}
            outside_quotes = re.sub(r"'[^']*'|\"[^\"]*\"", "", rest)
            for name in re.findall(r"(?<=\s)--?[a-zA-Z][a-z-]*", outside_quotes):
                assert name in known | {"--help", "-h"}, f"{block.where}: aoprecalc {command} has no {name}"


@by_block("toml")
def test_manifests_find_their_meshes(block, scratch):
    path = scratch / "aoprecalc.toml"
    path.write_text(block.text)
    assert read_manifest(path).assets_of(lambda _: False), block.where


@by_block("json")
def test_json_is_json(block):
    json.loads(block.text)


@by_block("yaml")
def test_yaml_is_yaml(block):
    assert yaml.safe_load(block.text) is not None, block.where


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@by_block("js")
def test_javascript_is_javascript(block, tmp_path):
    (tmp_path / "block.mjs").write_text(block.text)
    checked = subprocess.run(["node", "--check", tmp_path / "block.mjs"], capture_output=True, text=True)
    assert checked.returncode == 0, f"{block.where}: {checked.stderr}"


@by_block("glsl")
def test_shaders_compile(block, renderer):
    """Whole shaders, or functions for one."""
    text = block.text if "#version" in block.text else f"#version 430\n{block.text}"
    text += "" if re.search(r"\bvoid main\b", text) else "void main() {}\n"
    renderer.context.program(vertex_shader="#version 430\nvoid main() {}\n", fragment_shader=text)
