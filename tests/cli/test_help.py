"""`--help` explains every command and every option."""

import re

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


MANY = ["bake", "spheres", "preview", "verify", "batch"]  # those with more options than a screen holds


def lines_of_help(command, *, full=False, width=100):
    """The lines of `--help` or `--help-all` on a terminal of that width."""
    context = click.Context(main.commands[command], info_name=f"aoprecalc {command}", terminal_width=width)
    text = context.command.full_help(context) if full else context.command.get_help(context)
    return text.splitlines()


def names_of(entry):
    """The long names of an option."""
    return {name for name in entry.opts if name.startswith("--")}


@pytest.mark.parametrize("command", [name for name in main.commands if not hasattr(main.commands[name], "commands")])
def test_help_fits_a_screen(command):
    assert len(lines_of_help(command)) <= 45


@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("command", MANY)
def test_help_explains_common_options_and_names_the_others_in_full(command, width):
    lines = lines_of_help(command, width=width)
    assert max(map(len, lines)) <= width
    others = lines.index(f"Other options, which `aoprecalc {command} --help-all` explains:")
    explained = set(re.findall(r"^  (?:-\w, )?(--[\w-]+)", "\n".join(lines[:others]), re.MULTILINE))
    named = {word for line in lines[others + 1 :] for word in line.split() if word.startswith("--")}
    common = {name for entry in parameters(command) if entry.common for name in names_of(entry)}
    assert explained == common
    rest = {name for entry in parameters(command) if not entry.common for name in names_of(entry)}
    assert named == rest | {"--help", "--help-all"}


@pytest.mark.parametrize("command", MANY)
def test_help_all_explains_every_option(command):
    text = " ".join(" ".join(lines_of_help(command, full=True)).split())
    for entry in parameters(command):
        assert entry.help.replace("- ", "-")[:40] in text.replace("- ", "-"), entry.name
    assert "--help-all Explain all options and exit." in text


def test_help_all_is_printed_and_stops(run, tmp_path):
    done = run(tmp_path, "bake", "missing.obj", "--help-all", "--size", "nothing")
    assert (done.returncode, done.stderr) == (0, "")
    assert "--shadow-size N|auto" in done.stdout
    assert "--shadow-size N|auto" not in run(tmp_path, "bake", "--help").stdout


def test_a_command_that_fits_has_no_second_help(run, tmp_path):
    done = run(tmp_path, "doctor", "--help-all")
    assert done.returncode == 2
    assert "--help-all" not in run(tmp_path, "doctor", "--help").stdout


@pytest.mark.parametrize(("words", "flag"), [(["--size", "no"], "--help"), (["--seed", "no"], "--help-all")], ids=str)
def test_an_error_names_the_help_that_explains_the_option(words, flag, run, tmp_path):
    assert run(tmp_path, "bake", "a.obj", *words).stderr.endswith(f"see `aoprecalc bake {flag}`\n")
