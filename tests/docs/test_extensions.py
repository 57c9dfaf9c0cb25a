"""What the extensions of the site make of options, schemas and docstrings; `make docs` shows it."""

import re

import click
import pytest

pytest.importorskip("sphinx", reason="the extra docs is not installed, see make docs")

from docs.extensions.commands import described
from docs.extensions.names import public_name
from docs.extensions.schemas import keys, read, report, table, type_text

from aoprecalc.cli import main


def leaves(command, program):
    """A command, or those of a group, by what one types."""
    inner = getattr(command, "commands", None)
    if inner is None:
        return {program: command}
    return {name: leaf for key in inner for name, leaf in leaves(inner[key], f"{program} {key}").items()}


LEAVES = {name: leaf for key in main.commands for name, leaf in leaves(main.commands[key], f"aoprecalc {key}").items()}


@pytest.mark.parametrize("program", LEAVES)
def test_every_option_is_described_once(program):
    text = "\n".join(described(LEAVES[program], program))
    assert text.startswith(f"```text\n{program} ")
    options = [entry for entry in LEAVES[program].params if isinstance(entry, click.Option)]
    heads = re.findall(r"^```{option} (.*)$", text, re.M)
    assert sorted(re.findall(r"(?<!\S)--?[a-z][a-z-]*", " ".join(heads))) == sorted(
        name for entry in options for name in (*entry.opts, *entry.secondary_opts)
    )
    choices = ["|".join(entry.type.choices) for entry in options if isinstance(entry.type, click.Choice)]
    assert {head.split()[-1] for head in heads} >= set(choices)


def test_defaults_are_told():
    text = "\n".join(described(main.commands["bake"], "aoprecalc bake"))
    assert "```{option} --padding N\n" in text
    assert "From 0 to 256. Default: `8`.\n" in text
    assert "Default: never stop early.\n" in text  # in words, where the value says nothing
    assert "once the estimated sampling error" in text


@pytest.mark.parametrize(
    "name", ["bake", "spheres", "preview", "verify", "compare", "batch", "doctor", "measure", "cache"]
)
def test_reports_show_every_key(name):
    schema = read(name)
    text = report(name, set())
    for definition in (schema, *schema.get("$defs", {}).values()):
        for key in definition["properties"]:
            assert f"`{key}`" in text


def test_a_part_is_shown_once_on_a_page():
    shown = set()
    first, second = report("spheres", shown), report("measure", shown)
    assert "(spherequality)=" in first
    assert "(spherequality)=" not in second
    assert "[SphereQuality](#spherequality)" in second


def test_neighbours_of_which_the_same_is_said_share_a_row():
    value = {"type": "number", "description": "a, b: of both"}
    lone = {"type": "number", "description": "of one | or another"}
    made = table({"properties": {"a": value, "b": value, "c": lone}, "required": ["a", "b"]})
    assert made.splitlines()[2:] == [
        "| `a`, `b` | number | of both |",
        "| `c` | number, may be absent | of one \\| or another |",
    ]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"type": "array", "items": {"$ref": "#/$defs/Part"}}, "list of [Part](#part)"),
        ({"anyOf": [{"type": "integer"}, {"type": "null"}]}, "integer or null"),
        ({"enum": ["", ".glb", ".obj"]}, "`.glb`, `.obj`"),
        ({"type": "object", "additionalProperties": {"type": "number"}}, "object of number"),
        ({"type": "array", "prefixItems": [{"type": "number"}] * 2, "items": False}, "[number, number]"),
        ({"const": 1}, "`1`"),
        ({"anyOf": [{"enum": [1, 2]}, {"type": "array", "items": {"enum": [1, 2]}}]}, "`1`, `2`, or a list of them"),
    ],
)
def test_types_are_told_in_words(value, words):
    assert type_text(value) == words


@pytest.mark.parametrize("name", ["bake", "spheres"])
def test_keys_of_manifests_lead_to_their_options(name):
    made = keys(name)
    linked = re.findall(rf"{{option}}`([\w-]+) <aoprecalc {name} (--[\w-]+)>`", made)
    assert len(linked) == len(made.splitlines()) - 2
    known = {option for entry in main.commands[name].params for option in entry.opts}
    assert {option for _, option in linked} <= known
    assert ("seed", "--seed") in linked


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("bake", "aoprecalc.bake"),
        ("BakeResult.save", "aoprecalc.BakeResult.save"),
        ("BakeOptions.normals", "aoprecalc.BakeOptions"),
        ("doctor()", "aoprecalc.doctor"),
        ("size", None),
        ("types.UvCheck", None),
    ],
)
def test_public_names_are_links(text, target):
    assert public_name(text) == target
