"""Options, each stated once: as an annotated field of its options class.

    padding: Annotated[int, Option("Texels by which charts are extended.", range=(0, 256))] = 8

Validation, the options of the command line, the tables of manifests, the commands in reports and the documentation are
all derived from that field. Standard library only, so that `--help` is instant.
"""

from collections.abc import Callable
from dataclasses import InitVar, dataclass
from numbers import Integral, Real
from textwrap import wrap
from typing import Any, Literal, TypeVar, get_args, get_origin

from aoprecalc.errors import ArgumentError
from aoprecalc.options.quantities import Quantity

Kind = Literal["flag", "choice", "names", "integers", "size", "integer", "number", "text"]
OptionsClass = TypeVar("OptionsClass", bound=type[Any])


@dataclass(frozen=True)
class Option:
    """What is said about one option, beside its name, type and default, which the field has.

    help           one or two sentences for `--help`; `name` in backquotes is another option
    short          short name on the command line, such as -n
    more           what the documentation adds to `help`
    group          heading in `--help`
    range          (min, max) of a number, or of each number
    above_min      the minimum itself is excluded
    unit           such as texels
    metavar        placeholder of the value in `--help`; by default N, or the quantity's
    default_text   what the default stands for, where its value does not say it
    quantity       how the value is written as text, where that is not plain
    off            flag that switches it off
    part_of        option of the command line that sets this argument
    instead_of     option that this one takes the place of
    """

    help: str
    short: str = ""
    more: str = ""
    group: str = ""
    range: tuple[int, int] | None = None
    above_min: bool = False
    unit: str = ""
    metavar: str = ""
    default_text: str = ""
    quantity: Quantity | None = None
    off: str = ""
    part_of: str = ""
    instead_of: str = ""


@dataclass(frozen=True)
class OptionField:
    """One option of an options class.

    name       of the Python argument
    type       its type, without None
    optional   None is allowed
    default    value where the option is not given
    init_only  an argument that sets other fields, not a field of its own
    option     what else is said about it
    """

    name: str
    type: Any
    optional: bool
    default: Any
    init_only: bool
    option: Option

    @property
    def kind(self) -> Kind:
        """What sort of value it takes."""
        origin, arguments = get_origin(self.type), get_args(self.type)
        if origin is Literal:
            return "choice"
        if origin is tuple:
            return "names" if arguments[0] is str else "integers"
        kinds: dict[Any, Kind] = {bool: "flag", int: "integer", float: "number", str: "text"}
        return kinds.get(self.type, "size")

    @property
    def choices(self) -> tuple[str, ...]:
        """The values that it may have; empty where it is not a choice."""
        return get_args(self.type) if self.kind == "choice" else ()

    @property
    def expected(self) -> str:
        """What is accepted, in words."""
        bounds = ""
        if self.option.range is not None:
            low, high = self.option.range
            bounds = f" above {low}, at most {high}" if self.option.above_min else f" from {low} to {high}"
        return {
            "flag": "true or false",
            "choice": f"one of {', '.join(self.choices)}",
            "names": "a list of names",
            "integers": "a list of whole numbers",
            "size": f"a whole number{bounds}, or a width and a height",
            "integer": f"a whole number{bounds}",
            "number": f"a number{bounds}",
            "text": "a text",
        }[self.kind]

    def check(self, value: Any) -> Any:
        """Return a value as its type; NumPy's numbers become Python's, lists tuples. Raises ArgumentError."""
        if value is None and self.optional:
            return None
        try:
            return _CONVERTERS[self.kind](self, value)
        except (TypeError, ValueError):
            pair = self.kind == "size" and isinstance(value, tuple) and len(value) == 2
            shown = self.option.quantity.write(value) if pair and self.option.quantity else repr(value)
            raise ArgumentError(self.name, f"is {shown}; expected {self.expected}") from None

    def read(self, text: str) -> Any:
        """Return the value that a text stands for; raises ArgumentError where it stands for none."""
        quantity = self.option.quantity
        if quantity is None:
            return self.check(text)
        try:
            return quantity.read(text)
        except ValueError:
            raise ArgumentError(self.name, f"is {text!r}; expected {quantity.expected}") from None

    def words(self, value: Any) -> list[str]:
        """Return the words of a command line that give the option this value."""
        name = f"--{self.name.replace('_', '-')}"
        if self.kind == "flag":
            return [name] if value else [self.option.off]
        if self.kind == "names":
            return [word for entry in value for word in (name, entry)]
        return [name, self.option.quantity.write(value) if self.option.quantity else str(value)]

    def in_range(self, value: Any) -> Any:
        """Return a number that is in the range; raises ValueError for others."""
        if self.option.range is not None:
            low, high = self.option.range
            if not low <= value <= high or (self.option.above_min and value == low):
                raise ValueError
        return value


