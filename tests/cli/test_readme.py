"""README and `--help` say the same."""

import re
from pathlib import Path

import click
import pytest
from scripts.option_tables import with_tables

from aoprecalc.cli import main

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")

COMMANDS = [name for name in main.commands if name != "completion"]  # that has no options


def section(command):
    """The part of the README about a command; its title shows the command's arguments."""
    return re.search(rf"## `aoprecalc {command}[^`]*`\n(.*?)(?=\n## )", README, re.DOTALL)[1]


def parameters(command):
    """Its options, and those of the commands that it is a group of."""
    commands = [main.commands[command], *getattr(main.commands[command], "commands", {}).values()]
    return [entry for one in commands for entry in one.params if isinstance(entry, click.Option)]


def test_the_tables_of_options_are_those_of_the_program():
    assert with_tables(README) == README, "run python scripts/option_tables.py"
    assert re.findall(r"<!-- options of (\w+)", README) == list(
        dict.fromkeys(re.findall(r"^## `aoprecalc (\w+)", README, re.M))
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_in_the_readme_and_none_beside_it(command):
    real = {name for entry in parameters(command) for name in (*entry.opts, *entry.secondary_opts)}
    written = set(re.findall(r"`(--?[a-z][a-z-]*)", section(command)))
    assert written == real


@pytest.mark.parametrize("command", COMMANDS)
def test_defaults_in_the_readme_are_the_programs(command):
    rows = dict(re.findall(r"^\| (.*?) \| (.*?) \|", section(command), re.MULTILINE))
    for entry in parameters(command):
        default = entry.default
        if isinstance(default, str | int) and not isinstance(default, bool):
            cell = next(cell for names, cell in rows.items() if f"`{entry.opts[-1]}" in names)
            assert cell.replace(",", "") == str(default)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_and_command_has_help(command):
    assert main.commands[command].short_help
    for entry in parameters(command):
        assert entry.help, entry.name
        assert entry.help.endswith((".", "]")), entry.name
    for choice in (
        word for entry in parameters(command) if isinstance(entry.type, click.Choice) for word in entry.type.choices
    ):
        assert choice in section(command)


def test_the_readme_opens_with_two_commands_that_make_knows():
    first = re.search(r"```sh\n(.*?)```", README, re.DOTALL)[1]
    assert re.findall(r"^make (\w+)", first, re.MULTILINE) == ["demo", "test"]
    targets = re.findall(r"^(\w+):", (Path(__file__).parents[2] / "Makefile").read_text(), re.MULTILINE)
    assert {"demo", "test", "setup", "bench"} <= set(targets)
