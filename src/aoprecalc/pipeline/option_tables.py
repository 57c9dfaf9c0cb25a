"""Tables of options, as manifests hold them: `[bake]` and `[spheres]`, read and validated by msgspec."""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, TypeVar, get_args, get_type_hints

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType, defstruct

from aoprecalc.api.bake_files import HARMONICS_EXTENSIONS, plan_bake
from aoprecalc.api.high_to_low import refuse_unused_cage
from aoprecalc.errors import ArgumentError, UsageError, nearest
from aoprecalc.io import IMAGE_EXTENSIONS, OUTPUT_MESH_EXTENSIONS
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.options.fields import OptionField, option_fields
from aoprecalc.pipeline.jobs import JobSpec

Table = Mapping[str, Any]
Arguments = dict[str, Any]  # Python arguments, by their names
Choice = Arguments | bool | None  # arguments; true: the defaults; false: none of it; None: as said before
Document = TypeVar("Document", bound=Struct)

# The options that say how many spheres; one given later takes the place of the others.
COUNTS = frozenset(
    {"spheres"} | {field.name for field in option_fields(SphereOptions) if field.option.instead_of == "spheres"}
)


def _type_of(field: OptionField) -> Any:
    """Return the type of an option's value in a table, with what is expected as its description."""
    types: dict[str, Any] = {
        "flag": bool,
        "names": list[str] | str,
        "files": list[str] | str,
        "file": str,
        "integers": list[int],
        "number": int | float,
        "distance": int | float,
        "text": str,
    }
    plain = int | float | str if field.takes_distance else types.get(field.kind, int)
    if field.kind == "choice":
        plain = Literal[(*field.choices, *(int(choice) for choice in field.choices if choice.isdecimal()))]
    return Annotated[plain | str if field.option.quantity else plain, Meta(description=field.expected)]


def _extensions(known: tuple[str, ...], several: str) -> Any:
    """Return the type of a key `output`: an extension or a list of them; `several` says what a list may hold."""
    description = f"one of {', '.join(known)}, or a list of {several}"
    # The types here and below are made at run time, for msgspec; mypy cannot read them.
    return Annotated[Literal[known] | list[Literal[known]], Meta(description=description)]  # type: ignore[valid-type]


def _extension(known: tuple[str, ...]) -> Any:
    """Return the type of a key that is an extension."""
    return Annotated[Literal[known], Meta(description=f"one of {', '.join(known)}")]


def _table_type(name: str, kind: type, **others: Any) -> type[Struct]:
    """Return the type of a table with the options of a class, and with others; what it does not give is UNSET."""
    types = {field.name: _type_of(field) for field in option_fields(kind) if field.on_command_line} | others
    fields = [(key, types[key] | UnsetType, UNSET) for key in sorted(types)]
    return defstruct(name, fields, forbid_unknown_fields=True, kw_only=True)


_BAKE_OUTPUTS = (*IMAGE_EXTENSIONS, *OUTPUT_MESH_EXTENSIONS)
_SWITCH = Annotated[bool, Meta(description="true or false")]
_BakeTable = _table_type(
    "_BakeTable",
    BakeOptions,
    output=_extensions(_BAKE_OUTPUTS, "an image's and a mesh's"),
    verify=_SWITCH,
    bent_normals=_extension(IMAGE_EXTENSIONS),
    sh=_extension(HARMONICS_EXTENSIONS),
)
_SphereTable = _table_type("_SphereTable", SphereOptions, output=_extensions(SPHERE_EXTENSIONS, "several"))
_EXPECTED_TABLE = Meta(description="a table of its options, true or false")
_BakeChoice = Annotated[bool | _BakeTable | None, _EXPECTED_TABLE]  # type: ignore[valid-type]
_SphereChoice = Annotated[bool | _SphereTable | None, _EXPECTED_TABLE]  # type: ignore[valid-type]


class Tables(Struct, forbid_unknown_fields=True):
    """What is made: a table of options; true for the defaults, false for nothing, None where nothing is said."""

    bake: _BakeChoice = None
    spheres: _SphereChoice = None

    def choices(self) -> tuple[Choice, Choice]:
        """Return both as Python arguments; raises ArgumentError for a text that is no quantity."""
        return _arguments(BakeOptions, self.bake), _arguments(SphereOptions, self.spheres)


def _arguments(kind: type, table: Struct | bool | None) -> Choice:
    """Return a table as Python arguments."""
    if not isinstance(table, Struct):
        return table
    given = {name: value for name in table.__struct_fields__ if (value := getattr(table, name)) is not UNSET}
    for field in option_fields(kind):
        if field.option.quantity and isinstance(given.get(field.name), str):
            given[field.name] = field.read(given[field.name], field.option.quantity)
    return given


