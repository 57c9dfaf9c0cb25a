"""The directive `command`: the options of a command, from the statements in `aoprecalc.options` and `aoprecalc.cli`.

Each option is a definition of Sphinx, to which ``{option}`aoprecalc bake --size` `` refers.
"""

import re
from collections.abc import Iterator
from typing import Any

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from aoprecalc.cli import main
from aoprecalc.cli.commands import GROUPS
from aoprecalc.cli.options import CliOption

CODE = r"(--[a-z-]+|<stem>[\w.<>]*|\$\w+|~/[\w./]+)"  # what a default is written with
OPTION = r"(?<![`\w])--[a-z][a-z-]*"


def options_of(command: click.Command) -> list[CliOption]:
    """Return the options of a command, in the order of `--help`."""
    found = [entry for entry in command.params if isinstance(entry, CliOption)]
    return sorted(found, key=lambda entry: GROUPS.index(entry.group))


def signature(entry: CliOption) -> str:
    """Return the names of an option and its placeholder, such as `-n, --directions N`."""
    placeholder = f" {entry.metavar}" if entry.metavar else ""
    if isinstance(entry.type, click.Choice):
        placeholder = f" {'|'.join(entry.type.choices)}"
    return ", ".join((*sorted(entry.opts, key=len), *entry.secondary_opts)) + placeholder


def _code(words: str) -> str:
    return re.sub(OPTION, r"`\g<0>`", words)


def text(entry: CliOption) -> str:
    """Return all that is said about an option, in Markdown."""
    plain = isinstance(entry.default, str | int | float) and not entry.is_flag
    default = f"`{entry.default}`" if plain else re.sub(CODE, r"`\1`", entry.shown)
    said = _code(" ".join(filter(None, (entry.help, entry.more))))
    return f"{said} Default: {default}." if default else said


def described(command: click.Command, program: str) -> Iterator[str]:
    """Yield what there is to say, in Markdown, about the usage of a command, or of each of a group."""
    for name, inner in getattr(command, "commands", {}).items():
        yield f"\n## {program} {name}\n\n{_code(inner.help or '')}\n"
        yield from described(inner, f"{program} {name}")
    if not hasattr(command, "commands"):
        yield f"```text\n{' '.join((program, *command.collect_usage_pieces(click.Context(command))))}\n```\n"
    options = options_of(command)
    for group in dict.fromkeys(entry.group for entry in options):
        yield f"\n### {group}\n\n```{{program}} {program}\n```\n"
        for entry in options:
            if entry.group == group:
                yield f"```{{option}} {signature(entry)}\n{text(entry)}\n```\n"


class CommandDirective(SphinxDirective):
    """`{command} bake` is replaced by the usage and the options of that command, under the headings of `--help`."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the nodes."""
        name = self.arguments[0]
        return self.parse_text_to_nodes(
            "\n".join(described(main.commands[name], f"aoprecalc {name}")), allow_section_headings=True
        )


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("command", CommandDirective)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
