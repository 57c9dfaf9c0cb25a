"""The tables of options in which people say what is to be made of an asset."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar, get_args, get_type_hints

from aoprecalc.errors import UsageError
from aoprecalc.io import IMAGE_EXTENSIONS, OUTPUT_MESH_EXTENSIONS
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline.jobs import JobSpec
from aoprecalc.quantities import read_bytes, read_levels, read_shadow_size, read_size

Table = Mapping[str, Any]
Options = TypeVar("Options", BakeOptions, SphereOptions)

COUNTS = frozenset({"spheres", "tolerance", "levels"})  # each says how many spheres, in place of the others


def read_job_spec(bake: Table | None, spheres: Table | None) -> JobSpec:
    """Return the job spec that two tables stand for; None: nothing of the kind.

    bake      fields of BakeOptions, but `size` as in "2048x1024"; and `texture`, `mesh`, `verify` of JobSpec
    spheres   fields of SphereOptions; and `format`, the extension of the set
    Keys may be written with - or _. Raises UsageError for a key, a type or a value that is wrong.
    """
    if bake is None and spheres is None:
        raise UsageError("neither bake nor spheres is asked for, so there is nothing to do; ask for one of them")
    made: dict[str, Any] = {}
    if bake is not None:
        rest = plain_keys(bake)
        size = dict(zip(("width", "height"), _size(rest.pop("size")), strict=True)) if "size" in rest else {}
        made["verify"] = _typed("verify", rest.pop("verify", False), bool)
        made["texture_suffix"] = _extension("texture", rest.pop("texture", ".png"), IMAGE_EXTENSIONS)
        made["mesh_suffix"] = _extension("mesh", rest.pop("mesh", ""), ("", *OUTPUT_MESH_EXTENSIONS))
        made["bake"] = _options(BakeOptions, rest, ("size", "texture", "mesh", "verify"), **size)
    if spheres is not None:
        rest = plain_keys(spheres)
        if len(counts := sorted(COUNTS & rest.keys())) > 1:
            raise UsageError(f"{' and '.join(counts)} both say how many spheres; use one of them")
        made["spheres_suffix"] = _extension("format", rest.pop("format", ".json"), SPHERE_EXTENSIONS)
        made["spheres"] = _options(SphereOptions, rest, ("format",))
    return JobSpec(**made)


def as_words(options: BakeOptions | SphereOptions) -> list[str]:
    """Return the words of a command line that stand for options, those that are not the default."""
    words: list[str] = []
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    if isinstance(options, BakeOptions):
        width, height = given.pop("width"), given.pop("height")
        if (width, height) != (BakeOptions.width, BakeOptions.height):
            words += ["--size", str(width) if width == height else f"{width}x{height}"]
        if given["memory_limit"] is not None:
            given["memory_limit"] = _amount(given["memory_limit"])
    elif options.levels or options.tolerance is not None:
        del given["spheres"]  # these say how many
    for name, value in given.items():
        if value == getattr(type(options), name):
            continue
        option = f"--{name.replace('_', '-')}"
        if value is True:
            words.append(option)
        elif name == "levels":
            words += [option, ",".join(map(str, value))]
        elif isinstance(value, tuple):
            words += [word for entry in value for word in (option, entry)]
        else:
            words += [option, str(value)]
    return words


# Options that people may also write as a text.
_READ: dict[str, Callable[[str], Any]] = {
    "memory_limit": read_bytes,
    "shadow_size": read_shadow_size,
    "levels": read_levels,
}


def _options(kind: type[Options], table: dict[str, Any], others: tuple[str, ...], **values: Any) -> Options:
    """Return the options of a table whose keys are fields.

    others   what else may be in such a table
    values   of fields that it names otherwise
    """
    hints: dict[str, Any] = get_type_hints(kind)
    known: set[str] = set(hints) - {"width", "height"}  # these are its size
    for key, value in table.items():
        if key not in known:
            expected = ", ".join(sorted({*others, *known}))
            raise UsageError(f"{key!r} is no option, one of {expected} was expected".replace("_", "-"))
        read = _READ.get(key)
        values[key] = read(value) if read and isinstance(value, str) else _typed(key, value, hints[key])
    return kind(**values)


def plain_keys(table: Table) -> dict[str, Any]:
    """Return a table under the names of fields; raises UsageError where two keys are one."""
    plain = {key.replace("-", "_"): value for key, value in table.items()}
    for key in table:
        if "-" in key and key.replace("-", "_") in table:
            raise UsageError(f"{key} is given twice, with - and with _; omit one of them")
    return plain


def _size(value: Any) -> tuple[int, int]:
    if isinstance(value, str):
        return read_size(value)
    if isinstance(value, tuple):
        return value
    return (value, value)


def _amount(count: int) -> str:
    """Write an amount of bytes as `read_bytes` takes it, rounded up to what that can say."""
    units = enumerate("KMGT", 1)
    return next(f"{whole}{unit}" for power, unit in units if (whole := -(-count >> 10 * power)) < 10**9)


def _extension(key: str, value: Any, known: tuple[str, ...]) -> str:
    if value not in known:
        raise UsageError(f"{key} is {value!r}; expected one of {', '.join(filter(None, known))}")
    return str(value)


def _typed(key: str, value: Any, hint: Any) -> Any:
    """Return a value that is as its hint says; what ranges and choices say is checked by the options themselves."""
    if hint is bool and not isinstance(value, bool):
        raise UsageError(f"{key.replace('_', '-')} is {value!r}; expected true or false")
    if getattr(hint, "__origin__", None) is tuple:
        entries = [value] if isinstance(value, str) else value
        kind = get_args(hint)[0]
        if not isinstance(entries, list | tuple) or not all(type(entry) is kind for entry in entries):
            expected = "names" if kind is str else "whole numbers"
            raise UsageError(f"{key.replace('_', '-')} is {value!r}; expected a list of {expected}")
        return tuple(entries)
    if type(value) is int and str(value) in get_args(hint):  # such as the bits of --bit-depth
        return str(value)
    return value
