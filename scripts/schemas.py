"""Write the JSON Schemas of all documents, and of manifests, to `src/aoprecalc/schemas`.

python scripts/schemas.py     after a change of a report class, or of an option of manifests
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from inspect import cleandoc
from pathlib import Path
from typing import Any, Literal, get_args, get_type_hints

import msgspec

from aoprecalc.api.compare import CompareReport
from aoprecalc.api.doctor import DoctorReport
from aoprecalc.api.documents import OMIT_NONE, Document, Report
from aoprecalc.api.preview import PreviewReport
from aoprecalc.api.report import PageReport
from aoprecalc.api.reports import BakeReport
from aoprecalc.api.sphere_quality import SphereQuality
from aoprecalc.api.verify_report import VerifyReport
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import BakeOptions, Method, Radius, SphereOptions
from aoprecalc.options.fields import OptionField, description, option_fields
from aoprecalc.pipeline.manifest import ManifestFile
from aoprecalc.pipeline.report import BatchReport
from aoprecalc.pipeline.store import CacheReport

FOLDER = Path(__file__).parent.parent / "src" / "aoprecalc" / "schemas"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
ADDRESS = "https://raw.githubusercontent.com/aoprecalc/aoprecalc/main/src/aoprecalc/schemas"
Schema = dict[str, Any]

# Sphere sets are laid out by `io/sphere_files/tables.py`, one sphere a line; these classes state what is in them.


@dataclass(frozen=True)
class Sphere(Report):
    """A sphere, in the mesh's coordinates and units.

    parent   index of a sphere of the next coarser level, in a set with levels
    """

    center: tuple[float, float, float]
    radius: float
    parent: int | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class SphereLevel(Report):
    """A coarser level of a set."""

    spheres: tuple[Sphere, ...]


@dataclass(frozen=True)
class SphereSetFile(Report):
    """Spheres that stand in for a mesh: what `aoprecalc spheres` writes to a .json file and prints with --json.

    Attributes
    ----------
    spheres : tuple of Sphere
        At least one.
    method, radius_rule, samples, seed
        As in `SphereOptions`; the radius rule is "own" where the method chooses radii (shadow, collision).
    iterations : int
        Pairings of the samples with the spheres, or steps of the optimiser.
    converged : bool
        The last iteration changed no pairing; always true for shadow and collision.
    quality : SphereQuality
    guarded : int
        How often a guard replaced the least-squares sphere (algebraic).
    levels : tuple of SphereLevel
        The coarser levels, the coarsest first.
    """

    schema: int = field(default=SCHEMAS["spheres"], kw_only=True)
    spheres: tuple[Sphere, ...]
    method: Method
    radius_rule: Literal[Radius, "own"]
    samples: int
    seed: int
    iterations: int
    converged: bool
    quality: SphereQuality
    guarded: int | None = field(default=None, metadata=OMIT_NONE)
    levels: tuple[SphereLevel, ...] | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class SphereMeasurement(Report):
    """How well given spheres stand in for a mesh: what `aoprecalc spheres --measure` prints with --json.

    spheres   their number
    """

    schema: int = field(default=SCHEMAS["spheres"], kw_only=True)
    spheres: int
    quality: SphereQuality


# Members whose classes are wider, as what is in them depends on the case: what that may be.

_GIVEN = {"given": "sometimes"}  # metadata of a field that the member may lack


@dataclass(frozen=True)
class TexelDifferences(Report):
    """Differences B - A over some texels.

    texels           how many
    rms, bias, max   root mean square, mean and greatest
    share            share of them beyond 2/255
    flip             mean difference that an eye sees, 0 to 1
    """

    texels: int
    rms: float
    bias: float
    max: float
    share: float
    flip: float


@dataclass(frozen=True)
class TextureDetails(Report):
    """Two textures of one size.

    channel   the one that differs most, from 0
    surface   over the texels that the surface covers; None where no mesh is known
    picture   over all texels
    """

    width: int
    height: int
    channel: int
    surface: TexelDifferences | None
    picture: TexelDifferences


@dataclass(frozen=True)
class MeshDetails(Report):
    """Two meshes of as many triangles.

    position      greatest distance, over the diagonal of the bounding box
    uv, normal    greatest distance of UVs, and length of the difference of normals; None where there are none
    texture       None where there is none
    """

    triangles: int
    position: float
    uv: float | None
    normal: float | None
    texture: TextureDetails | None


@dataclass(frozen=True)
class SphereDetails(Report):
    """Two sphere sets of as many spheres.

    spheres          how many in each level
    center, radius   greatest parts of the difference, over the diagonal
    """

    spheres: tuple[int, ...]
    center: float
    radius: float


@dataclass(frozen=True)
class SphereCounts(Report):
    """Two sphere sets of different numbers of spheres.

    spheres   how many in each level of A, and of B
    """

    spheres: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Place(Report):
    """A place where two documents differ.

    at     its path
    a, b   the values; a text for what is long, None for what is missing
    """

    at: str
    a: bool | float | str | None
    b: bool | float | str | None


@dataclass(frozen=True)
class ReportDetails(Report):
    """Two reports.

    numbers     how many were compared
    differing   places
    value       the greatest difference of numbers
    places      the first ten
    """

    numbers: int
    differing: int
    value: float
    places: tuple[Place, ...]


@dataclass(frozen=True)
class NoDetails(Report):
    """Two results that no number can compare."""


@dataclass(frozen=True)
class AssetSummary(Report):
    """What was made of an asset, as far as it was asked for.

    size       width and height of the texture
    unwrap     keep, xatlas or uvunwrap
    rmse       RMS error against ray tracing; None where it was not verified
    spheres    their number
    """

    triangles: int = field(metadata=_GIVEN)
    ao_mean: float = field(metadata=_GIVEN)
    directions: int = field(metadata=_GIVEN)
    size: tuple[int, int] = field(metadata=_GIVEN)
    renderer: str = field(metadata=_GIVEN)
    unwrap: str = field(metadata=_GIVEN)
    rmse: float | None = field(metadata=_GIVEN)
    spheres: int = field(metadata=_GIVEN)
    silhouette_iou: float = field(metadata=_GIVEN)
    warnings: tuple[str, ...]


CASES: dict[tuple[str, str], tuple[type[Report], ...]] = {
    ("CompareReport", "details"): (
        TextureDetails, MeshDetails, SphereDetails, SphereCounts, ReportDetails, NoDetails,
    ),
    ("AssetReport", "summary"): (AssetSummary,),
}  # fmt: skip

DOCUMENTS: dict[str, tuple[type[Report], str]] = {
    "bake": (BakeReport, "Report of aoprecalc bake"),
    "batch": (BatchReport, "Report of aoprecalc batch"),
    "cache": (CacheReport, "Output of aoprecalc cache --json"),
    "compare": (CompareReport, "Report of aoprecalc compare"),
    "doctor": (DoctorReport, "Output of aoprecalc doctor --json"),
    "preview": (PreviewReport, "Output of aoprecalc preview --json"),
    "report": (PageReport, "Output of aoprecalc report --json"),
    "spheres": (SphereSetFile, "Sphere set of aoprecalc spheres"),
    "measure": (SphereMeasurement, "Output of aoprecalc spheres --measure --json"),
    "verify": (VerifyReport, "Report of aoprecalc verify"),
}


def schemas() -> dict[str, str]:
    """Return the text of each schema by its file name."""
    found = {name: document_schema(*stated) for name, stated in DOCUMENTS.items()} | {"manifest": manifest_schema()}
    heads = {
        name: {"$schema": DIALECT, "$id": f"{ADDRESS}/{name}.schema.json", "title": schema.pop("title")}
        for name, schema in found.items()
    }
    return {f"{name}.schema.json": json.dumps(heads[name] | found[name], indent=2) + "\n" for name in found}


# Documents.


def document_schema(kind: type[Report], title: str) -> Schema:
    """Return the schema of the document of a report class."""
    definitions = _definitions(kind)
    for (owner, member), cases in CASES.items():
        if owner in definitions:
            for case in cases:
                definitions |= _definitions(case)
            value = definitions[owner]["properties"][member]
            null = [choice for choice in value.pop("anyOf", []) if choice == {"type": "null"}]
            value.pop("type", None)
            value |= {"anyOf": [*({"$ref": f"#/$defs/{case.__name__}"} for case in cases), *null]}
    return {**definitions.pop(kind.__name__), "title": title, **({"$defs": definitions} if definitions else {})}


def _definitions(kind: type[Report]) -> dict[str, Schema]:
    """Return the schemas of a report class and of those that its fields are made of, by their names."""
    definitions: dict[str, Schema] = msgspec.json.schema(kind)["$defs"]
    for name, definition in definitions.items():
        _as_written(definition, next(entry for entry in _classes(kind) if entry.__name__ == name))
    return definitions


def _as_written(definition: Schema, kind: type) -> None:
    """Let the schema of a class say what `Report.to_dict` makes of it."""
    given, texts, properties, required = definition["properties"], _texts(kind), {}, []
    for entry in fields(kind):
        name, value = entry.metadata.get("key", entry.name), given[entry.name]
        value.pop("default", None)
        if entry.metadata.get("omit_none"):
            value = next(choice for choice in value["anyOf"] if choice != {"type": "null"})
        elif entry.metadata != _GIVEN:
            required.append(name)
        if name == "schema":
            value = {"const": entry.default}
        properties[name] = value | ({"description": texts[entry.name]} if entry.name in texts else {})
    definition.pop("title")
    definition["description"] = _sentence(" ".join(cleandoc(kind.__doc__ or "").partition("\n\n")[0].split()))
    definition |= {"properties": properties, "required": required, "additionalProperties": False}


def _classes(kind: Any) -> Iterator[type]:
    """Yield a report class and those that its fields are made of."""
    if is_dataclass(kind) and isinstance(kind, type):
        yield kind
        for hint in get_type_hints(kind).values():
            yield from _classes(hint)
    for part in get_args(kind):
        yield from _classes(part)


def _texts(kind: type) -> dict[str, str]:
    """Return what a class's docstring says of each field: "name : type" with lines below, or "name   text"."""
    texts: dict[str, list[str]] = {"schema": ["Number of this schema."]}
    if issubclass(kind, Document):
        texts["version"] = ["Version of aoprecalc."]
    names: list[str] = []
    attributes = "\nAttributes\n---" in cleandoc(kind.__doc__ or "")
    head = r"([\w, ]+?)(?: : .*)?()$" if attributes else r"(\w+(?:(?:, | to )\w+)*)\s{2,}(\S.*)$"
    for line in cleandoc(kind.__doc__ or "").splitlines()[1:]:
        if not line.startswith(" ") and (found := re.match(head, line)):
            names = _listed(found[1], [entry.name for entry in fields(kind)])
            group = f"{found[1]}:" if len(names) > 1 else ""
            texts |= {name: [group, found[2]] for name in names}
        elif line.startswith(" "):
            for name in names:
                texts[name].append(line.strip())
        else:
            names = []
    joined = {name: " ".join(filter(None, lines)) for name, lines in texts.items()}
    return {name: _sentence(text) for name, text in joined.items() if text and not text.endswith(":")}


