"""What all commands share: options, made from the options classes, and what is printed.

Results go to stdout; progress, notes, warnings and annotations for GitHub workflows to stderr.
"""

import os
import re
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from aoprecalc.errors import ArgumentError, nearest, option_name
from aoprecalc.options import MESH_EXTENSIONS, with_extensions
from aoprecalc.options.fields import OptionField, details, option_fields
from aoprecalc.options.quantities import Quantity
from aoprecalc.progress import Progress

DEFAULT_CACHE = "$AOPRECALC_CACHE, else ~/.cache/aoprecalc"

Declared = TypeVar("Declared", bound=Callable[..., Any])
Options = TypeVar("Options")


class PathType(click.types.StringParamType):
    """The path of a file or a folder, which shells complete; it stays a text."""

    def __init__(self, kind: Literal["file", "dir"]) -> None:
        """Complete files or folders."""
        self._kind = kind

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Have the shell complete the path."""
        return [CompletionItem(incomplete, type=self._kind)]


FILE = PathType("file")
_PATHS = {"PATH": FILE, "FILE": FILE, "DIR": PathType("dir")}  # the type of an option by its metavar


class CliOption(click.Option):
    """An option with a group in `--help` and a longer text in the documentation.

    group   heading in `--help`
    common  explained by `--help` already, not by `--help-all` alone
    more    what the documentation adds to the help
    shown   the default in words, where no value says it
    """

    def __init__(
        self, *names: Any, group: str = "", common: bool = False, more: str = "", shown: str = "", **given: Any
    ) -> None:
        """Declare an option as click does; its texts may name lists of extensions, see `with_extensions`."""
        given.setdefault("type", _PATHS.get(given.get("metavar") or ""))
        super().__init__(*names, **given)
        self.help = with_extensions(self.help or "")
        self.group, self.common, self.more, self.shown = group, common, with_extensions(more), shown

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return names and help; the help ends with the default in words."""
        record = super().get_help_record(ctx)
        if record:
            record = record[0], re.sub(r"([\d.]+)<=x<=([\d.]+)", r"\1 to \2", record[1])
            record = record[0], re.sub(r"([\d.]+)<x<=([\d.]+)", r"above \1, at most \2", record[1])
        if not (record and self.shown):
            return record
        text, _, bounds = record[1].partition("  [")
        return record[0], f"{text}  [default: {self.shown}" + (f"; {bounds}" if bounds else "]")


def explained(error: click.ClickException) -> str:
    """Return the message of an error of click; an unknown name comes with the one that is meant, if one is near.

    click itself suggests names of little likeness, and several of them.
    """
    if not isinstance(error, click.NoSuchOption | click.NoSuchCommand):
        return error.format_message().rstrip(".")
    found, context = error.message.rstrip("."), error.ctx
    if isinstance(error, click.NoSuchOption):
        known = [] if context is None else [name for entry in context.command.params for name in _names_of(entry)]
        meant = nearest(error.option_name, known) if error.option_name.startswith("--") else ""
    elif error.command_name.lower().endswith(MESH_EXTENSIONS):
        return f"{found} (did you mean `aoprecalc bake {shlex.quote(error.command_name)}`?)"
    else:
        meant = nearest(error.command_name, error.possibilities or ())
    return f"{found} (did you mean {meant!r}?)" if meant else found


def _names_of(entry: click.Parameter) -> list[str]:
    """Return the long names of an option; none of an argument."""
    return [name for name in (*entry.opts, *entry.secondary_opts) if name.startswith("--")]


def quantity_type(quantity: Quantity) -> Callable[[str], Any]:
    """Return the click type of a quantity."""

    def convert(text: str) -> Any:
        try:
            return quantity.read(text)
        except ValueError:
            raise click.BadParameter(f"{text!r} was found; expected {quantity.expected}") from None

    return convert


