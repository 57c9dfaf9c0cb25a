"""Options, each stated once: as an annotated field of its options class.

    padding: Annotated[int, Option("Texels by which charts are extended.", range=(0, 256))] = 8

Validation, the options of the command line, the tables of manifests, the commands in reports and the documentation are
all derived from that field. Standard library only, so that `--help` is instant.
"""

import re
from collections.abc import Callable
from dataclasses import InitVar, dataclass, replace
from functools import cache
from inspect import get_annotations
from math import inf, isfinite
from numbers import Integral, Real
from os import PathLike, fspath
from textwrap import wrap
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin

from aoprecalc.errors import ArgumentError
from aoprecalc.options.quantities import AUTO, BYTES, Quantity, read_distance

Kind = Literal[
    "flag", "choice", "names", "files", "integers", "vector", "size", "distance", "file", "integer", "number", "text"
]  # fmt: skip
# Kind of value -> its type in docstrings, what is expected in messages.
_WORDS: dict[Kind, tuple[str, str]] = {
    "flag": ("bool", "true or false"),
    "choice": ("{{{choices}}}", "one of {choices}"),
    "names": ("tuple of str", "a list of names"),
    "files": ("tuple of str or path-like", "a list of paths of files"),
    "integers": ("tuple of int", "a list of whole numbers"),
    "vector": ("(float, float, float)", "three finite numbers, not all 0"),
    "size": ("int or (int, int){or_auto}", "a whole number{bounds}, or a width and a height{or_auto}"),
    "distance": ("float or str", "a length above 0, or a share of the diagonal such as '10%'{or_none}"),
    "file": ("str or path-like{or_keywords}", "the path of a file{or_keywords}"),
    "integer": ("int", "a whole number{bounds}{or_none}"),
    "number": ("float", "a number{bounds}"),
    "text": ("str", "a text"),
}
OptionsClass = TypeVar("OptionsClass", bound=type[Any])
OptionsT = TypeVar("OptionsT")


@dataclass(frozen=True)
class Option:
    """What is said about one option, beside its name, type and default, which the field has.

    help           one or two sentences for `--help`; `name` in backquotes is another option
    short          short name on the command line, such as -n
    more           what the documentation adds to `help`
    group          heading in `--help`
    common         `--help` explains it; the others are explained by `--help-all`
    range          (min, max) of a number, or of each number
    above_min      the minimum itself is excluded
    unit           such as texels
    metavar        placeholder of the value in `--help`; by default N, or the quantity's
    default_text   what the default stands for, where its value does not say it
    quantity       how the value is written as text, where that is not plain
    path           a text is the path of a file that decides the result
    keywords       texts that stand for themselves instead
    none           text that stands for None, where None may be "as baked" instead
    off            flag that switches it off
    part_of        option of the command line that sets this argument
    hidden         an argument of Python that no option of the command line sets
    instead_of     option that this one takes the place of
    """

    help: str
    short: str = ""
    more: str = ""
    group: str = ""
    common: bool = False
    range: tuple[int, int] | None = None
    above_min: bool = False
    unit: str = ""
    metavar: str = ""
    default_text: str = ""
    quantity: Quantity | None = None
    path: bool = False
    keywords: tuple[str, ...] = ()
    none: str = ""
    off: str = ""
    part_of: str = ""
    hidden: bool = False
    instead_of: str = ""