def _sentence(text: str) -> str:
    """Return a text of a docstring as one about JSON."""
    text = re.sub(r"\bNone\b", "null", re.sub(r"\bTrue\b", "true", text.replace("``", "")))
    text = re.sub(r"^[a-z]+(?=[ .]|$)", lambda word: word[0].capitalize(), text)
    return text if text.endswith(".") else f"{text}."


def _listed(text: str, names: list[str]) -> list[str]:
    """Return the fields that the head of a paragraph names: "a, b", or all of "a to b"."""
    first, _, last = text.partition(" to ")
    if last:
        return names[names.index(first) : names.index(last) + 1]
    return [name for name in text.split(", ") if name in names]


# Manifests.


def manifest_schema() -> Schema:
    """Return the schema of manifests, with keys as the documentation writes them: with hyphens."""
    schema = msgspec.json.schema(ManifestFile)
    definitions = {name.lstrip("_"): definition for name, definition in schema["$defs"].items()}
    for name, options in (("BakeTable", BakeOptions), ("SphereTable", SphereOptions)):
        for option in option_fields(options):
            if option.name in definitions[name]["properties"]:
                definitions[name]["properties"][option.name] |= {"description": description(option), **_bounds(option)}
    for definition in definitions.values():
        definition["required"] = definition.pop("required", [])
        definition["properties"] = {
            name.replace("_", "-"): _in_toml(value) for name, value in definition["properties"].items()
        }
        definition.pop("title")
        if not definition["required"]:
            del definition["required"]
    title = "Manifest of aoprecalc batch"
    text = json.dumps({**definitions.pop("ManifestFile"), "title": title, "$defs": definitions})
    renamed: Schema = json.loads(text.replace("#/$defs/_", "#/$defs/"))
    return renamed


def _bounds(field: OptionField) -> Schema:
    """Return the bounds of an option's number; they say nothing about values of other types."""
    if field.option.range is None or field.kind == "integers":
        return {}
    low, high = field.option.range
    return {"exclusiveMinimum" if field.option.above_min else "minimum": low, "maximum": high}


def _in_toml(value: Schema) -> Schema:
    """Return the schema of a key: TOML has no null, and a whole number is a number."""
    value = {key: entry for key, entry in value.items() if key != "default"}
    choices = [choice for choice in value.get("anyOf", []) if choice != {"type": "null"}]
    if {"type": "number"} in choices:
        choices = [choice for choice in choices if choice != {"type": "integer"}]
    if len(choices) == 1:
        del value["anyOf"]
        return choices[0] | value
    return value | ({"anyOf": choices} if choices else {})


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for file in FOLDER.glob("*.json"):
        file.unlink()
    for name, text in schemas().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
