"""The directives `report` and `manifest`: tables of keys, from the JSON Schemas that ship with the package."""

import json
import re
from importlib.resources import files
from itertools import groupby
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.options.fields import OptionField, option_fields

Schema = dict[str, Any]
OPTION = r"(?<![`\w])--[a-z][a-z-]*"


def read(name: str) -> Schema:
    """Return a schema of the package."""
    schema: Schema = json.loads((files("aoprecalc") / f"schemas/{name}.schema.json").read_text(encoding="utf-8"))
    return schema


def type_text(value: Schema) -> str:
    """Return the type of a value in words, with a link to the table of an object that has one."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "enum" in value:
        return ", ".join(dict.fromkeys(f"`{choice}`" for choice in value["enum"] if choice != ""))
    if "anyOf" in value:
        first, *others = value["anyOf"]
        if [entry.get("items") for entry in others] == [first]:
            return f"{type_text(first)}, or a list of them"
        return " or ".join(type_text(choice) for choice in value["anyOf"])
    if value.get("type") == "array":
        if "prefixItems" in value:
            return f"[{', '.join(type_text(entry) for entry in value['prefixItems'])}]"
        return f"list of {type_text(value.get('items', {}))}"
    if isinstance(value.get("additionalProperties"), dict):
        return f"object of {type_text(value['additionalProperties'])}"
    return str(value.get("type", "any"))


def meaning(value: Schema) -> str:
    """Return what is said about a key; what is said of several in one begins with their names, which are left out."""
    return re.sub(r"^\w+(?:(?:, | to )\w+)+: ", "", value.get("description", ""))


def table(definition: Schema) -> str:
    """Return the table of an object's keys, in Markdown; neighbours of which the same is said share a row."""
    if not definition["properties"]:
        return "It has no keys.\n"
    required, rows = definition.get("required", []), []
    entries = [
        (name, type_text(value) + ("" if name in required else ", may be absent"), meaning(value))
        for name, value in definition["properties"].items()
    ]
    described = any(said for _, _, said in entries)
    for (kind, said, _), group in groupby(entries, key=lambda entry: (*entry[1:], "" if entry[2] else entry[0])):
        names = ", ".join(f"`{name}`" for name, _, _ in group)
        rows.append(f"| {names} | {kind} | {_in_code(said)} |" if described else f"| {names} | {kind} |")
    head = ["| key | type | meaning |", "|---|---|---|"] if described else ["| key | type |", "|---|---|"]
    return "\n".join([*head, *rows, ""])


def report(name: str, shown: set[str]) -> str:
    """Return all tables of a document, in Markdown, except for those of parts that are shown above."""
    schema = read(name)
    link = f"{{download}}`{name}.schema.json </../src/aoprecalc/schemas/{name}.schema.json>`"
    texts = [f"{_in_code(schema['description'])} Schema: {link}\n\n{table(schema)}"]
    for part, definition in schema.get("$defs", {}).items():
        if part not in shown:
            texts.append(f"({part.lower()})=\n**{part}**: {_in_code(definition['description'])}\n\n{table(definition)}")
    shown.update(schema.get("$defs", {}))
    return "\n".join(texts)


def _in_code(text: str) -> str:
    return re.sub(OPTION, r"`\g<0>`", text.replace("|", "\\|"))


# Manifests.


TABLES = {"bake": ("BakeTable", BakeOptions), "spheres": ("SphereTable", SphereOptions)}  # schema and options of each
# Keys that no options class has.
OTHER_KEYS = {
    "output": "What is written, by its extension; of a list, each.",
    "verify": "Measure the texture against ray tracing, for the report.",
    "bent-normals": "Write a picture of bent normals of this kind as well.",
    "sh": "Write a picture of spherical harmonics, the AO and the visibility vector, of this kind as well.",
}


def keys(table_name: str) -> str:
    """Return the table of the keys of `[bake]` or `[spheres]`, in Markdown; what they mean is said with the options."""
    name, kind = TABLES[table_name]
    definition, rows = read("manifest")["$defs"][name], []
    options = {field.name: field for field in option_fields(kind) if field.on_command_line}
    for key, value in definition["properties"].items():
        field = options.get(key.replace("-", "_"))
        link = f"{{option}}`{key} <aoprecalc {table_name} --{key}>`"
        text = _in_code(f"{field.option.help}{_default(field)}") if field else OTHER_KEYS[key]
        rows.append(f"| {link} | {_value(field, value)} | {text} |")
    return "\n".join(["| key | value | meaning |", "|---|---|---|", *rows, ""])


def _default(field: OptionField) -> str:
    """Return what holds where the key is missing, as a sentence."""
    option, value = field.option, field.default
    written = option.quantity.write(value) if option.quantity and value not in (None, ()) else value
    text = option.default_text or ("" if written in (None, False, ()) else f"`{written}`")
    return f" Default: {text}." if text else ""


def _value(field: OptionField | None, value: Schema) -> str:
    if field is not None and field.option.quantity is not None:
        plain = " or ".join(dict.fromkeys(type_text(choice) for choice in value.get("anyOf", [value])))
        return f"{plain}: {field.option.quantity.expected}"
    return type_text(value)


class _MarkdownDirective(SphinxDirective):
    """Replaced by Markdown that is made of its argument."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the nodes."""
        return self.parse_text_to_nodes(self.text(self.arguments[0]), allow_section_headings=True)

    def text(self, name: str) -> str:
        """Return the Markdown."""
        raise NotImplementedError


class ReportDirective(_MarkdownDirective):
    """`{report} bake` is replaced by the tables of that report."""

    def text(self, name: str) -> str:
        """Return the Markdown."""
        return report(name, self.env.temp_data.setdefault("parts of reports", set()))


class ManifestDirective(_MarkdownDirective):
    """`{manifest} bake` is replaced by the keys of that table of manifests."""

    def text(self, name: str) -> str:
        """Return the Markdown."""
        return keys(name)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive("report", ReportDirective)
    app.add_directive("manifest", ManifestDirective)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