@dataclass(frozen=True)
class OptionField:
    """One option of an options class.

    name       of the Python argument
    type       its type, without None
    optional   None is allowed
    default    value where the option is not given
    init_only  an argument that sets other fields, not a field of its own
    as_baked   None is what the bake had
    option     what else is said about it
    """

    name: str
    type: Any
    optional: bool
    default: Any
    init_only: bool
    as_baked: bool
    option: Option

    @property
    def on_command_line(self) -> bool:
        """Whether the command line and manifests have an option for it, of its own name."""
        return not (self.option.part_of or self.option.hidden)

    @property
    def kind(self) -> Kind:
        """What sort of value it takes."""
        origin, arguments = get_origin(self.type), get_args(self.type)
        if self.option.path:
            return "files" if origin is tuple else "file"
        if origin is Literal:
            return "choice"
        if origin is tuple:
            kinds_of_entries: dict[Any, Kind] = {str: "names", float: "vector"}
            return kinds_of_entries.get(arguments[0], "integers")
        if {float, str} <= {*arguments}:
            return "distance"
        kinds: dict[Any, Kind] = {bool: "flag", int: "integer", float: "number", str: "text"}
        return kinds.get(self.type, "size")

    @property
    def choices(self) -> tuple[str, ...]:
        """The values that it may have; empty where it is not a choice."""
        return get_args(self.type) if self.kind == "choice" else ()

    @property
    def takes_auto(self) -> bool:
        """Whether a size may be the text `auto`."""
        return any(get_args(entry) == (AUTO,) for entry in get_args(self.type))

    @property
    def expected(self) -> str:
        """What is accepted, in words."""
        bounds = ""
        if self.option.range is not None:
            low, high = self.option.range
            bounds = f" above {low}, at most {high}" if self.option.above_min else f" from {low} to {high}"
        return _WORDS[self.kind][1].format(bounds=bounds, choices=", ".join(self.choices), **self.alternatives)

    @property
    def takes_distance(self) -> bool:
        """Whether a file option may be a length or a share of the diagonal instead."""
        return self.kind == "file" and float in get_args(self.type)

    @property
    def alternatives(self) -> dict[str, str]:
        """What is accepted beside its usual values, in words: `or_auto`, `or_keywords`, `or_none`."""
        keywords = ", or a length, or a share of the diagonal such as '2%'" if self.takes_distance else ""
        keywords += "".join(f", or {keyword!r}" for keyword in self.option.keywords)
        none = f", or {self.option.none!r}" if self.option.none else ""
        return {"or_auto": f", or {AUTO!r}" if self.takes_auto else "", "or_keywords": keywords, "or_none": none}

    def is_distance(self, value: float | str) -> bool:
        """Tell whether the value of a file option is a length or a share of the diagonal."""
        return self.takes_distance and (not isinstance(value, str) or _is_distance(value))

    def check(self, value: Any) -> Any:
        """Return a value as its type; NumPy's numbers become Python's, lists tuples. Raises ArgumentError."""
        if value is None and self.optional:
            return None
        if self.option.none and isinstance(value, str) and value == self.option.none:
            return value if self.as_baked else None
        try:
            return self._converted(value)
        except (TypeError, ValueError):
            pair = self.kind == "size" and isinstance(value, tuple) and len(value) == 2
            shown = self.option.quantity.write(value) if pair and self.option.quantity else repr(value)
            raise ArgumentError(self.name, f"is {shown}; expected {self.expected}") from None

    def read(self, text: str, quantity: Quantity) -> Any:
        """Return the value that a text stands for; raises ArgumentError where it stands for none."""
        try:
            return quantity.read(text)
        except ValueError:
            raise ArgumentError(self.name, f"is {text!r}; expected {quantity.expected}") from None

    def words(self, value: Any) -> list[str]:
        """Return the words of a command line that give the option this value."""
        name = f"--{self.name.replace('_', '-')}"
        if self.kind == "flag":
            return [name] if value else [self.option.off]
        if self.kind in ("names", "files"):
            return [word for entry in value for word in (name, entry)]
        return [name, self.option.quantity.write(value) if self.option.quantity else str(value)]

    def _converted(self, value: Any) -> Any:
        """Return a value as its type; raises TypeError or ValueError."""
        if self.kind == "flag" and (isinstance(value, bool) or type(value).__name__ == "bool"):  # NumPy's
            return bool(value)
        if self.kind == "choice" and (text := str(value) if isinstance(value, int) else value) in self.choices:
            return text
        if self.kind == "text" and isinstance(value, str):
            return value
        if self.kind == "names":
            names = (value,) if isinstance(value, str) else tuple(value)
            if all(isinstance(name, str) for name in names):
                return names
        if self.takes_distance and not isinstance(value, str | PathLike):
            return self._positive(value)
        if self.takes_distance and _is_distance(value):
            return read_distance(value)
        if self.kind == "file":
            return value if value in self.option.keywords else _path(value, extension=bool(self.option.keywords))
        if self.kind == "files":
            return tuple(map(_path, (value,) if isinstance(value, str | PathLike) else value))
        if self.kind == "integers":
            return tuple(self._number(entry) for entry in value)
        if self.kind == "vector":
            vector = tuple(float(self._number(entry)) for entry in value)
            if len(vector) == 3 and any(vector) and all(map(isfinite, vector)):
                return vector
        if self.kind == "distance":
            return read_distance(value) if isinstance(value, str) else self._positive(value)
        if self.kind == "size" and self.takes_auto and value == AUTO:
            return AUTO
        if self.kind == "size":
            width, height = value if isinstance(value, tuple | list) else (value, value)
            return self._number(width), self._number(height)
        if self.kind in ("integer", "number"):
            return self._number(value)
        raise TypeError

    def _positive(self, value: Any) -> float:
        """Return a finite number above 0; raises TypeError or ValueError."""
        number = float(self._number(value))
        if not 0 < number < inf:
            raise ValueError
        return number

    def _number(self, value: Any) -> int | float:
        """Return a number in the range; raises TypeError or ValueError."""
        whole = self.kind not in ("number", "vector", "distance", "file")
        accepted: Any = Integral if whole else Real
        if isinstance(value, bool) or not isinstance(value, accepted):
            raise TypeError
        low, high = self.option.range or (-inf, inf)
        if not low <= value <= high or (self.option.above_min and value == low):
            raise ValueError
        return int(value) if whole else value if isinstance(value, int) else float(value)


