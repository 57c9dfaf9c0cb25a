"""`--help` explains every command and every option."""

import click
import pytest

from aoprecalc.cli import main


def parameters(command):
    """The options of a command, and those of the commands that it is a group of."""
    commands = [main.commands[command], *getattr(main.commands[command], "commands", {}).values()]
    return [entry for one in commands for entry in one.params if isinstance(entry, click.Option)]


@pytest.mark.parametrize("command", main.commands)
def test_every_option_and_command_has_help(command):
    assert main.commands[command].short_help
    for entry in parameters(command):
        assert entry.help, entry.name
        assert entry.help.endswith((".", "]")), entry.name