def _count_or_auto(field: OptionField, quantity: Quantity) -> Callable[[str], Any]:
    """Return the click type of a whole number that may be auto; it checks the range, too."""
    read = quantity_type(quantity)

    def convert(text: str) -> Any:
        try:
            return field.check(read(text))
        except ArgumentError:
            raise click.BadParameter(f"{text!r} was found; expected {field.expected}") from None

    return convert


def option(*names: str, **given: Any) -> Callable[[Declared], Declared]:
    """Declare an option that no options class has; see CliOption."""
    return click.option(*names, cls=CliOption, **given)


def open_option(command: Declared) -> Declared:
    """Declare --open, of commands that make what people look at."""
    return option("--open", "opens", is_flag=True, group="Output", help="Open what was made in the system's viewer.")(
        command
    )


def options_of(kind: type) -> Callable[[Declared], Declared]:
    """Declare all options of an options class."""

    def declare(command: Declared) -> Declared:
        for field in reversed(option_fields(kind)):
            if field.on_command_line:
                command = _option_of(kind, field)(command)
        return command

    return declare


def take(kind: type[Options], given: dict[str, Any]) -> Options:
    """Return the options of a class among the parameters of the present command, and remove them from these."""
    source = click.get_current_context().get_parameter_source
    values = {}
    for field in option_fields(kind):
        if field.name in given and (value := given.pop(field.name)) is not None:
            if source(field.name) is ParameterSource.DEFAULT:
                continue  # the class knows its defaults, among them "as baked", which click has no value for
            values[field.name] = value
            rival = field.option.instead_of
            if rival and source(field.name) is source(rival) is ParameterSource.COMMANDLINE:
                raise ArgumentError(field.name, f"is instead of {{{rival}}}, but both were given; omit one", rival)
    return kind(**values)


def output_options(command: Declared) -> Declared:
    """Declare the options that every command has."""
    for add in (
        option(
            "-v",
            "--verbose",
            is_flag=True,
            group="Run",
            help="Print the seconds of each stage; add tracebacks to errors.",
        ),
        option("-q", "--quiet", is_flag=True, group="Run", help="Print nothing but results, warnings and errors."),
        option("--json", "as_json", is_flag=True, group="Output", help="Print the result as JSON on standard output."),
    ):
        command = add(command)
    return command


def _option_of(kind: type, field: OptionField) -> Callable[[Declared], Declared]:
    """Declare one option of an options class."""
    about, name = field.option, option_name(field.name)
    given: dict[str, Any] = {"metavar": about.metavar or None}
    if field.kind == "flag":
        given |= {"is_flag": True, "default": field.default}
        if about.off:
            name, given["shown"] = f"{name}/{about.off}", about.default_text or about.off
    elif field.kind in ("names", "files"):
        metavar = about.metavar or ("NAME" if field.kind == "names" else "FILE")
        given |= {"multiple": True, "metavar": metavar, "shown": about.default_text}
    else:
        default = field.default if about.quantity is None else _written_default(field, about.quantity)
        given |= {"default": default, "show_default": True} if default is not None else {"shown": about.default_text}
        if about.quantity:
            may_be_auto = field.kind == "integer" and about.none
            read = _count_or_auto(field, about.quantity) if may_be_auto else quantity_type(about.quantity)
            given |= {"type": read, "metavar": about.quantity.metavar}
        elif field.kind == "file":
            given["type"] = FILE
        elif field.kind == "choice":
            given["type"] = click.Choice(field.choices)
        elif about.range:
            given |= {"type": _number_type(field), "metavar": about.metavar or "N"}
    repeated = "May be repeated." if field.kind in ("names", "files") else ""
    return option(
        *filter(None, (about.short, name)),
        field.name,
        help=_with_option_names(kind, " ".join(filter(None, (about.help, repeated)))),
        more=_with_option_names(kind, details(field)),
        group=about.group,
        common=about.common,
        **given | {"shown": _with_option_names(kind, given.get("shown", ""))},
    )