def _flag(field: OptionField, value: Any) -> bool:
    if not isinstance(value, bool) and type(value).__name__ != "bool":  # the second is NumPy's
        raise TypeError
    return bool(value)


def _choice(field: OptionField, value: Any) -> str:
    text = str(value) if isinstance(value, int) else value  # such as the bits of a channel
    if not isinstance(text, str) or text not in field.choices:
        raise ValueError
    return text


def _names(field: OptionField, value: Any) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else tuple(value)
    if not all(isinstance(name, str) for name in names):
        raise TypeError
    return names


def _integer(field: OptionField, value: Any) -> int:
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError
    number: int = field.in_range(int(value))
    return number


def _integers(field: OptionField, value: Any) -> tuple[int, ...]:
    return tuple(_integer(field, entry) for entry in value)


def _size(field: OptionField, value: Any) -> tuple[int, int]:
    width, height = value if isinstance(value, tuple | list) else (value, value)
    return _integer(field, width), _integer(field, height)


def _number(field: OptionField, value: Any) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError
    number: float = field.in_range(value if isinstance(value, int | float) else float(value))
    return number


def _text(field: OptionField, value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


_CONVERTERS: dict[Kind, Callable[[OptionField, Any], Any]] = {
    "flag": _flag,
    "choice": _choice,
    "names": _names,
    "integers": _integers,
    "size": _size,
    "integer": _integer,
    "number": _number,
    "text": _text,
}


_FIELDS: dict[type, tuple[OptionField, ...]] = {}


def option_fields(kind: type) -> tuple[OptionField, ...]:
    """Return the options of an options class: those of no field first, then those of its bases, then its own."""
    if kind not in _FIELDS:
        _FIELDS[kind] = _read_fields(kind)
    return _FIELDS[kind]


def _read_fields(kind: type) -> tuple[OptionField, ...]:
    found: dict[str, OptionField] = {}
    for base in reversed(kind.__mro__):
        for name, hint in vars(base).get("__annotations__", {}).items():
            init_only = isinstance(hint, InitVar)
            bare, *metadata = get_args(hint.type if init_only else hint)
            types = get_args(bare) if type(None) in get_args(bare) else (bare,)
            plain = [entry for entry in types if entry is not type(None)]
            parts = tuple(field.default for field in found.values() if field.option.part_of == name)
            found[name] = OptionField(
                name=name,
                type=plain[0] if len(plain) == 1 else bare,
                optional=len(plain) < len(types),
                default=parts or getattr(kind, name),
                init_only=init_only,
                option=metadata[0],
            )
    return tuple(sorted(found.values(), key=lambda field: not field.init_only))


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
        lines.append(f"{field.name} : {_type_text(field)}, default {_default_text(field)}")
        lines += wrap(description(field), 112, initial_indent="    ", subsequent_indent="    ")
        if field.init_only:
            del kind.__dataclass_fields__[field.name]
            delattr(kind, field.name)
    kind.__doc__ = "\n".join([(kind.__doc__ or "").rstrip(), *(f"    {line}".rstrip() for line in lines), "    "])
    return kind


def description(field: OptionField) -> str:
    """Return the whole text about an option: its help, what the documentation adds, its range."""
    option = field.option
    parts = [option.help, option.more]
    if option.range is not None and field.kind != "integers":
        low, high = option.range
        parts.append(f"Above {low}, at most {high:,}." if option.above_min else f"From {low:,} to {high:,}.")
    return " ".join(filter(None, parts))


def _type_text(field: OptionField) -> str:
    texts = {
        "flag": "bool",
        "choice": f"{{{', '.join(map(repr, field.choices))}}}",
        "names": "tuple of str",
        "integers": "tuple of int",
        "size": "int or (int, int)",
        "integer": "int",
        "number": "float",
        "text": "str",
    }
    unit = f" ({field.option.unit})" if field.option.unit else ""
    return f"{texts[field.kind]}{unit}{' or None' if field.optional and not field.init_only else ''}"


def _default_text(field: OptionField) -> str:
    return f"{field.default!r} ({field.option.default_text})" if field.option.default_text else repr(field.default)


def as_words(options: Any) -> list[str]:
    """Return the words of a command line that stand for options; those with their default values are left out."""
    values = {field: getattr(options, field.name) for field in option_fields(type(options)) if not field.option.part_of}
    given = {field: value for field, value in values.items() if value != field.default}
    replaced = {field.option.instead_of for field in given}
    return [word for field, value in given.items() if field.name not in replaced for word in field.words(value)]
