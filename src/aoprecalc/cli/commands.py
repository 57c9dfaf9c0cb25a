"""Commands, and their `--help`: the common options first, on one screen, and all of them with `--help-all`."""

import shlex
from textwrap import wrap
from typing import Any

import click

from aoprecalc.cli.options import CliOption
from aoprecalc.options import with_extensions

# Headings of options in help texts, in their order; what has none of them comes last.
GROUPS = (
    "Output", "Picture", "Texture", "Spheres", "Samples", "Visibility", "Mesh", "Scene", "High to low", "Measurement",
    "Cache", "Cluster", "Run",
)  # fmt: skip


class Command(click.Command):
    """A command whose help lists its options under headings.

    If some of its options are common, `--help` explains these and names the others, and `--help-all` explains all.
    """

    def __init__(self, *names: Any, **given: Any) -> None:
        """Declare a command as click does; its text may name lists of extensions, see `with_extensions`."""
        super().__init__(*names, **given)
        self.help = with_extensions(self.help or "")

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return arguments and options, with those that print help."""
        entries = super().get_params(ctx)
        if self.get_help_option(ctx) is None or not any(map(_is_common, entries)):
            return entries
        return [*entries, _help_all()]

    def explained_by(self, entry: click.Parameter | None) -> str:
        """Return the option that prints the explanation of an option or argument."""
        hidden = isinstance(entry, CliOption) and not entry.common and any(map(_is_common, self.params))
        return "--help-all" if hidden else "--help"

    def full_help(self, ctx: click.Context) -> str:
        """Return the text of `--help-all`."""
        formatter = ctx.make_formatter()
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        _write_groups(formatter, self._groups(ctx), ctx)
        return formatter.getvalue().rstrip("\n")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options for `--help`."""
        groups = self._groups(ctx)
        common = [entry for entries in groups.values() for entry in entries if _is_common(entry)]
        if not common:
            _write_groups(formatter, groups, ctx)
            return
        _write_groups(formatter, {"Common options": common}, ctx, names_width=24)
        with formatter.section(f"Other options, which `{ctx.command_path} --help-all` explains"):
            others = {group: [entry for entry in entries if not _is_common(entry)] for group, entries in groups.items()}
            _write_names(formatter, {group: entries for group, entries in others.items() if entries})

    def _groups(self, ctx: click.Context) -> dict[str, list[click.Option]]:
        """Return the options under each heading; headings without options are left out."""
        groups: dict[str, list[click.Option]] = {group: [] for group in (*GROUPS, "Options")}
        for entry in self.get_params(ctx):
            if isinstance(entry, click.Option) and not entry.hidden:
                groups[getattr(entry, "group", GROUPS[-1]) or "Options"].append(entry)
        return {group: entries for group, entries in groups.items() if entries}


class MeshCommand(Command):
    """A command of one mesh, which says what to do with several.

    many   the command for them
    """

    def __init__(self, *names: Any, many: str, **given: Any) -> None:
        """Declare a command as click does."""
        super().__init__(*names, **{"context_settings": {"allow_extra_args": True}} | given)
        self._many = many

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the command line; a second mesh is a usage error; without a parent it is in `ctx.args`."""
        rest = super().parse_args(ctx, args)
        if ctx.args and ctx.parent is not None and not ctx.resilient_parsing:
            found = " ".join(shlex.quote(word) for word in ctx.args[:3]) + (" ..." if len(ctx.args) > 3 else "")
            raise click.UsageError(
                f"{self.name} takes one mesh, but found {found} as well; for many: {self._many}", ctx
            )
        return rest


def _is_common(entry: click.Parameter) -> bool:
    return isinstance(entry, CliOption) and entry.common


def _help_all() -> CliOption:
    """Return the option that explains all options."""
    return CliOption(
        ["--help-all"],
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=_print_full_help,
        group="Run",
        help="Explain all options and exit.",
    )


def _print_full_help(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing and isinstance(ctx.command, Command):
        click.echo(ctx.command.full_help(ctx))
        ctx.exit()


def _write_groups(
    formatter: click.HelpFormatter, groups: dict[str, list[click.Option]], ctx: click.Context, names_width: int = 30
) -> None:
    """Write options and their explanations under headings; longer names than `names_width` have a line of their own."""
    for group, entries in groups.items():
        with formatter.section(group):
            records = [record for entry in entries if (record := entry.get_help_record(ctx))]
            formatter.write_dl(records, col_max=names_width)


def _write_names(formatter: click.HelpFormatter, groups: dict[str, list[click.Option]]) -> None:
    """Write the names of options, each group on a line, or several."""
    left = " " * formatter.current_indent
    width = 2 + max(map(len, groups))
    for group, entries in groups.items():
        names = " ".join(max(entry.opts, key=len) for entry in entries)
        lines = wrap(
            names,
            formatter.width,
            initial_indent=left + group.ljust(width),
            subsequent_indent=left + " " * width,
            break_on_hyphens=False,
            break_long_words=False,
        )
        formatter.write("".join(f"{line}\n" for line in lines))