def make_job_spec(bake: Arguments | None, spheres: Arguments | None) -> JobSpec:
    """Return the job spec that Python arguments stand for, which are named as the keys of tables are; None: nothing.

    Raises UsageError where a value is wrong, or where two contradict each other.
    """
    if bake is None and spheres is None:
        raise UsageError("neither bake nor spheres is asked for, so there is nothing to do; ask for one of them")
    made: dict[str, Any] = {}
    if bake is not None:
        rest = dict(bake)
        made["bake_output"] = _suffixes("output", rest.pop("output", JobSpec.bake_output), _BAKE_OUTPUTS)
        made["verify"] = rest.pop("verify", JobSpec.verify)
        for name, known in (("bent_normals", IMAGE_EXTENSIONS), ("sh", HARMONICS_EXTENSIONS)):
            if name in rest:
                made[name] = _suffixes(name, rest.pop(name), known)[0]
        made["bake"] = BakeOptions(**rest, bent_normals="bent_normals" in made or "sh" in made)
        refuse_unused_cage(made["bake"])
        plan_bake("", tuple(f"<name>_ao{suffix}" for suffix in made["bake_output"]), None, None, made["bake"])
    if spheres is not None:
        if len(counts := sorted(COUNTS & spheres.keys())) > 1:
            raise ArgumentError(counts[0], f"and {{{counts[1]}}} both say how many spheres; use one of them", counts[1])
        rest = dict(spheres)
        made["spheres_output"] = _suffixes("output", rest.pop("output", JobSpec.spheres_output), SPHERE_EXTENSIONS)
        made["spheres"] = SphereOptions(**rest)
    return JobSpec(**made)


def _suffixes(argument: str, output: Any, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the extensions that an argument names, each once; raises ArgumentError for anything else."""
    wanted = (output,) if isinstance(output, str) else tuple(output)
    if not wanted:
        raise ArgumentError(argument, f"is empty; expected an extension, one of {', '.join(known)}")
    for suffix in wanted:
        if suffix not in known:
            found = f"is {suffix!r}; for the results of a batch an extension was expected, one of {', '.join(known)}"
            raise ArgumentError(argument, f"{found}; their names come from the meshes")
    return tuple(dict.fromkeys(wanted))


def convert(document: Table, kind: type[Document]) -> Document:
    """Return a document as a type of msgspec; raises UsageError that names the key and what was expected."""
    plain = _plain_keys(document)
    try:
        return msgspec.convert(plain, kind)
    except msgspec.ValidationError as error:
        raise UsageError(_explained(str(error), plain, kind)) from error


def key_name(argument: str) -> str:
    """Return the key of a table that stands for a Python argument."""
    return argument.replace("_", "-")


def _plain_keys(value: Any) -> Any:
    """Return tables with keys as arguments are named, those in lists too; raises UsageError where two keys are one."""
    if isinstance(value, list):
        return [_plain_keys(entry) for entry in value]
    if not isinstance(value, Mapping):
        return value
    for key in value:
        if "-" in key and key.replace("-", "_") in value:
            raise UsageError(f"{key} is given twice, with - and with _; omit one of them")
    return {key.replace("-", "_"): _plain_keys(entry) for key, entry in value.items()}


def _explained(message: str, document: Any, kind: type[Struct]) -> str:
    """Say what a message of msgspec says in our form: the key, its value, what was expected."""
    problem, _, path = message.partition(" - at `$")
    names: list[str] = []
    value, rest, expected = document, document, ""
    for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        rest = rest[name or int(index)]
        if name:
            value, hint = rest, get_type_hints(kind, include_extras=True)[name]
            expected = next((entry.description or "" for entry in _parts(hint) if isinstance(entry, Meta)), "")
            kind = next(
                (entry for entry in _parts(hint) if isinstance(entry, type) and issubclass(entry, Struct)), kind
            )
            names.append(key_name(name))
        else:
            names[-1] += f"[{index}]"
    if found := re.fullmatch(r"Object (contains unknown|missing required) field `(.*)`", problem):
        key = ".".join([*names, key_name(found[2])])
        if found[1] == "missing required":
            return f"{key} is missing; add it"
        known = [key_name(name) for name in kind.__struct_fields__]
        if meant := nearest(key_name(found[2]), known):
            return f"unknown key {key!r}; did you mean {meant!r}?"
        return f"unknown key {key!r}; expected one of {', '.join(known)}"
    key = re.sub(r"\[\d+\]$", "", ".".join(names))  # what is wrong with an entry is said of its list
    return f"{key} is {value!r}; expected {expected}"


def _parts(hint: Any) -> Iterator[Any]:
    """Yield a type, what it is made of, and its annotations."""
    yield hint
    for part in (*get_args(hint), *getattr(hint, "__metadata__", ())):
        yield from _parts(part)


def arguments_of(choice: Choice) -> Arguments | None:
    """Return the arguments of a choice; None for none of it."""
    return ({} if choice else None) if isinstance(choice, bool | None) else choice
