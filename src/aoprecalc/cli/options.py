"""Options that take their defaults, choices and ranges from `aoprecalc.options`."""

import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar, get_args, get_type_hints

import click

from aoprecalc.options import RANGES

Command = TypeVar("Command", bound=Callable[..., Any])


def option(
    *names: str, of: type, field: str, help: str, type: click.ParamType | None = None
) -> Callable[[Command], Command]:
    """Return a click option for one field of an options class, with its default, and its choices or range in the help."""
    default = next(entry.default for entry in fields(of) if entry.name == field)
    hint = get_type_hints(of)[field]
    choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
    if type is None and choices:
        type = click.Choice(choices)
    elif type is None:
        low, high = RANGES[field]
        type = click.FloatRange(low, high) if float in (hint, *get_args(hint)) else click.IntRange(int(low), int(high))
    metavar = None if choices else "DEG" if field.endswith("angle") else "N"
    shown = default is not None
    return click.option(*names, field, default=default, show_default=shown, type=type, metavar=metavar, help=help)


def common(command: Command) -> Command:
    """Add the options that every command has."""
    for add in (
        click.option("-v", "--verbose", is_flag=True, help="Say more: seconds a stage, and tracebacks of errors."),
        click.option("-q", "--quiet", is_flag=True, help="Print nothing but results and errors."),
        click.option("--json", "as_json", is_flag=True, help="Print the report as JSON on standard output."),
    ):
        command = add(command)
    return command


class Size(click.ParamType):
    """A texture's size: `1024` or `2048x1024`."""

    name = "N|WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return (width, height)."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d{1,9})(?:[xX](\d{1,9}))?", str(value).strip())
        if match is None:
            self.fail(f"{value!r} is not a size; expected a number of texels such as 1024, or 2048x1024", param, ctx)
        return int(match[1]), int(match[2] or match[1])


class ShadowSize(click.ParamType):
    """The side of a near/far map: a number of texels, or `auto` (None)."""

    name = "N|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | None:
        """Return the number, or None for auto."""
        if value == "auto":
            return None
        if isinstance(value, int):
            return value
        if not str(value).isdecimal() or len(str(value)) > 9:
            self.fail(f"{value!r} is neither a number of texels nor auto", param, ctx)
        return int(value)