def _is_distance(value: Any) -> bool:
    """Tell whether a text is a length or a share of the diagonal."""
    try:
        read_distance(value)
    except (ValueError, AttributeError):
        return False
    return True


def _path(value: Any, *, extension: bool = False) -> str:
    """Return a path as text, with an extension where that tells it from a mistyped keyword or length.

    Raises TypeError or ValueError.
    """
    path = fspath(value)
    if not isinstance(path, str):
        raise TypeError
    if not path or (extension and not re.search(r"\.\w*[a-z]\w*$", path, re.IGNORECASE)):
        raise ValueError
    return path


def _read_fields(kind: type) -> tuple[OptionField, ...]:
    """Return the options of an options class: those of no field first, then those of its bases, then its own."""
    found: dict[str, OptionField] = {}
    for base in reversed(kind.__mro__):
        for name, hint in get_annotations(base).items():
            init_only = isinstance(hint, InitVar)
            whole = hint.type if init_only else hint
            stated = next((entry for entry in get_args(whole) if get_origin(entry) is Annotated), whole)
            bare, option = get_args(stated)
            types = get_args(bare) if type(None) in get_args(bare) else (bare,)
            plain = [entry for entry in types if entry is not type(None)]
            parts = tuple(field.default for field in found.values() if field.option.part_of == name)
            type_, optional = plain[0] if len(plain) == 1 else bare, len(plain) < len(types)
            if stated is not whole:
                option, optional = _as_baked(name, type_, option), True
            default = parts or getattr(kind, name)
            found[name] = OptionField(name, type_, optional, default, init_only, stated is not whole, option)
    return tuple(sorted(found.values(), key=lambda field: not field.init_only))


def _as_baked(name: str, kind: Any, option: Option) -> Option:
    """Return what is said about an option of a bake where it may be left to the bake: `OptionOfBake | None`."""
    off = f"--no-{name.replace('_', '-')}" if kind is bool else ""
    return replace(option, default_text="as baked", off=off)


option_fields: Callable[[type], tuple[OptionField, ...]] = cache(_read_fields)


def option_field(kind: type, name: str) -> OptionField:
    """Return one option of an options class."""
    return next(field for field in option_fields(kind) if field.name == name)


