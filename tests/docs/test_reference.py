"""The reference is complete: what it states by hand agrees with the program."""

import json
import re
from pathlib import Path

import pytest

import aoprecalc
from aoprecalc import errors
from aoprecalc.cli import main
from aoprecalc.io import MESH_EXTENSIONS
from aoprecalc.io.images import BIT_DEPTHS
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS
from docs.pages import ROOT

REFERENCE = ROOT / "docs/reference"
SCHEMAS = Path(aoprecalc.__file__).parent / "schemas"


def text_of(page):
    return (REFERENCE / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("command", main.commands)
def test_every_command_has_a_page_with_its_options(command):
    assert f"```{{command}} {command}\n" in text_of(f"{command}.md")
    assert f"\n{command}\n" in text_of("index.md")


def test_every_public_name_has_its_place_in_the_api():
    documented = [
        name
        for page in (REFERENCE / "python").glob("*.md")
        for name in re.findall(r"\.\. auto\w+:: (\w+)", page.read_text(encoding="utf-8"))
    ]
    assert sorted(documented) == sorted(set(aoprecalc.__all__) - {"__version__"})


def test_exit_codes_are_those_of_the_errors():
    rows = dict(re.findall(r"^\| (\d+) \|.*\| (.*?) ?\|$", text_of("scripts.md"), re.M))
    classes = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert set(rows) == {"0", *(str(kind.exit_code) for kind in classes)}
    for name in aoprecalc.__all__:
        if hasattr(kind := getattr(aoprecalc, name), "exit_code"):
            assert [code for code, names in rows.items() if f"aoprecalc.{name}`" in names] == [str(kind.exit_code)]


def test_every_schema_has_its_tables():
    shown = re.findall(r"```{report} (\w+)", text_of("reports.md"))
    assert sorted([*shown, "manifest"]) == sorted(path.name.split(".")[0] for path in SCHEMAS.glob("*.json"))


def section(page, title):
    return re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", text_of(page), re.M | re.S)[1]


@pytest.mark.parametrize(
    ("title", "part"), [("Top level", None), ("`[[override]]`", "Override"), ("`[[asset]]`", "SingleAsset")]
)
def test_keys_of_manifests_are_all_there(title, part):
    schema = json.loads((SCHEMAS / "manifest.schema.json").read_text(encoding="utf-8"))
    keys = (schema["$defs"][part] if part else schema)["properties"]
    cells = re.findall(r"^\| (`.*?) \|", section("manifest.md", title), re.M)
    assert sorted(re.findall(r"`([\w-]+)`", " ".join(cells))) == sorted(keys)


@pytest.mark.parametrize(
    ("title", "extensions"),
    [
        ("Meshes read", MESH_EXTENSIONS),
        ("Textures", BIT_DEPTHS),
        ("Spheres", SPHERE_EXTENSIONS),
    ],
)
def test_formats_are_all_there(title, extensions):
    cells = re.findall(r"^\| (`.*?) \|", section("formats.md", title), re.M)
    assert set(re.findall(r"`(\.\w+)`", " ".join(cells))) == set(extensions)


def test_bit_depths_are_those_that_are_written():
    rows = re.findall(r"^\| (`\..*?) \| .*? \| (.*?) \|", section("formats.md", "Textures"), re.M)
    stated = {name: tuple(cell.split(", ")) for names, cell in rows for name in re.findall(r"`(\.\w+)`", names)}
    assert stated == BIT_DEPTHS
