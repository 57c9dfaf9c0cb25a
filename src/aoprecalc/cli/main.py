"""`aoprecalc`: the group of commands, and the one place where errors become exit codes."""

import re
import signal
import sys
import traceback
from io import TextIOWrapper
from typing import Any

import click

from aoprecalc import __version__
from aoprecalc.cli.bake import bake
from aoprecalc.cli.batch import batch
from aoprecalc.cli.cache import cache
from aoprecalc.cli.compare import compare
from aoprecalc.cli.console import annotate
from aoprecalc.cli.doctor import doctor
from aoprecalc.cli.options import option_name
from aoprecalc.cli.spheres import spheres
from aoprecalc.cli.verify import verify
from aoprecalc.errors import AnswerError, AoprecalcError, ArgumentError

EPILOG = (
    "Exit codes: 0 done; 1 the work failed, verify or compare found more than allowed, or a batch's mesh failed; "
    "2 wrong usage; 3 no way to render; 4 the input mesh is unusable. "
    "A failure leaves no file behind, but for the reports and pictures of a verify or compare that answers no."
)


class _Group(click.Group):
    """A group whose failures, click's own included, end in one `error:` line and an exit code."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line; always ends the process."""
        kwargs["standalone_mode"] = False
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):  # names of files need not be text
                stream.reconfigure(errors="backslashreplace")
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does, which tidies up
        try:
            sys.exit(super().main(*args, **kwargs) or 0)
        except AoprecalcError as error:
            _fail(_message(error), error.exit_code, error)
        except click.exceptions.Exit as ending:
            sys.exit(ending.exit_code)
        except click.ClickException as error:
            _fail(_usage_line(error), error.exit_code, error)
        except (click.Abort, KeyboardInterrupt):
            click.echo("error: interrupted; no output was written", err=True)
            sys.exit(130)
        except BrokenPipeError:
            sys.exit(1)  # whoever read the results has gone
        except OSError as error:
            _fail(f"reading or writing failed ({error}); check the disk, and where standard output goes", 1, error)
        except MemoryError as error:
            _fail("out of memory; use a smaller --size or mesh", 1, error)
        except Exception as error:
            _fail(f"{type(error).__name__}: {error}; this is a fault of aoprecalc, -v shows where", 1, error)


@click.group(
    cls=_Group,
    epilog=EPILOG,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, "--version", prog_name="aoprecalc")
def main() -> None:
    """Precompute ambient-occlusion textures and shadow-casting spheres for triangle meshes.

    Needs neither a GPU nor a display.
    """


main.add_command(bake)
main.add_command(batch)
main.add_command(cache)
main.add_command(spheres)
main.add_command(verify)
main.add_command(compare)
main.add_command(doctor)


def _fail(message: str, code: int, error: BaseException) -> None:
    asked = any(re.fullmatch(r"--verbose|-[a-z]*v[a-z]*", word) for word in sys.argv[1:])
    if asked and not isinstance(error, AnswerError):
        traceback.print_exception(error)
    line = " ".join(message.split())
    click.echo(f"error: {line}", err=True)
    annotate("error", line)
    sys.exit(code)


def _message(error: AoprecalcError) -> str:
    """Return the message of an error; arguments are named as options."""
    return error.worded(option_name) if isinstance(error, ArgumentError) else str(error)


def _usage_line(error: click.ClickException) -> str:
    """Say click's message in this program's form: what was found, and where to read what is expected."""
    message = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    return f"{message}; see `{context.command_path} --help`" if context else message