def _number_type(field: OptionField) -> click.IntRange | click.FloatRange:
    """Return the click type of a number in its field's range."""
    low, high = field.option.range or (None, None)
    if field.kind == "integer":
        whole = click.IntRange(low, high)
        whole.name = "whole number"  # click says so where a text is none
        return whole
    number = click.FloatRange(low, high, min_open=field.option.above_min)
    number.name = "number"
    return number


def _written_default(field: OptionField, quantity: Quantity) -> str | None:
    """Return a default as people write it; None where it has no such form."""
    written = field.option.default_text or (quantity.write(field.default) if field.default else "")
    try:
        return written if quantity.read(written) == field.default else None
    except ValueError:
        return None


def _with_option_names(kind: type, text: str) -> str:
    """Return a text with options of the command line in place of `argument`s."""
    names = {field.name for field in option_fields(kind)}
    return re.sub(r"`(\w+)`", lambda match: option_name(match[1]) if match[1] in names else match[0], text)


# What commands print.


def annotate(level: str, message: str, *, file: Path | None = None) -> None:
    """Print an annotation, which GitHub shows beside the file; nothing where no GitHub workflow runs.

    level   error, warning or notice
    """
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    where = f" file={_escaped(str(file)).replace(':', '%3A').replace(',', '%2C')}" if file is not None else ""
    click.echo(f"::{level}{where}::{_escaped(message)}", err=True)


def without_controls(text: str) -> str:
    """Return a text with ? for control characters: names in files may hold any, and steer a terminal."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f]", "?", text)


def say(*lines: str) -> None:
    """Print lines of a result on stdout, which may hold names from files."""
    click.echo("\n".join(map(without_controls, lines)))


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


class Console(Progress):
    """Prints warnings, and notes unless quiet; shows progress bars if stderr is a terminal."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        """Print nothing yet."""
        self._quiet = quiet
        self._verbose = verbose and not quiet
        self._bar: Any = None  # of the current stage; None without a terminal
        self._task: Any = None

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Show a stage while it lasts; with `verbose`, print its seconds."""
        started = time.perf_counter()
        if sys.stderr.isatty() and not self._quiet:
            with _bar(total) as self._bar:
                self._task = self._bar.add_task(name, total=total, unit=unit, step="")
                try:
                    yield
                finally:
                    self._bar = None
        else:
            yield
        if self._verbose:
            self._say(f"{name}: {time.perf_counter() - started:.2f} s")

    def advance(self, count: int = 1) -> None:
        """Advance the bar of the current stage."""
        if self._bar is not None:
            self._bar.advance(self._task, count)

    def step(self, text: str) -> None:
        """Show the step of the current stage on a terminal."""
        if self._bar is not None:
            self._bar.update(self._task, step=text)

    def note(self, text: str) -> None:
        """Print a note, unless quiet."""
        if not self._quiet:
            self._say(text)

    def warn(self, text: str) -> None:
        """Print a warning."""
        self._say(f"warning: {text}")

    def _say(self, line: str) -> None:
        line = without_controls(line)
        if self._bar is not None:  # above the bar, not through it
            self._bar.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(line, err=True)


def open_file(path: Path, console: Console) -> None:
    """Open a file in the system's viewer; a note tells where there is none."""
    from aoprecalc.system import has_desktop

    if not has_desktop() or click.launch(str(path)) != 0:
        console.note(f"{path}: no viewer was found to open it")


def _bar(total: int | None) -> Any:
    """Return a rich progress bar for one stage; it disappears when the stage ends."""
    from rich import progress
    from rich.console import Console as Terminal

    columns = [progress.SpinnerColumn(), progress.TextColumn("{task.description:<10}"), progress.TimeElapsedColumn()]
    columns.append(progress.TextColumn("{task.fields[step]}", markup=False))
    if total is not None:
        count = progress.TextColumn("{task.completed}/{task.total} {task.fields[unit]}")
        columns[2:] = [progress.BarColumn(), count, progress.TimeRemainingColumn(), progress.TextColumn("left")]
    return progress.Progress(*columns, console=Terminal(stderr=True), transient=True)