class Validated:
    """Base of the options classes: checks every field."""

    def __post_init__(self) -> None:
        """Convert every value to its field's type; raise ArgumentError where that is not possible."""
        for field in option_fields(type(self)):
            if not field.init_only:
                object.__setattr__(self, field.name, field.check(getattr(self, field.name)))


def documented(kind: OptionsClass) -> OptionsClass:
    """Complete an options class: its docstring gets the Parameters section, in NumPy style.

    An argument that is no field is hidden from `dataclasses.replace`, which would otherwise pass it on.
    """
    lines = ["", "Parameters", "----------"]
    for field in option_fields(kind):
        parts = [f"`{part.name}`" for part in option_fields(kind) if part.option.part_of == field.name]
        default = " x ".join(parts) or _default_text(field)
        lines.append(f"{field.name} : {_type_text(field)}, default {default}")
        lines += wrap(description(field), 112, initial_indent="    ", subsequent_indent="    ")
        if field.init_only:
            del kind.__dataclass_fields__[field.name]
            delattr(kind, field.name)
    kind.__doc__ = "\n".join([(kind.__doc__ or "").rstrip(), *(f"    {line}".rstrip() for line in lines), "    "])
    kind.__init__.__annotations__ = {}  # else `help` shows every Option; the Parameters section has the types
    return kind


def description(field: OptionField) -> str:
    """Return the whole text about an option: its help, what the documentation adds, its range."""
    return " ".join(filter(None, (field.option.help, details(field))))


def details(field: OptionField) -> str:
    """Return what the documentation of an option adds to its help: `more`, and the range."""
    option, bounds = field.option, ""
    if option.range is not None and option.quantity is not BYTES:
        low, high = option.range
        bounds = f"Above {low}, at most {high:,}." if option.above_min else f"From {low:,} to {high:,}."
    return " ".join(filter(None, (option.more, bounds)))


def _type_text(field: OptionField) -> str:
    others = {name: text.removeprefix(",") for name, text in field.alternatives.items()}
    text = _WORDS[field.kind][0].format(choices=", ".join(map(repr, field.choices)), **others)
    unit = f" ({field.option.unit})" if field.option.unit else ""
    return f"{text}{unit}{' or None' if field.optional and not field.init_only else ''}"


def _default_text(field: OptionField) -> str:
    return f"{field.default!r} ({field.option.default_text})" if field.option.default_text else repr(field.default)


def as_words(options: Any) -> list[str]:
    """Return the words of a command line that stand for options; those with their default values are left out."""
    values = {field: getattr(options, field.name) for field in option_fields(type(options)) if field.on_command_line}
    given = {field: value for field, value in values.items() if value != field.default}
    replaced = {field.option.instead_of for field in given}
    return [word for field, value in given.items() if field.name not in replaced for word in field.words(value)]


# Options that name files.


def option_files(options: Any) -> tuple[str, ...]:
    """Return the paths of the files that options name, each once."""
    return tuple(dict.fromkeys(path for paths in named_files(options).values() for path in paths))


def with_files(options: OptionsT, moved: Callable[[str], str]) -> OptionsT:
    """Return options with `moved(path)` for the path of each file that they name."""
    several = {field.name for field in option_fields(type(options)) if field.kind == "files"}
    paths = {name: tuple(map(moved, found)) for name, found in named_files(options).items()}
    changed: Any = {name: found if name in several else found[0] for name, found in paths.items()}
    moved_options: OptionsT = replace(cast(Any, options), **changed)
    return moved_options


def named_files(options: Any) -> dict[str, tuple[str, ...]]:
    """Return the paths that each option names; options that name none are left out."""
    paths: dict[str, tuple[str, ...]] = {}
    for field in option_fields(type(options)):
        value = getattr(options, field.name, None)
        if value and field.kind == "files":
            paths[field.name] = value
        elif value and field.kind == "file" and value not in field.option.keywords and not field.is_distance(value):
            paths[field.name] = (value,)
    return paths
