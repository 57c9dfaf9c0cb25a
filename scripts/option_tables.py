"""Write the options of every command into the README's tables, from the statements in `aoprecalc.options` and `cli`.

python scripts/option_tables.py     rewrites README.md between the lines `<!-- options of COMMAND ... -->`
"""

import re
from pathlib import Path

import click

from aoprecalc.cli import main
from aoprecalc.cli.options import GROUPS, CliOption

README = Path(__file__).parent.parent / "README.md"
CODE = r"(--[a-z-]+|<stem>[\w.<>]*|\$\w+|~/[\w./]+)"  # what a default is written with
OPTION = r"(?<![`\w])--[a-z][a-z-]*"
MARKED = r"(<!-- options of (\w+): [^\n]*-->\n).*?(<!-- end of options -->)"


def options_of(command: click.Command) -> list[CliOption]:
    """Return the options of a command, or of all commands of a group, each once, in the order of `--help`."""
    commands = [command, *getattr(command, "commands", {}).values()]
    found = {entry.opts[-1]: entry for one in commands for entry in one.params if isinstance(entry, CliOption)}
    return sorted(found.values(), key=lambda entry: GROUPS.index(entry.group))


def table(command: click.Command) -> str:
    """Return the table of a command's options, in Markdown."""
    rows = ["| option | default | |", "|---|---|---|"]
    for entry in options_of(command):
        names = [f"`{name}`" for name in (*sorted(entry.opts, key=len), *entry.secondary_opts)]
        if entry.metavar:
            names[-1] = f"{names[-1][:-1]} {entry.metavar}`".replace("|", "\\|")
        plain = isinstance(entry.default, str | int | float) and not entry.is_flag
        default = str(entry.default) if plain else re.sub(CODE, r"`\1`", entry.shown)
        choices = entry.type.choices if isinstance(entry.type, click.Choice) else ()
        listed = f"One of {', '.join(f'`{choice}`' for choice in choices)}." if choices else ""
        text = re.sub(OPTION, r"`\g<0>`", " ".join(filter(None, (entry.help, listed, entry.more))))
        rows.append(f"| {', '.join(names)} | {default} | {text} |".replace("|  |", "| |"))
    return "\n".join(rows) + "\n"


def with_tables(text: str) -> str:
    """Return the README's text with all tables as they are now."""
    return re.sub(MARKED, lambda it: it[1] + table(main.commands[it[2]]) + it[3], text, flags=re.DOTALL)


if __name__ == "__main__":
    README.write_text(with_tables(README.read_text(encoding="utf-8")), encoding="utf-8")
