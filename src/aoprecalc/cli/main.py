"""`aoprecalc`: the group of commands, and `completion`. Errors become messages and exit codes here."""

import re
import signal
import sys
import traceback
from io import TextIOWrapper
from typing import Any

import click
from click.shell_completion import get_completion_class

from aoprecalc import __version__
from aoprecalc.cli.bake import bake
from aoprecalc.cli.batch import batch
from aoprecalc.cli.cache import cache
from aoprecalc.cli.commands import Command
from aoprecalc.cli.compare import compare
from aoprecalc.cli.doctor import doctor
from aoprecalc.cli.options import annotate, explained, without_controls
from aoprecalc.cli.preview import preview
from aoprecalc.cli.report import report
from aoprecalc.cli.spheres import spheres
from aoprecalc.cli.verify import verify
from aoprecalc.errors import AnswerError, AoprecalcError, UsageError, option_name, system_failure

VARIABLE = "_AOPRECALC_COMPLETE"  # by which the script of `completion` asks for completions

EPILOG = (
    "If an option is given twice, the last one counts, unless its help says that it may be repeated. "
    "Exit codes: 0 done; 1 the work failed, verify or compare did not pass, or a mesh of a batch failed; "
    "2 wrong usage; 3 no renderer works; 4 the input mesh is unusable. "
    "A command that fails leaves no file behind; a verify or compare that does not pass keeps its report and pictures."
)


class _Group(click.Group):
    """A group of commands that reports every failure, click's included, by one `error:` line and an exit code."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line; always ends the process."""
        kwargs["standalone_mode"] = False
        kwargs["complete_var"] = VARIABLE
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):  # file names may be invalid text
                stream.reconfigure(errors="backslashreplace")
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # clean up as after Ctrl-C
        try:
            sys.exit(super().main(*args, **kwargs) or 0)
        except AoprecalcError as error:
            _fail(error.worded(option_name), error.exit_code, error)
        except click.exceptions.Exit as ending:
            sys.exit(ending.exit_code)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message(), err=True)
            sys.exit(error.exit_code)
        except click.ClickException as error:
            _fail(_usage_line(error), error.exit_code, error)
        except (click.Abort, KeyboardInterrupt):
            click.echo("error: interrupted; no output was written", err=True)
            sys.exit(130)
        except BrokenPipeError:
            sys.exit(1)  # the reader of standard output is gone
        except OSError as error:
            _fail(system_failure(error, "check the disk and the target of standard output"), 1, error)
        except MemoryError as error:
            _fail("out of memory; use a smaller --size or mesh", 1, error)
        except Exception as error:
            _fail(f"{type(error).__name__}: {error}; this is a fault of aoprecalc, -v shows where", 1, error)


def _print_versions(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print the version of aoprecalc, and of what its results depend on, without importing any of it."""
    if not wanted or ctx.resilient_parsing:
        return
    from aoprecalc.system import LIBRARIES, machine, versions

    facts = machine()
    lines = [f"aoprecalc {__version__}", f"Python {facts['python']}, {facts['platform']}"]
    lines += [f"{name} {version or 'is not installed'}" for name, version in versions(LIBRARIES).items()]
    click.echo("\n".join(lines))
    ctx.exit()


@click.group(
    cls=_Group,
    epilog=EPILOG,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_print_versions,
    help="Print the versions of aoprecalc and of what it uses, and exit.",
)
def main() -> None:
    """Precompute ambient-occlusion textures and shadow-casting spheres for triangle meshes.

    Needs neither a GPU nor a display.
    """


@click.command(short_help="Print the script that completes command lines in bash, zsh or fish.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print a script for SHELL that completes commands, options, their values, and files.

    bash must be version 4.4 or later; that of macOS is older.

    \b
    bash    echo 'eval "$(aoprecalc completion bash)"' >> ~/.bashrc
    zsh     echo 'eval "$(aoprecalc completion zsh)"' >> ~/.zshrc
    fish    aoprecalc completion fish > ~/.config/fish/completions/aoprecalc.fish
    """  # noqa: D301 - \b is for click, and the docstring must not be raw
    kind = get_completion_class(shell)
    assert kind is not None  # click has all three
    click.echo(kind(click.get_current_context().find_root().command, {}, "aoprecalc", VARIABLE).source())


for command in (bake, batch, cache, spheres, preview, verify, compare, report, doctor, completion):
    main.add_command(command)


def _fail(message: str, code: int, error: BaseException) -> None:
    """Print the error, with its traceback if `-v` is given and the usage was right, and exit."""
    verbose = any(re.fullmatch(r"--verbose|-[a-z]*v[a-z]*", word) for word in sys.argv[1:])
    if verbose and not isinstance(error, AnswerError | UsageError | click.UsageError):
        traceback.print_exception(error)
    line = without_controls(" ".join(message.split()))
    click.echo(f"error: {line}", err=True)
    annotate("error", line)
    sys.exit(code)


def _usage_line(error: click.ClickException) -> str:
    """Return a message of click with a pointer to the command's help."""
    message = explained(error)
    context = getattr(error, "ctx", None)
    if context is None:
        return message
    command, entry = context.command, getattr(error, "param", None)
    flag = command.explained_by(entry) if isinstance(command, Command) else "--help"
    return f"{message}; see `{context.command_path} {flag}`"
