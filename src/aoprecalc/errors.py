"""The errors of this package, each with the exit code of the command line, and words for all messages.

A message is one line: what was found, what was expected, what to do.
"""

import errno
import os
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import SequenceMatcher
from typing import SupportsIndex

MAX_NAME = 255  # bytes of the name of a file or folder, on the file systems of today
_OPTION = re.compile(r"(?<![\w-])--([a-z][a-z-]+)")


def option_name(argument: str) -> str:
    """Return the option of the command line that stands for a Python argument."""
    return f"--{argument.replace('_', '-')}"


def counted(count: SupportsIndex, noun: str, plural: str = "") -> str:
    """Return a number with its noun: 1 mesh, 2 meshes.

    plural   of the noun; empty: with an s
    """
    return f"{count} {one_or_many(count, noun, plural or f'{noun}s')}"


def listed(names: Sequence[str], most: int = 5) -> str:
    """Return names as a text, the first ones of many: a, b, c, d, e and 2 more."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def listed_counts(counts: Sequence[int]) -> str:
    """Return numbers as a text: 4, 8 and 16."""
    *first, last = map(str, counts)
    return f"{', '.join(first)} and {last}" if first else last


def one_or_many(count: SupportsIndex, one: str, many: str) -> str:
    """Return the word that agrees with a number, such as is or are."""
    return one if count == 1 else many


def format_bytes(count: int) -> str:
    """Write an amount of memory for people, to three digits, such as 1.5G."""
    amount, unit = float(count), ""
    for larger in "KMGT":
        if amount < 1024:
            break
        amount, unit = amount / 1024, larger
    return f"{amount:.0f}{unit or ' bytes'}" if not unit or amount >= 100 else f"{amount:.3g}{unit}"


# What other programs call an option -> what it is called here.
SYNONYMS = {
    "samples": "directions",
    "spp": "directions",
    "rays": "directions",
    "resolution": "size",
    "margin": "padding",
    "dilation": "padding",
    "count": "spheres",
}
_NEAR = 0.75  # likeness from which a name counts as misspelt: 0.83 for --unwarp, 0.67 for --samples and --sampling


def nearest(wrong: str, names: Iterable[str]) -> str:
    """Return the one of the names that a wrong one is meant to be, upper and lower case alike; empty if none is near.

    Leading dashes do not count.
    """
    plain = {name: name.lstrip("-").casefold() for name in names}
    written = wrong.lstrip("-").casefold()
    for name, text in plain.items():
        if text == SYNONYMS.get(written):
            return name
    likeness = {name: SequenceMatcher(None, written, text).ratio() for name, text in plain.items()}
    best = max(likeness, key=lambda name: likeness[name], default="")
    return best if best and likeness[best] >= _NEAR else ""


def system_failure(error: OSError, advice: str) -> str:
    """Return the line about what the system refused; `advice` for what is no matter of a name."""
    if error.errno != errno.ENAMETOOLONG or not isinstance(error.filename, str | bytes | os.PathLike):
        return f"reading or writing failed ({error}); {advice}"
    path = os.fsdecode(error.filename)
    length = len(os.fsencode(os.path.basename(path.rstrip(os.sep))))
    return f"{path}: the name is too long ({length} bytes, most systems allow {MAX_NAME}); choose a shorter one"


class AoprecalcError(Exception):
    """Base class of all errors that this package raises on purpose: the work failed (exit code 1).

    Messages are written with options, such as --unwrap-timeout; `str` names the Python arguments instead.
    """

    exit_code = 1

    def __str__(self) -> str:
        return self.worded(str)

    def worded(self, name: Callable[[str], str]) -> str:
        """Return the message with each argument called by `name(argument)`."""
        return _OPTION.sub(lambda option: name(option[1].replace("-", "_")), super().__str__())


class OutputError(AoprecalcError):
    """An output file cannot be written (exit code 1)."""


class AnswerError(AoprecalcError):
    """A check is done and did not pass; its outputs stay (exit code 1)."""


class KilledError(AoprecalcError):
    """A child process was killed, perhaps because memory ran out (exit code 1)."""


class StoppedError(AoprecalcError):
    """The user interrupted the work; finished results stay (exit code 130)."""

    exit_code = 130


class UsageError(AoprecalcError):
    """The command, or a combination of arguments, makes no sense (exit code 2)."""

    exit_code = 2


class ArgumentError(UsageError):
    """A Python argument or an option has a wrong value (exit code 2).

    `ArgumentError("padding", "is -1; expected a whole number from 0 to 256")` reads "padding is -1; expected ...".
    The command line names the option instead of the argument, a manifest names the key; see `worded`.

    argument   name of the Python argument
    problem    rest of the sentence: what was found, what was expected, what to do
    others     names of further arguments, which `problem` mentions as {name}
    """

    def __init__(self, argument: str, problem: str, *others: str) -> None:
        """Keep the parts of the message."""
        super().__init__(argument, problem, *others)
        self.argument, self.problem, self.others = argument, problem, others

    def worded(self, name: Callable[[str], str]) -> str:
        """Return the message with each argument called by `name(argument)`."""
        problem = self.problem
        for other in self.others:
            problem = problem.replace(f"{{{other}}}", name(other))
        return f"{name(self.argument)} {problem}"


class RendererError(AoprecalcError):
    """No renderer works on the machine (exit code 3)."""

    exit_code = 3


class InputError(AoprecalcError):
    """The input mesh is missing, unreadable or empty (exit code 4)."""

    exit_code = 4
