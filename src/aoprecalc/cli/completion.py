"""`aoprecalc completion`."""

import click
from click.shell_completion import get_completion_class

VARIABLE = "_AOPRECALC_COMPLETE"  # by which the script asks for completions


@click.command(short_help="Print the script that completes command lines in bash, zsh or fish.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print a script for SHELL that completes commands, options, their values, and files.

    bash must be version 4.4 or later; that of macOS is older.

    \b
    bash    echo 'eval "$(aoprecalc completion bash)"' >> ~/.bashrc
    zsh     echo 'eval "$(aoprecalc completion zsh)"' >> ~/.zshrc
    fish    aoprecalc completion fish > ~/.config/fish/completions/aoprecalc.fish
    """  # noqa: D301
    kind = get_completion_class(shell)
    assert kind is not None  # click has all three
    click.echo(kind(click.get_current_context().find_root().command, {}, "aoprecalc", VARIABLE).source())
