"""Options that take their defaults, choices and ranges from `aoprecalc.options`."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar, get_args, get_type_hints

import click

from aoprecalc.errors import UsageError
from aoprecalc.options import RANGES, LightOptions
from aoprecalc.quantities import read_bytes, read_levels, read_shadow_size, read_size

_METAVARS = {"crease_angle": "DEG", "target_error": "E", "tolerance": "E"}

Command = TypeVar("Command", bound=Callable[..., Any])
Value = TypeVar("Value")


def option_name(argument: str) -> str:
    """Return the option of the command line that stands for a Python argument."""
    return f"--{argument.replace('_', '-')}"


def option(*names: str, of: type, field: str, help: str) -> Callable[[Command], Command]:
    """Return a click option for one field of an options class, with its default and its choices or range."""
    default = next(entry.default for entry in fields(of) if entry.name == field)
    hint = get_type_hints(of)[field]
    choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
    kind = click.Choice(choices) if choices else _number(field, whole=float not in (hint, *get_args(hint)))
    metavar = None if choices else _METAVARS.get(field, "N")
    shown = default is not None
    return click.option(*names, field, default=default, show_default=shown, type=kind, metavar=metavar, help=help)


def _number(field: str, *, whole: bool) -> click.IntRange | click.FloatRange:
    """Return the type of a number in its field's range; click says its name where the text is none."""
    kind = click.IntRange(*RANGES[field]) if whole else click.FloatRange(*RANGES[field])
    kind.name = "whole number" if whole else "number"
    return kind


def light(command: Command) -> Command:
    """Add the options of LightOptions."""
    for add in (
        option("--up", of=LightOptions, field="up", help="Away from the floor; auto is y, and z for STL."),
        click.option("--ground", is_flag=True, help="Stand on an endless floor: no light comes from below."),
        click.option("--two-sided", is_flag=True, help="Take the lighter of a face's two sides."),
        click.option("--glass-occludes", is_flag=True, help="Parts that light passes through are in its way as well."),
        _names("--occluders-only", "Parts that are in the light's way and get no texture."),
        _names("--exclude", "Parts to treat as if they were not there."),
        _names("--only", "Parts that get the texture; the others are still in the light's way."),
    ):
        command = add(command)
    return command


def _names(name: str, help: str) -> Callable[[Command], Command]:
    """Return an option that names parts, again and again."""
    return click.option(name, multiple=True, metavar="NAME", help=f"{help} May have * and ?, may be repeated.")


def common(command: Command) -> Command:
    """Add the options that every command has."""
    for add in (
        click.option("-v", "--verbose", is_flag=True, help="Say more: seconds a stage, and tracebacks of errors."),
        click.option("-q", "--quiet", is_flag=True, help="Print nothing but results and errors."),
        click.option("--json", "as_json", is_flag=True, help="Print the result's JSON on standard output."),
    ):
        command = add(command)
    return command


def written(read: Callable[[str], Value]) -> Callable[[str], Value]:
    """Return a click type for a quantity that people write; click says of which option it is wrong."""

    def convert(text: str) -> Value:
        try:
            return read(text)
        except UsageError as error:
            raise click.BadParameter(str(error)) from error

    return convert


size, levels = written(read_size), written(read_levels)
memory, shadow_size = written(read_bytes), written(read_shadow_size)
